"""The steps of a tick, each declared: what it calls, and which fields of State it reads and writes.

Views of fields are taken once, when an engine is built.  ``inspect --plan`` shows what is declared here, and a test
compares it with what each step is seen to change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from itouch.contact.stated_contact import GREATEST, NO_SUCH_OBJECT, NOT_A_NORMAL, NOT_A_RESULT
from itouch.joining import is_newest
from itouch.loop import builtins_guard, probe_steps
from itouch.loop.device_runner import Runner
from itouch.loop.events import Events
from itouch.loop.fault_attribution import foreign_write, modality_fault, with_replaced
from itouch.loop.moving_objects import Objects
from itouch.loop.probe_rig import ProbeRig
from itouch.loop.run_statistics import Counts
from itouch.loop.supervision_steps import bound_supervision, bound_together
from itouch.loop.tick_step import CALLS_KERNELS, PYTHON, Answer, Step, joinable
from itouch.loop.touchoff import DONE
from itouch.loop.write_access import WriteGuard, mended, shown_fields
from itouch.plugin import Bound, Record, Role
from itouch.plugin.bound import bound_by
from itouch.safety import Finger, Gate, HoldToRun
from itouch.safety.monitor_step import LOOK, TOLD
from itouch.schema.plugin_errors import failing
from itouch.twin.skin_under_devices import Skin
from itouch.world import DeviceModel, ModalityModel, Model
from itouch.world.class_queries import texts_of

#: Fields of a device that a trip changes, besides what is sent to it.
_TRIPPED = ("status", "trip", "tripped", "ramp")

#: Fields of a surface's memory that follow from what its modality says; see ``itouch.loop.surface.surface_memory``.
_TAKEN_OVER = (
    "renders", "present", "settled", "clear", "pressed", "felt", "felt_weight", "missed", "misses", "missed_at",
    "missed_depth", "missed_load", "changing", "lingers", "lets_go", "lingered", "lingered_at", "rises",
)  # fmt: skip


def _of(name: str, *fields: str) -> tuple[str, ...]:
    return tuple(f"{name}.{field}" for field in fields)


def _roles(runner: Runner | None, *roles: Role, kind: str = "") -> tuple[str, ...]:
    """Return the fields of a device's readings of these roles; ``kind`` "command" or "sent": of its commands."""
    return () if runner is None else tuple(f for role in roles if (f := runner.model.field(role, kind)))


def _readings(model: DeviceModel) -> tuple[str, ...]:
    return _of(model.name, *(channel.name for channel in model.reads))


def _watched(model: DeviceModel) -> tuple[str, ...]:
    """Return the State of the monitors that look at every reading, or when their time has come."""
    names = [monitor.name for monitor in model.monitors if not monitor.needs_finger_position]
    return ("heard", *(f"{name}.*" for name in names))


def read(gate: Gate) -> Step:
    """Take the newest reading of a device or its twin."""
    name = gate.model.name
    written = (
        *_readings(gate.model),
        *_of(name, "age", "measured", "left", "gone", "goings", "out.*", "twin.*", "watchdog.*", *_TRIPPED),
    )
    reads, bounds = _of(name, "status", "twin.*"), gate.acquisition.bound_take()
    if bounds:
        answer: Answer = lambda code, tick, ready: gate.acquisition.take(tick)  # noqa: E731
        return joinable(f"read {name}", bounds, reads, written, answer, gate.acquisition.not_taken)
    return Step(f"read {name}", lambda tick, ready: gate.acquisition.take(tick), reads, written)


def watch(gate: Gate) -> Step:
    """Check the reading that was taken; one that is not believed is passed on to nobody."""
    name = gate.model.name
    written = (*_readings(gate.model), *_of(name, "age", "sequence", *_watched(gate.model), *_TRIPPED))
    reads = (*_readings(gate.model), *_of(name, "status", "age", "sent.*", "touched", "felt", *_watched(gate.model)))
    bounds = gate.acquisition.bound_watch()
    if not bounds:
        return Step(f"watch {name}", lambda tick, ready: gate.acquisition.watch(tick), reads, written)

    def answer(code: int, tick: int, ready: bool) -> None:
        if code >= TOLD:
            gate.acquisition.told(code - TOLD, tick)
        elif code == LOOK:
            gate.acquisition.look(tick)
        else:
            gate.acquisition.watch(tick)

    return joinable(f"watch {name}", bounds, reads, written, answer)


