"""Warm-up before the first tick: twins, modalities and monitors go through a touch on a scratch copy of State.

So no tick has to compile anything or load it from disk: a compiled function's first call costs milliseconds.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Mapping

from itouch.loop.contact_report import of_contact
from itouch.loop.device_runner import Runner
from itouch.loop.run_statistics import Histogram
from itouch.loop.write_access import WriteGuard, view_for
from itouch.plugin import Contact, ContactEvent, DeviceError, Record, Role, TwinInputs
from itouch.safety import check_warm_up
from itouch.schema import Problem, SceneError
from itouch.schema.plugin_errors import failing
from itouch.world import Model


def warm_up(model: Model, state: Record, runners: Iterable[Runner]) -> None:
    """Exercise every twin, every modality and the monitors of every device; ``state`` is not changed."""
    scratch = state.copy()
    _rehearse_touches(model, scratch)
    Histogram(1.0).add(0.0)
    for runner in runners:
        warm_up_twin(runner, scratch, model.period)
        check_warm_up.warm_up(runner.model, scratch, model.period)


def reset_modalities(model: Model, state: Record) -> None:
    """Set the fields of all modalities to their start."""
    for modality in model.modalities:
        with failing(f"modality '{modality.name}'", "reset", model.place_of(modality.name)):
            modality.instance.reset(modality.model, view_for(modality, state))


def _update(model: Model, views: Mapping[str, Record]) -> None:
    for modality in model.modalities:
        with failing(f"modality '{modality.name}'", "update", model.place_of(modality.name)):
            modality.instance.update(modality.model, views[modality.name], model.period * modality.every)


def _rehearse_touches(model: Model, scratch: Record) -> None:
    """Take all modalities together through approach, touch and release of the first and the last object."""
    views = {modality.name: view_for(modality, scratch) for modality in model.modalities}
    _update(model, views)
    scratch["ready"] = 1  # the rig is calibrated from here on
    for probe in model.probes:
        for index in sorted({0, len(model.objects) - 1}) if model.objects else ():
            for kind in (Contact.NEAR, Contact.BEGIN, Contact.MOVE, Contact.END):
                scratch[f"{probe.name}.near_object"] = index
                _pretend(model, scratch, probe.name, index if kind in (Contact.BEGIN, Contact.MOVE) else -1)
                _pretend_beside(model, scratch, probe.name, index if kind is Contact.MOVE else -1)
                _rehearse_event(model, scratch, views, _event(model, kind, probe.name, index))


def _rehearse_event(model: Model, scratch: Record, views: Mapping[str, Record], event: ContactEvent) -> None:
    for modality in model.modalities:
        with failing(f"modality '{modality.name}'", "on_contact", model.place_of(modality.name)):
            if event.kind in modality.instance.subscribes_to:
                around = WriteGuard([modality], scratch)
                modality.instance.on_contact(event, modality.model, views[modality.name])
                around.mend()
    for _ in range(2):
        _update(model, views)
    _read_anew(model, scratch, views)
    for modality in model.modalities:
        with failing(f"modality '{modality.name}'", "measures", model.place_of(modality.name)):
            told = of_contact(modality, views[modality.name], event.probe, event.object_index)
        if told.faults:  # sooner than in the report of a whole run
            place, advice = model.place_of(modality.name), "report it to the plugin's author"
            raise SceneError(
                [Problem("plugin-failed", f"modality '{modality.name}': {one}", place, advice) for one in told.faults]
            )


def _read_anew(model: Model, scratch: Record, views: Mapping[str, Record]) -> None:
    """Pretend that every device has a new reading between two updates, measured a tick before."""
    scratch["tick"] += 1
    for name in model.devices:
        scratch[f"{name}.sequence"] += 1
        scratch[f"{name}.measured"] = scratch["tick"].item() - 1
    for modality in model.modalities:
        with failing(f"modality '{modality.name}'", "on_intermediate_tick", model.place_of(modality.name)):
            if modality.uses_intermediate_ticks:
                modality.instance.on_intermediate_tick(modality.model, views[modality.name])
    _update(model, views)


def _pretend(model: Model, scratch: Record, probe: str, index: int) -> None:
    """Write what contact search and force sensors would give in a touch, or without one (``index`` -1)."""
    touching = index >= 0
    scratch[f"{probe}.object"] = index
    scratch[f"{probe}.contact.object"] = index
    scratch[f"{probe}.plate"] = touching
    scratch[f"{probe}.normal_force"] = scratch[f"{probe}.felt_force"] = 1.0 if touching else 0.0
    for device in model.devices.values():
        if felt := device.field(Role.CONTACT_FORCE):
            scratch[felt][2] = -1.0 if touching else 0.0


def _pretend_beside(model: Model, scratch: Record, probe: str, index: int) -> None:
    """Write that another object begins where this one is touched; -1: none does."""
    count = len(model.objects)
    lies = index >= 0 and count > 1
    scratch[f"{probe}.beside"] = (index + 1) % count if lies else -1
    scratch[f"{probe}.beside_distance"] = 0.0 if lies else math.inf


def _event(model: Model, kind: Contact, probe: str, index: int) -> ContactEvent:
    up = (0.0, 0.0, 1.0)
    still = (0.0, 0.0, 0.0)
    return ContactEvent(kind, 0, probe, model.objects[index], index, still, up, 0.0, 0.0, still, 1e-4, 1.0, 0.0)


def warm_up_twin(runner: Runner, scratch: Record, period: float) -> None:
    """Step a twin untouched and pressed, and read it."""
    if runner.gate.twin is None:
        return
    name = runner.model.name
    fields = runner.gate.twin_state.dtype.names or ()
    state = scratch.part(f"{name}.twin.", fields) if fields else runner.gate.twin_state.copy()
    sent, reading = runner.sent.copy(), runner.reading.copy()
    who, place = f"device '{name}'", runner.model.place
    for touch in (TwinInputs(), TwinInputs(force=1.0, gap=-1e-3)):
        with failing(who, "the step of its twin", place):
            runner.gate.twin.step(state, sent, touch, period)
        with failing(who, "the reading of its twin", place), contextlib.suppress(DeviceError):
            runner.gate.twin.read(state, reading)  # a DeviceError: a fault that is injected from the start
