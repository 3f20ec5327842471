"""The plan of a tick: its steps in order, built once from the scene, run one after the other, each of them timed.

This is the whole of a tick.  To see what happens in which order, read ``build``, or run
``itouch-py inspect SCENE --plan``.  Safety's steps stand after each read and before each write because the plan is
built so; nothing that a plugin declares can move them.  Where all steps join, the tick is one compiled call:
``advance``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.joining import Chain, can_join, host_time, run_chain
from itouch.loop import steps
from itouch.loop.clock import now
from itouch.loop.device_runner import Runner
from itouch.loop.events import Events
from itouch.loop.fingers import fingers
from itouch.loop.moving_objects import Objects
from itouch.loop.probe_rig import ProbeRig
from itouch.loop.run_statistics import Counts
from itouch.loop.tick_step import Step
from itouch.loop.timing import count
from itouch.loop.write_access import WriteGuard, WriteGuards
from itouch.plugin import Record
from itouch.safety import HoldToRun
from itouch.schema import ItouchError
from itouch.world import ModalityModel, Model

Stamps = NDArray[np.float64]

#: Codes for what is left to Python: the whole tick, or its rest from where the plan has stopped, which is in ``left``;
#: or what its listener has left, likewise.
PYTHON, STOPPED, TOLD = 1, 2, 3


class PlanError(ItouchError):
    """Steps that can't be in one plan."""


class Plan:
    """The steps of a tick."""

    def __init__(self, listed: Sequence[Step], fields: Iterable[str]) -> None:
        names = tuple(fields)
        self.steps = tuple(step.fitted(names) for step in listed)
        self.names = tuple(step.name for step in self.steps)
        #: Field of each command, requested and sent -> the one step that writes it.
        self.writers = dict(_writers(self.steps, [f for f in names if ".command." in f or ".sent." in f]))
        self._pieces = tuple(_pieces(self.steps))
        self._works = tuple(piece.work for piece in self._pieces)

    @property
    def pieces(self) -> tuple[tuple[str, ...], ...]:
        """The names of the steps, grouped by the call from Python that runs them."""
        return tuple(tuple(step.name for step in piece.steps) for piece in self._pieces)

    @property
    def chains(self) -> tuple[Chain, ...]:
        """The calls of joined steps."""
        return tuple(piece.chain for piece in self._pieces if isinstance(piece, _Joined))

    @property
    def whole(self) -> Chain | None:
        """The chain of all steps, if a single call runs them all."""
        piece = self._pieces[0] if len(self._pieces) == 1 else None
        return piece.chain if isinstance(piece, _Joined) else None

    def go_on(self, found: int, tick: int, ready: bool) -> None:
        """Go on with a tick whose only chain has stopped; ``found`` is what ``Chain.run`` returned."""
        piece = self._pieces[0]
        if isinstance(piece, _Joined):
            piece.go_on(found, tick, ready)

    def go_on_after(self, error: Exception, tick: int, ready: bool) -> None:
        """Go on with a tick whose only chain has raised an error, which is mostly a fault.

        Raises
        ------
        DeviceFaultError
            Put down to the plugin whose compiled function has raised it.
        """
        piece = self._pieces[0]
        if isinstance(piece, _Joined):
            piece.go_on(piece.run_after(error, tick), tick, ready)

    def run(self, tick: int, ready: bool) -> None:
        """Run all steps of a tick; ``ready``: the rig is calibrated, and scripts go on."""
        for work in self._works:
            work(tick, ready)

    def run_timed(self, tick: int, ready: bool, stamps: Stamps) -> None:
        """Run all steps of a tick; ``stamps`` (n,): the host time [s] after step i is written to ``stamps[1 + i]``."""
        for piece in self._pieces:
            piece.run_timed(tick, ready, stamps)


class _Alone:
    """A step that Python calls by itself."""

    def __init__(self, step: Step, first: int) -> None:
        self.steps, self.work, self._mark = (step,), step.work, 1 + first

    def run_timed(self, tick: int, ready: bool, stamps: Stamps) -> None:
        """Run the step, and stamp its end."""
        self.work(tick, ready)
        stamps[self._mark] = now()