def move_objects(model: Model, objects: Objects) -> Step:
    """Move the objects that have a script or are carried."""
    written = ("objects.pose", "objects.twist", "objects.ticks")
    carriers = {carried.device for carried in model.motions.carried}
    poses = (model.devices[name].field(Role.TRACKED_POSE) for name in carriers)
    return Step("move objects", objects.update, (*written, *poses), written, 1, CALLS_KERNELS)


#: What is found of a probe's contact; the search for it also remembers.
_FOUND = (
    "proxy", "force", "normal", "point", "penetration", "normal_force", "near_distance", "time_to_contact",
    "contact_force", "effect_force", "area", "result", "effects", "object", "beside", "beside_distance",
)  # fmt: skip


def _followed(rig: ProbeRig) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what following the tracker, and adapting the coupling to how late it is, reads and what it writes."""
    frames = tuple(f"{one.model.name}.frame" for one in (rig.tracker, rig.arm, rig.table) if one is not None)
    written = (*_of(rig.probe.name, "hip", "velocity", "coupling.*"), *frames)
    return (*_roles(rig.tracker, Role.TRACKED_POSE), "*.calibration", *written), written


def _found(rig: ProbeRig, *more: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what finding the contact reads and what it writes, ``more`` of the probe's fields included."""
    written = _of(rig.probe.name, *_FOUND, *more, *(("felt_force",) if rig.table is None else ()))
    return ("objects.pose", "objects.twist", *written), written


def follow(rig: ProbeRig) -> Step:
    """Take the tracker's position as the finger's, before a modality computes the contact."""
    reads, written = _followed(rig)
    name, work = f"follow {rig.probe.name}", rig.follow
    return joinable(name, rig.bound_follow, reads, written, lambda code, tick, ready: work(tick, ready))


def contact(rig: ProbeRig, model: Model) -> Step:
    """Take the tracker's position as the finger's, and find what it touches."""
    (here, placed), (there, found) = _followed(rig), _found(rig, "memory")
    name, work = f"contact {rig.probe.name}", rig.contact
    reads, written = (*here, *there), (*placed, *found)
    return joinable(name, rig.bound_contact, reads, written, lambda code, tick, ready: work(tick, ready))


def given_contact(rig: ProbeRig, model: Model, one: ModalityModel) -> Step:
    """Take over what a modality says of the contact that it has computed."""
    said = () if one.contact_fields is None else _of(one.name, *one.contact_fields.declared)
    reads, written = _found(rig)

    def answer(code: int, tick: int, ready: bool) -> None:
        raise modality_fault(model, one.instance, "update", tick, ValueError(_wrong(code, one, model)))

    reads += (*_of(rig.probe.name, "hip", "velocity"), *said)
    return joinable(f"contact {rig.probe.name}", rig.contact_step.finds, reads, written, answer)


def _wrong(code: int, one: ModalityModel, model: Model) -> str:
    """Return what is wrong with what a modality says of its contact, by the code of `itouch.contact.stated_contact`."""
    touches = one.contact_fields
    if touches is None:
        return ""
    if code == NO_SUCH_OBJECT:
        where, last = f"{one.name}.{touches.object or touches.found}", len(model.objects) - 1
        return f"'{where}' names an object that is not there: -1 is none, the last one is {last}"
    if code == NOT_A_NORMAL:
        return f"the normal in '{one.name}.{touches.normal or touches.found}' must have the length 1"
    if code == NOT_A_RESULT:
        return f"'{one.name}.{touches.found}' has a number of contacts, a share or a distance that no contact can have"
    return f"one of {', '.join(_of(one.name, *touches.declared))} is not a finite number, or beyond {GREATEST:g}"


