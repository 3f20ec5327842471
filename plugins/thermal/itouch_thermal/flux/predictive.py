"""The controller `model` in a scene: its law fed with what is read, and the desired flux of the time to come."""

from __future__ import annotations

import math

from itouch.plugin import Field, Record
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.preview import Preview, look_ahead, run_ahead
from itouch_thermal.flux.published import readiness
from itouch_thermal.flux.setting import FluxModel
from itouch_thermal.laws import press_factor
from itouch_thermal.solver.live import state_size

#: Force [N] on the plate that means a finger.
TOUCHED = 0.03
#: How far the contact resistance that the force explains may be from the expected one, as a multiple of it.
SCALE = (0.02, 50.0)
#: Steps of the preview that are computed anew in a tick while the resistance changes.
STRIDE = 16


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
        Field("reached", "i8"),
    )


def control(
    model: FluxModel, law: ModelLaw, course: Preview, state: Record, touching: bool, period: float
) -> tuple[float, float]:
    """Return current [A] and pumped flux [W/m2]; slower than the servo, the periods between are caught up with."""
    names = model.names
    hold = max(1, round(period / model.period))
    pressed = _pressed(model, state)
    ticks = state[names.ticks].item() if touching else 0
    scale = _scale(model, state, ticks) if touching else 1.0
    _take(model, law, state, touching and not pressed, hold, scale)
    if pressed and not state[names.on_plate].item():
        law.disturb(state)
    if touching:
        if ticks == 0:
            _begin(model, law, course, state)
        else:
            _continue(model, law, course, state, ticks, hold)
        state[names.ticks] = ticks + hold
        if pressed and not state[names.on_plate].item():
            law.begin(state, state[names.flux].item(), scale)
            state[names.on_plate] = 1
        if state[names.on_plate].item():
            look_ahead(state[names.future], ticks, law.offsets, state[names.desired].item(), state[names.wanted])
            return law.follow(state, _scale(model, state, ticks + law.delay), hold)
    current, flux, error = law.approach(state, state[names.start_temperature].item(), hold)
    state[names.readiness] = readiness(error)
    return current, flux


def _take(model: FluxModel, law: ModelLaw, state: Record, hovering: bool, hold: int, scale: float) -> None:
    """Let the law take in what was sent and read; what is old or unclear it does not see."""
    names = model.names
    flux, plate = state[names.heat_flux].item(), state[names.plate_temperature].item()
    sink, sent = state[names.sink].item(), state[names.sent].item()
    for _ in range(hold - 1):
        law.track(state, sent, math.nan, math.nan, math.nan, scale)
    if state[names.age].item() or hovering:
        law.track(state, sent, math.nan, math.nan, math.nan, scale)
    else:
        law.track(state, sent, flux, plate, sink, scale)


def _pressed(model: FluxModel, state: Record) -> bool:
    """Tell whether the finger is on the plate: by the measured force, else as the virtual contact says."""
    if model.force_from:
        return bool(abs(state[model.force_from][2].item()) > TOUCHED)
    return math.isfinite(state[model.names.resistance].item())


def _scale(model: FluxModel, state: Record, ticks: int) -> float:
    """Return the contact resistance that the measured force explains, as a multiple of the expected one.

    ``ticks`` is when: servo periods since the touch began.
    """
    if model.steady:
        return 1.0
    sensor = model.force_from
    force = abs(state[sensor][2].item()) if sensor else state[model.names.normal_force].item()
    found = model.resistance.at(force) / model.expected * press_factor((ticks + 1) * model.period, model.press)
    return min(SCALE[1], max(SCALE[0], found))


def _begin(model: FluxModel, law: ModelLaw, course: Preview, state: Record) -> None:
    """Copy the model finger and object as they are after their first step, and run them ahead."""
    names, heat = model.names, model.params.desired_from
    index = state[f"{heat}.object"].item()
    if course.bodies[index] is None:
        return
    finger = state[f"{heat}.finger"]
    state[names.preview_index] = index
    _restart(model, course, state, 0, law.ahead)
    law.place(state, course.into @ finger[: course.into.shape[1]])


def _restart(model: FluxModel, course: Preview, state: Record, ticks: int, count: int) -> None:
    """Run ahead from the model finger and object as they are after step ``ticks`` of the touch."""
    names, heat = model.names, model.params.desired_from
    index = state[names.preview_index].item()
    state[names.preview_finger][:] = state[f"{heat}.finger"]
    below = state[names.preview_object]
    below[:] = state[f"{heat}.objects"][index][: len(below)]
    future = state[names.future]
    future[ticks % len(future)] = state[names.desired].item()
    state[names.reached] = ticks
    _advance(model, course, state, count)


def _advance(model: FluxModel, course: Preview, state: Record, count: int) -> None:
    """Run ahead by so many steps more."""
    names, body = model.names, course.bodies[state[model.names.preview_index].item()]
    resistance = _coming(model, course, state)
    if body is None or not math.isfinite(resistance):
        return
    reached = state[names.reached].item()
    run_ahead(
        course.finger, state[names.preview_finger], body, state[names.preview_object], resistance,
        model.press / model.period, state[names.future], reached + 1, count,
    )  # fmt: skip
    state[names.reached] = reached + count


def _coming(model: FluxModel, course: Preview, state: Record) -> float:
    """Return the resistance, but for the press, that the virtual contact is thought to keep."""
    if model.steady:
        return course.resistance
    return model.resistance.at(state[model.names.normal_force].item())


def _continue(model: FluxModel, law: ModelLaw, course: Preview, state: Record, ticks: int, hold: int) -> None:
    """Keep the preview a horizon ahead; while the resistance changes, begin it anew again and again."""
    reached = state[model.names.reached].item()
    wanted = ticks + law.ahead
    if model.steady or course.bodies[state[model.names.preview_index].item()] is None:
        _advance(model, course, state, wanted - reached)
    elif reached >= wanted - hold or reached < ticks:
        _restart(model, course, state, ticks, min(law.ahead, STRIDE * hold))
    else:
        _advance(model, course, state, min(wanted - reached, STRIDE * hold))
