"""The controller `model` in a scene: its law fed with what is read, and the desired flux of the time to come."""

from __future__ import annotations

import math

from itouch.plugin import Field, Record
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.preview import Preview, look_ahead, run_ahead
from itouch_thermal.flux.published import readiness
from itouch_thermal.flux.setting import FluxModel
from itouch_thermal.solver.live import state_size

#: Force [N] on the plate that means a finger.
TOUCHED = 0.03


def memory(model: FluxModel) -> tuple[Field, ...]:
    """Return the State of `model`: its law and the contact that runs ahead; names without the modality's own."""
    if model.law is None or model.preview is None:
        return ()
    cut = len(model.name) + 1
    own = tuple(Field(field.name[cut:], field.dtype, field.size) for field in model.law.fields())
    size = state_size(model.preview.finger)
    return (
        *own,
        Field("preview_finger", "f8", size),
        Field("preview_object", "f8", model.preview.widest),
        Field("preview_index", "i8"),
    )


def control(
    model: FluxModel, law: ModelLaw, course: Preview, state: Record, touching: bool, period: float
) -> tuple[float, float]:
    """Return current [A] and pumped flux [W/m2]; slower than the servo, the periods between are caught up with."""
    names = model.names
    hold = max(1, round(period / model.period))
    pressed = _pressed(model, state)
    _take(model, law, state, touching and not pressed, hold)
    if pressed and not state[names.on_plate].item():
        law.disturb(state)
    if touching:
        ticks = state[names.ticks].item()
        if ticks == 0:
            _begin(model, law, course, state)
        else:
            _continue(model, law, course, state, ticks, hold)
        state[names.ticks] = ticks + hold
        if pressed and not state[names.on_plate].item():
            law.begin(state, state[names.flux].item())
            state[names.on_plate] = 1
        if state[names.on_plate].item():
            look_ahead(state[names.future], ticks, law.offsets, state[names.desired].item(), state[names.wanted])
            return law.follow(state, 1.0, hold)
    current, flux, error = law.approach(state, state[names.start_temperature].item(), hold)
    state[names.readiness] = readiness(error)
    return current, flux


def _take(model: FluxModel, law: ModelLaw, state: Record, hovering: bool, hold: int) -> None:
    """Let the law take in what was sent and read; what is old or unclear it does not see."""
    names = model.names
    flux, plate = state[names.heat_flux].item(), state[names.plate_temperature].item()
    sink, sent = state[names.sink].item(), state[names.sent].item()
    for _ in range(hold - 1):
        law.track(state, sent, math.nan, math.nan, math.nan)
    if state[names.age].item() or hovering:
        law.track(state, sent, math.nan, math.nan, math.nan)
    else:
        law.track(state, sent, flux, plate, sink)


def _pressed(model: FluxModel, state: Record) -> bool:
    """Tell whether the finger is on the plate: by the measured force, else as the virtual contact says."""
    if model.force_from:
        return bool(abs(state[model.force_from][2].item()) > TOUCHED)
    return math.isfinite(state[model.names.resistance].item())


def _begin(model: FluxModel, law: ModelLaw, course: Preview, state: Record) -> None:
    """Copy the model finger and object as they are after their first step, and run them ahead."""
    names, heat = model.names, model.params.desired_from
    index = state[f"{heat}.object"].item()
    body = course.bodies[index]
    if body is None:
        return
    finger = state[f"{heat}.finger"]
    above, below = state[names.preview_finger], state[names.preview_object]
    above[:] = finger
    below[:] = state[f"{heat}.objects"][index][: len(below)]
    state[names.preview_index] = index
    future = state[names.future]
    future[0] = state[names.desired].item()
    run_ahead(course.finger, above, body, below, course.resistance, future, 1, law.ahead)
    law.place(state, course.into @ finger[: course.into.shape[1]])


def _continue(model: FluxModel, law: ModelLaw, course: Preview, state: Record, ticks: int, hold: int) -> None:
    names = model.names
    body = course.bodies[state[names.preview_index].item()]
    if body is not None:
        above, below = state[names.preview_finger], state[names.preview_object]
        first = ticks - hold + law.ahead + 1
        run_ahead(course.finger, above, body, below, course.resistance, state[names.future], first, hold)