def look_below(rig: ProbeRig) -> Step:
    """Find the virtual surface below the finger, for the modality that carries one to it."""
    name = rig.probe.name
    kept = (
        "upright", "climb", "level", "sink", "acceleration", "off", "goes_x", "goes_y", "lifts", "slope_x", "slope_y",
        "turns", "hastens",
    )  # fmt: skip
    estimated = (
        "variance", "heard", "read_last", "read_before", "depth", "heard_at", "averaged_at", "averaged", "loud",
        "borne", "unsure",
    )  # fmt: skip
    surface = tuple(f"{name}.surface.{field}" for field in (*kept, *estimated))
    written = (*_of(name, "surface_height", "below"), *surface)
    figures = _of(name, "hip", "velocity", "proxy", "normal", "penetration")
    reads = (*figures, "objects.pose", *_roles(rig.table, Role.TRACKED_POSE, Role.CONTACT_FORCE))
    reads += _of(rig.table.model.name, "measured") if rig.table is not None else ()
    return joinable(f"below {name}", rig.contact_step.looks, (*reads, *surface, *rig.contact_step.looked_at), written)


def carried(rig: ProbeRig, one: ModalityModel, state: Record, model: Model) -> Step:
    """Take over what a modality says of the surface that it carries; touch-off and T4 overrule it."""
    reads, writes, goal = _surface_fields(rig)
    said = () if one.surface_fields is None else _of(one.name, *one.surface_fields.declared)

    def answer(code: int, tick: int, ready: bool) -> None:
        for field in said:
            if np.isnan(state[field]).any():
                raise modality_fault(model, one.instance, "update", tick, ValueError(f"'{field}' is not a number"))
        rig.surface_left(code, tick, ready)

    name, bounds = f"surface {rig.probe.name}", rig.bound_surface()
    if bounds:
        return replace(joinable(name, bounds, (*reads, *said), writes, answer), amends=goal)
    work = lambda tick, ready: answer(0, tick, ready)  # noqa: E731
    return Step(name, work, (*reads, *said), writes, 1, CALLS_KERNELS, amends=goal)