class _Joined:
    """Compiled steps in a row, as one call."""

    def __init__(self, listed: Sequence[Step], first: int) -> None:
        self.steps, self._mark = tuple(listed), 1 + first
        self.chain = Chain([bound for step in listed for bound in step.bounds], [len(step.bounds) for step in listed])
        self._owners, self._ends = self.chain.steps.tolist(), self.chain.ends.tolist()
        self.chain.warm_up()
        self._run = self.chain.run
        self._answers = [step.answer for step in listed]

    def work(self, tick: int, ready: bool) -> None:
        """Run the steps; what one leaves to Python is done before the next one runs."""
        try:
            found = self._run()
        except Exception as error:
            found = self.run_after(error, tick)
        self.go_on(found, tick, ready)

    def go_on(self, found: int, tick: int, ready: bool) -> None:
        """Do what a step has left to Python, and run those after it; ``found`` is what ``Chain.run`` returned."""
        while found >= 0:
            begin = self._answered(found, tick, ready)
            try:
                found = self._run(begin)
            except Exception as error:
                found = self.run_after(error, tick)

    def run_timed(self, tick: int, ready: bool, stamps: Stamps) -> None:
        """Run the steps, and stamp the end of each by the same clock."""
        begin = 0
        while True:
            try:
                found = self.chain.run_timed(stamps, self._mark, begin)
            except Exception as error:
                last, begin = self.chain.called, self._failed(error, tick)
            else:
                if found < 0:
                    return
                last, begin = found >> 32, self._answered(found, tick, ready)
            stamps[self._mark + self._owners[last]] = now()

    def run_after(self, error: Exception, tick: int) -> int:
        """Run the steps after one whose function has raised an error, unless that is a fault; return as ``Chain.run``.

        Raises
        ------
        DeviceFaultError
            Put down to the plugin whose function it is.
        """
        while True:
            begin = self._failed(error, tick)
            try:
                return self._run(begin)
            except Exception as another:
                error = another

    def _failed(self, error: Exception, tick: int) -> int:
        """Raise the fault for an error of a plugin's function; if it is none, return the first call of the next step.

        It is none where the device has failed before.
        """
        call = self.chain.called
        owner = self._owners[call]
        failed = self.steps[owner].failed
        if failed is None:
            raise error
        failed(error, call - self._owners.index(owner), tick)
        end: int = self._ends[call]
        return end

    def _answered(self, found: int, tick: int, ready: bool) -> int:
        """Do what a step has left to Python, and return the first call of the next one."""
        call = found >> 32
        answer = self._answers[self._owners[call]]
        if answer is not None:
            answer(found & 0xFFFFFFFF, tick, ready)
        end: int = self._ends[call]
        return end


def _pieces(listed: Sequence[Step]) -> Iterator[_Alone | _Joined]:
    """Yield the steps, consecutive compiled ones joined."""
    join, index = can_join(), 0
    while index < len(listed):
        last = index
        while join and last < len(listed) and listed[last].bounds:
            last += 1
        if last > index:
            yield _Joined(listed[index:last], index)
        else:
            yield _Alone(listed[index], index)
        index = max(last, index + 1)


