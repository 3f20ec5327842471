"""The plan of a tick: its steps in order, built once from the scene, run one after the other, each of them timed.

This is the whole of a tick.  Who wants to know what happens in which order reads ``build``, or asks
``itouch-py inspect SCENE --plan``.  Safety's steps stand behind each read and before each write because the plan is
built so; nothing that a plugin declares can move them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from itouch.loop import steps
from itouch.loop.clock import now
from itouch.loop.events import Events
from itouch.loop.fence import Fence
from itouch.loop.objects import Objects
from itouch.loop.rig import ProbeRig
from itouch.loop.runner import Runner
from itouch.loop.step import Step, Work
from itouch.plugin import Record
from itouch.safety import Hold
from itouch.schema import ItouchError
from itouch.world import Model


class PlanError(ItouchError):
    """Steps that can't stand in one plan."""


class Plan:
    """The steps of a tick."""

    def __init__(self, listed: Sequence[Step], fields: Iterable[str]) -> None:
        names = tuple(fields)
        self.steps = tuple(step.fitted(names) for step in listed)
        self.names = tuple(step.name for step in self.steps)
        #: Each command, and what is sent of it, with the one step that writes it.
        self.writers = dict(_writers(self.steps, [f for f in names if ".command." in f or ".sent." in f]))
        self._works = tuple(step.work for step in self.steps)

    def run(self, tick: int, ready: bool) -> None:
        """Run all steps of a tick; ``ready``: the rig is calibrated, and scripts go on."""
        for work in self._works:
            work(tick, ready)

    def run_timed(self, tick: int, ready: bool, stamps: list[float]) -> None:
        """Run all steps of a tick, and append the host time [s] after each."""
        mark = stamps.append
        for work in self._works:
            work(tick, ready)
            mark(now())


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


def build(
    model: Model, state: Record, runners: Mapping[str, Runner], rigs: Sequence[ProbeRig], objects: Objects,
    events: Events, hold: Hold, move: Work, views: Mapping[str, Record],
) -> Plan:  # fmt: skip
    """Return the plan of a scene: read, contact, events, modalities, supervision, write; then the twins move on."""
    listed: list[Step] = []
    for runner in runners.values():
        listed += [steps.read(runner), steps.watch(runner)]
    if model.moving:
        listed.append(steps.move_objects(model, objects))
    listed += [steps.contact(rig, model) for rig in rigs]
    listed += [steps.surface(rig) for rig in rigs if rig.table is not None]
    listed += [steps.force(rig) for rig in rigs]
    if rigs:
        listed.append(steps.tell(model, events, rigs))
    if model.modalities:
        around = Fence(model.modalities, state)
        listed.append(steps.fence(model, around))
        listed += [steps.modality(model, one, views[one.name], runners, around) for one in model.modalities]
        listed.append(steps.mend(model, around))
    listed += [steps.supervise(rig) for rig in rigs if rig.arm is not None or rig.table is not None]
    if hold.required:
        listed.append(steps.hold(hold))
    for runner in runners.values():
        if runner.model.commands:
            listed.append(steps.guard(runner))
        if not runner.model.twin:
            listed.append(steps.write(runner))
    listed.append(steps.twins(model, runners, rigs, move))
    return Plan(listed, state)