def _surface_fields(rig: ProbeRig) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the fields that carrying a surface reads and those that it writes, and the command of the surface."""
    name, table = rig.probe.name, rig.table.model.name if rig.table is not None else ""
    figures = _of(name, "plate_gap", "plate_yield", "plate_top", "tracking", "plate", "felt_force")
    figures += tuple(f"{name}.surface.{field}" for field in _TAKEN_OVER)
    if rig.table is not None and rig.table.model.wire:
        figures += _of(name, "rising.*")
    reads = (*figures, *_of(name, "normal_force", "hip", "object", "contact.object"))
    reads += tuple(
        f"{name}.surface.{field}" for field in ("climb", "level", "sink", "acceleration", "off", "loud", "borne")
    )
    reads += (f"{name}.surface.averaged",)  # by touch-off
    reads += _of(table, "touch_off.*", "calibration", "surface.*")
    reads += _of(table, "measured") if rig.table is not None else ()
    reads += _roles(rig.table, Role.TRACKED_POSE, Role.CONTACT_FORCE)
    reads += _roles(rig.table, Role.SURFACE_POSE, kind="sent")
    written = (*figures, *_of(table, "touch_off.*", "calibration", "surface.withdrawn", "clamped"))
    goal = _roles(rig.table, Role.SURFACE_POSE, kind="command")
    return (*reads, "ready"), (*written, *_of(name, "hand.offset")), goal


def force(rig: ProbeRig) -> Step:
    """Command the force on the finger: all of it, or what no surface gives."""
    name = rig.probe.name
    reads = _of(name, "contact_force", "normal", "plate_gap", "plate", "velocity", "object", "surface.*")
    reads += _of(name, "hip", "plate_top")
    reads += (*_roles(rig.table, Role.CONTACT_FORCE), *rig.contact_step.newer)
    reads += _roles(rig.arm, Role.FORCE_ON_OPERATOR, kind="sent")
    kept = ("share", "cut", "changing", "load", "wanted", "virtual", "stirs", "stirred")
    written = tuple(f"{name}.surface.{field}" for field in kept)
    written += _roles(rig.arm, Role.FORCE_ON_OPERATOR, kind="command")
    return joinable(f"force {name}", rig.contact_step.pushes, reads, written)


def tell(model: Model, events: Events, rigs: Sequence[ProbeRig], state: Record) -> Step:
    """Tell logs and modalities what contacts have begun and ended; it looks itself at the fence that it is in."""
    probes = [rig.probe.name for rig in rigs]
    noted = tuple(f"{name}.{field}" for name in probes for field in ("near_object", "contact.*"))
    heard = tuple(name for one in model.modalities if one.instance.subscribes_to for name in shown_fields(one, state))
    reads = tuple(f"{name}.*" for name in probes)
    return joinable(
        "events", events.bounds, (*reads, *heard, "objects.*"), (*noted, *heard, "events.*"),
        lambda code, tick, ready: events.answer(code, tick), events.fail,
    )  # fmt: skip


def modality(model: Model, one: ModalityModel, state: Record, around: Sequence[WriteGuard]) -> Step:
    """Update a modality, or in a tick without an update call its ``on_intermediate_tick``; errors are faults."""
    update, compiled, every, period = one.instance.update, one.model, one.every, model.period * one.every

    def run(tick: int, ready: bool) -> None:
        method = "update"
        try:
            if tick % every == 0:
                update(compiled, state, period)
            elif one.uses_intermediate_ticks:
                method = "on_intermediate_tick"
                one.instance.on_intermediate_tick(compiled, state)
        except KeyboardInterrupt as interrupted:  # Ctrl-C; whoever it was, it is told where it came
            interrupted.add_note(f"in {method} of modality '{one.name}'")
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            fail(method, error, tick)

    def fail(method: str, error: BaseException, tick: int) -> NoReturn:
        replaced = builtins_guard.put_back()  # first: all else needs it
        mended(around)
        raise with_replaced(modality_fault(model, one.instance, method, tick, error), replaced) from error

    commands = tuple(".command.".join(command.split(".", 1)) for command in one.commands)
    own = (*shown_fields(one, state), *commands)
    with failing(f"modality '{one.name}'", "reads", model.place_of(one.name)):
        reads = _reads(one)
    calls: tuple[Bound, ...] = ()
    if (every == 1 or not one.uses_intermediate_ticks) and _joins(one):
        with failing(f"modality '{one.name}'", "bound_update", model.place_of(one.name)):
            calls = bound_by(one.instance.bound_update, compiled, state, period, several=True)
    if calls:
        bounds = calls if every == 1 else (Bound(probe_steps.turn, state["tick"], every), *calls)
        joined = joinable(
            one.name, bounds, reads, own, lambda code, tick, ready: run(tick, ready),
            lambda error, which, tick: fail("update", error, tick),
        )  # fmt: skip
        return replace(joined, every=every)
    if every > 1 and not one.uses_intermediate_ticks:  # between its updates Python has nothing to do
        due = Bound(probe_steps.due, state["tick"], every)
        work = lambda code, tick, ready: run(tick, ready)  # noqa: E731
        return replace(joinable(one.name, due, reads, own, work), every=every, code=PYTHON)
    return Step(one.name, run, reads, own, 1 if one.uses_intermediate_ticks else every)


def _reads(one: ModalityModel) -> tuple[str, ...] | None:
    """Return the fields that a modality says it reads; None: it does not say.

    Raises
    ------
    ReturnedError
        If it says anything else.
    """
    method = one.instance.reads
    told = method(one.model)
    wanted = "a tuple of texts such as 'device.channel' is wanted, or None"
    return None if told is None else texts_of(method, told, wanted)


def _joins(one: ModalityModel) -> bool:
    """Tell whether the compiled update is the one in force: no subclass, nor this instance, has overridden it."""
    return "update" not in getattr(one.instance, "__dict__", {}) and is_newest(
        type(one.instance), "bound_update", "update"
    )


def fence(around: Sequence[WriteGuard], where: str = "") -> Step:
    """Remember the fields that modalities may not write: compiled code could write them, whatever view it was given."""
    return joinable(f"fence{where}", [one.keep for one in around], ("*",), ())


def mend(
    model: Model, around: Sequence[WriteGuard], listed: Sequence[ModalityModel], where: str = "",
    looks: Sequence[WriteGuard] | None = None,
) -> Step:  # fmt: skip
    """Put back what these modalities may not write, before anything is checked or sent; such a write is a fault.

    ``looks``: which of the fences ``around`` them are checked; default: all.
    """

    def answer(code: int, tick: int, ready: bool) -> None:
        raise foreign_write(model, listed, mended(around), tick)

    bounds = [one.look for one in (around if looks is None else looks)]
    return joinable(f"mend{where}", bounds, ("*",), (), answer)


def between(step: Step, rest: WriteGuard, model: Model, listed: Sequence[ModalityModel]) -> Step:
    """Return a step of the framework that runs inside a fence: what it writes in Python is remembered anew.

    First it is checked whether one of the modalities ``listed`` has written inside the fence, which is a fault.
    """
    whole = step.answer if step.bounds else lambda code, tick, ready: step.work(tick, ready)
    if whole is None:
        return step

    def answer(code: int, tick: int, ready: bool) -> None:
        if changed := rest.mend():
            raise foreign_write(model, listed, changed, tick)
        whole(code, tick, ready)
        rest.take()

    if step.bounds:
        joined = joinable(step.name, step.bounds, step.reads, step.writes, answer, step.failed)
        return replace(joined, every=step.every, code=step.code, amends=step.amends)
    return replace(step, work=lambda tick, ready: answer(0, tick, ready))


def supervise(
    runner: Runner, rigs: Sequence[ProbeRig], carried: Sequence[Runner], state: Record, tracking: Counts
) -> Step:  # fmt: skip
    """Run those monitors of a device that need to know where the finger is."""
    name = runner.model.name
    present = [rig.present for rig in rigs]

    def run(tick: int, ready: bool) -> None:
        if runner.latch.enabled:
            for tell in present:
                tell(runner, ready)
            runner.gate.acquisition.watch_placed(tick)
            show()

    def show() -> None:
        for one in carried:
            one.gate.device_monitors.touch(runner.gate.device_monitors.touched, runner.gate.device_monitors.force)

    reads = (*_readings(runner.model), *_of(name, "sent.*", "status", "arm.*", "surface.*"))
    for rig in rigs:
        reads += _of(rig.probe.name, "velocity", "tracking", "hip", "plate_top")
    written = _of(name, "arm.*", "surface.*", "touched", "felt")
    for one in carried:
        written += _of(one.model.name, "touched", "felt")

    def answer(code: int, tick: int, ready: bool) -> None:
        if code != TOLD:
            run(tick, ready)
        elif (post := runner.gate.device_monitors.surface) is not None:
            runner.gate.device_monitors.told_at(post, tick)
            show()

    bounds = bound_supervision(runner, rigs[0], carried, state, tracking) if len(rigs) == 1 else ()
    if bounds:
        return joinable(f"supervise {name}", bounds, reads, written, answer)
    return Step(f"supervise {name}", run, reads, written)


def share(
    finger: Finger, devices: Sequence[Runner], rigs: Sequence[ProbeRig], state: Record, period: float
) -> Step:  # fmt: skip
    """Limit the sum of what acts on one finger; ``rigs``: the probes, of which some may be on it."""
    names = [runner.model.name for runner in devices]
    reads = tuple(
        f"{name}.{field}" for name in names for field in ("heat*", "sent.*", "touched", "status", "surface.*")
    )
    reads += ("*.hip", "*.velocity", "*.plate_top")
    reads += tuple(f"*.surface.{field}" for field in ("sink", "loud", "borne", "unsure"))
    reads += tuple(field for rig in rigs if rig.table in devices for field in rig.contact_step.newer)
    written = tuple(f"{name}.surface.*" for name in names)
    bound = bound_together(finger, state, period)
    if bound is not None:
        return joinable(f"together {finger.name}", bound, reads, written, lambda code, tick, ready: finger.told(tick))
    return Step(f"together {finger.name}", lambda tick, ready: finger.check(tick), reads, written)


def hold(switch: HoldToRun, runners: Iterable[Runner]) -> Step:
    """Stop the devices that act if nobody holds the dead-man's switch."""
    switches = [field for runner in runners for field in _roles(runner, Role.DEADMAN)]
    return Step("hold", lambda tick, ready: switch.check(tick), ("hold", *switches, "*.status"))