def _writers(listed: Sequence[Step], commands: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each command with the step that writes it.

    Raises
    ------
    PlanError
        If two steps write the same.
    """
    found: dict[str, str] = {}
    for step in listed:
        for command in step.written(commands):
            if command in found:
                raise PlanError(f"'{command}' is written by '{found[command]}' and by '{step.name}'")
            found[command] = step.name
            yield command, step.name


def _supervision(
    model: Model, state: Record, runners: Mapping[str, Runner], rigs: Sequence[ProbeRig], tracking: Counts
) -> Iterator[Step]:  # fmt: skip
    """Yield the steps that check devices by where the finger is, then those that limit what acts on one finger."""
    for runner in runners.values():
        if any(monitor.needs_finger_position for monitor in runner.model.monitors):
            mine = [rig for rig in rigs if runner is rig.table or rig.moves(runner)]
            carried = [one for one in runners.values() if one.model.carrier == runner.model.name]
            yield steps.supervise(runner, mine, carried, state, tracking)
    for finger, devices in fingers(runners, rigs):
        yield steps.share(finger, devices, rigs, state, model.period)


def _contacts(
    model: Model, state: Record, rigs: Sequence[ProbeRig], views: Mapping[str, Record]
) -> Iterator[Step]:  # fmt: skip
    """Yield the steps that find what each probe touches, by the framework's proxy or as a modality computes it."""
    own = {rig.probe.name: one for rig in rigs if (one := model.contact_of(rig.probe.name)) is not None}
    yield from (steps.follow(rig) for rig in rigs if rig.probe.name in own)
    given = [one for one in model.modalities if one.contact_fields and one.contact_fields.probe in own]
    if given:  # in their own order
        yield from _fenced(given, model, views, [WriteGuard(given, state)], " contacts")
    for rig in rigs:
        one = own.get(rig.probe.name)
        yield steps.contact(rig, model) if one is None else steps.given_contact(rig, model, one)


def _rendering(
    model: Model, state: Record, rigs: Sequence[ProbeRig], events: Events, views: Mapping[str, Record],
    supervised: Sequence[Step],
) -> Iterator[Step]:  # fmt: skip
    """Yield the steps between contact and the commands' limits: surfaces, forces, supervision, other modalities.

    What modalities say of the surfaces that they bring is taken over, and limited.
    """
    carried = [(rig, one) for rig in rigs if rig.table is not None and (one := model.carrier_to(rig.probe.name))]
    yield from (steps.look_below(rig) for rig, _ in carried)
    between = [*(steps.carried(rig, one, state, model) for rig, one in carried), *map(steps.force, rigs), *supervised]
    carriers = [one for _, one in carried]
    others = [one for one in model.modalities if one.surface_fields is None and one.contact_fields is None]
    if not carriers or not others:
        yield from _fenced(carriers, model, views, [WriteGuard(carriers, state)], " surfaces")
        yield from between
        if rigs:
            events.join(None, carriers)
            yield steps.tell(model, events, rigs, state)
        yield from _fenced(others, model, views, [WriteGuard(others, state)])
        return
    written = (name for step in between if step.bounds for name in step.written(state))  # Python's is seen otherwise
    fences = WriteGuards(carriers, others, written, state)
    around, everyone = [fences.near, fences.rest], [*others, *carriers]
    yield from _fenced(carriers, model, views, around, " surfaces", looks=[fences.near])
    yield from (steps.between(step, fences.rest, model, carriers) for step in between)
    if rigs:
        events.join(fences.rest, carriers)
        yield steps.tell(model, events, rigs, state)
    yield steps.fence([fences.later])
    yield from (steps.modality(model, one, views[one.name], [fences.later, fences.rest]) for one in others)
    yield steps.mend(model, [fences.later, fences.rest], everyone)


def _fenced(
    listed: Sequence[ModalityModel], model: Model, views: Mapping[str, Record], around: Sequence[WriteGuard],
    where: str = "", looks: Sequence[WriteGuard] | None = None,
) -> Iterator[Step]:  # fmt: skip
    """Yield modalities between the steps that remember and that restore all fields which are not theirs."""
    if listed:
        yield steps.fence(around, where)
        yield from (steps.modality(model, one, views[one.name], around) for one in listed)
        yield steps.mend(model, around, listed, where, looks)


def build(
    model: Model, state: Record, runners: Mapping[str, Runner], rigs: Sequence[ProbeRig], objects: Objects,
    events: Events, hold: HoldToRun, views: Mapping[str, Record], tracking: Counts,
) -> Plan:  # fmt: skip
    """Return the plan of a scene: read, contact, supervision, events, modalities, write; then the twins move on.

    The steps of supervision take their views before any modality can write.
    """
    listed: list[Step] = []
    for runner in runners.values():
        listed += [steps.read(runner.gate), steps.watch(runner.gate)]
    if model.moving:
        listed.append(steps.move_objects(model, objects))
    listed += _contacts(model, state, rigs, views)
    supervised = list(_supervision(model, state, runners, rigs, tracking))
    listed += _rendering(model, state, rigs, events, views, supervised)
    if hold.required:
        listed.append(steps.hold(hold, runners.values()))
    for runner in runners.values():
        if runner.model.commands:
            listed.append(steps.guard(runner.gate))
        if not runner.model.twin:
            listed.append(steps.write(runner.gate))
    for rig in rigs:
        listed += steps.finger(rig, state)
        listed += [steps.worn(rig, rig.skin)] if rig.skin is not None else []
    if model.motions.bodies is not None:
        listed.append(steps.bodies(objects))
    listed += [steps.twin(runner) for runner in runners.values() if runner.model.twin]
    listed += [steps.log(rig) for rig in rigs]
    return Plan(listed, state)


@kernel
def advance(
    chain: int, most: Any, tick: Any, ready: Any, sampled: int, stamps: Any, told: Any, counts: Any, greatest: Any,
    left: Any, listener: Any,
) -> int:  # fmt: skip
    """Run a plan's only chain, count the tick, record how long it took, and go on; scalars have shape (1,).

    Parameters
    ----------
    chain
        Address of what describes the chain (`Chain.place`).
    most
        How many ticks are run at most.
    tick, ready
        Fields of State: the number of the tick, and whether the rig is calibrated; until it is, one tick is run, after
        which Python looks whether it has become so, and tells the listener.
    sampled
        One tick in this many is left to Python, which times its parts.
    stamps
        Host time [s], the first entry at the start of the tick and the last at its end; written.
    told, counts, greatest
        The number of ticks timed, their histograms, and the greatest times; written.
    left
        Where the plan has stopped, index and code as of `run_chain`, if a step or the listener has left something to
        Python; written.
    listener
        Address of what describes the chain that follows each tick (`CompiledListener.place`), 0: there is none.

    Returns
    -------
    int
        0: the ticks are done; else PYTHON or STOPPED, and ``tick`` is the one that is left; or TOLD, and the tick
        before that one is done but for what its listener leaves to Python.
    """
    last, end = len(stamps) - 1, 0.0
    for k in range(most[0]):
        if tick[0] % sampled == 0:
            return PYTHON
        begin = host_time(chain) if k == 0 else end  # ticks follow each other
        stamps[0] = begin
        found = run_chain(chain, 0)
        if found >= 0:
            left[0] = found
            return STOPPED
        tick[0] += 1
        end = host_time(chain)
        stamps[last] = end
        told[0] += 1
        count(counts, greatest, 1, end - begin)
        if ready[0] == 0:
            break
        if listener[0] != 0:
            found = run_chain(listener[0], 0)
            if found >= 0:
                left[0] = found
                return TOLD
    return 0