def guard(gate: Gate) -> Step:
    """Limit the commands of a device."""
    name = gate.model.name
    reads = _of(
        name,
        "command.*",
        "sent.*",
        "status",
        "ramp",
        "stopped",
        *(f"{one.name}.share" for one in gate.model.monitors),
    )
    written = _of(name, "sent.*", "clamped", "dropped", *_TRIPPED)
    bounds = gate.actuation.bound_guard()
    if bounds:
        return joinable(f"guard {name}", bounds, reads, written, lambda code, tick, ready: gate.actuation.guard(tick))
    return Step(f"guard {name}", lambda tick, ready: gate.actuation.guard(tick), reads, written)


def write(gate: Gate) -> Step:
    """Write to a device the commands that safety let through."""
    name = gate.model.name
    return Step(
        f"write {name}",
        lambda tick, ready: gate.actuation.send(tick),
        _of(name, "sent.*", "status"),
        _of(name, *_TRIPPED),
    )


def finger(rig: ProbeRig, state: Record) -> Iterator[Step]:
    """Move the operator's hand and finger on by a period, and tell the twins of devices what touches them."""
    name, coupling = rig.probe.name, rig.coupling
    if coupling.hand is not None:
        moved = _of(name, "hand.ticks", "hand.offset", "hand.steered", "hand.target_offset")
        along = coupling.hand.bound(state["ready"].reshape(1), rig.stage, DONE)
        reads = (*moved, "ready", f"{rig.table.model.name}.touch_off.stage" if rig.table is not None else "")
        if coupling.hand.waits is not None:
            moved += coupling.hand.waits.written
            reads += (*coupling.hand.waits.written, *coupling.hand.waits.reads)
        if along is None:
            yield Step(f"hand {name}", lambda tick, ready: rig.lead(ready), reads, moved)
        else:
            yield joinable(f"hand {name}", along, reads, moved, lambda code, tick, ready: rig.lead(ready))
    written = _of(name, "plate_force", "plate_true_top", "plate_distance", "plate_touched", "total_force", "hand.*")
    pushed = _roles(rig.arm, Role.FORCE_ON_OPERATOR, kind="sent")
    carried = _of(rig.table.model.name, "twin.*") if rig.table is not None else ()
    reads = (*written, *_of(name, "hip"), "tick", *pushed, *carried)
    yield joinable(f"finger {name}", coupling.bound, reads, written)
    if rig.feels_for_real:
        reads = (*_roles(rig.table, Role.CONTACT_FORCE), *pushed)
        yield Step(f"measured {name}", lambda tick, ready: rig.measure(), reads, _of(name, "total_force"))


def worn(rig: ProbeRig, skin: Skin) -> Step:
    """Warm and cool the skin by the devices worn on it, and tell their twins what presses on it."""
    name = rig.probe.name
    reads = _of(name, "total_force", "taken", "skin", "tissue")
    reads += _of(rig.touched_device.model.name, "twin.*") if rig.touched_device is not None else ()
    return joinable(f"worn {name}", skin.bound, reads, _of(name, "skin", "tissue"))


def bodies(objects: Objects) -> Step:
    """Move the rigid bodies on by a period."""
    written = ("objects.pose", "objects.twist", "objects.physics")
    reads = (*written, "*.contact_force", "*.result")
    return Step("bodies", lambda tick, ready: objects.advance(ready), reads, written, 1, CALLS_KERNELS)


def twin(runner: Runner) -> Step:
    """Move a device's twin on by a period, under what it was sent."""
    name, own = runner.model.name, _of(runner.model.name, "twin.*")
    bound, reads = runner.bound_twin(), (*own, *_of(name, "sent.*"))
    if runner.worn_by:
        own, reads = (*own, f"{runner.worn_by}.taken"), (*reads, f"{runner.worn_by}.skin")
    if bound is not None:
        bounds = (Bound(probe_steps.original, runner.gate.link.replaced), bound)
        answer: Answer = lambda code, tick, ready: runner.step_twin(tick)  # noqa: E731
        return joinable(f"twin {name}", bounds, reads, own, answer, runner.not_stepped)
    return Step(f"twin {name}", lambda tick, ready: runner.step_twin(tick), reads, own)


def log(rig: ProbeRig) -> Step:
    """Follow the open contact for the report."""
    name = rig.probe.name
    written = _of(name, "contact.peak_force", "contact.peak_penetration", "contact.peak_area", "contact.physical_begin")
    written += _of(name, "contact.plate", "contact.plate_ticks", "contact.plate_missed")
    reads = (
        *written,
        *_of(name, "surface.*", "plate_force"),
        *_of(name, "total_force", "penetration", "area", "plate", "plate_true_top", "surface_height"),
    )
    return joinable(f"log {name}", rig.log.note, reads, written)
