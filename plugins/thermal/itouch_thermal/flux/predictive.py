"""The controller `model` in a scene: its law, fed with the readings and with the desired flux of the time to come."""

from __future__ import annotations

import math
from dataclasses import replace

from contact_heat.live import state_size
from itouch.plugin import Field, Record
from itouch_thermal.display.column import Array
from itouch_thermal.flux import approach, wires
from itouch_thermal.flux.law import PRIOR_ONSET, ModelLaw
from itouch_thermal.flux.observer import advance
from itouch_thermal.flux.onset import LATE, converted, grown_for
from itouch_thermal.flux.preview import Ahead, Preview, begin_ahead, first_steps, keep_ahead, look_ahead, rising
from itouch_thermal.flux.setting import FluxModel
from itouch_thermal.flux.usual import PRESS_FILTER, press_anew, press_on, scale_of

#: Behind a wire, how many servo periods ago at most the finger may have come when it is set down.
EARLY = 50
#: Measured force [N] below which the plate may be untouched.
UNFELT = 0.01


def memory(model: FluxModel) -> tuple[Field, ...]:
    """Return the State of `model`: its law and the contact that runs ahead; names without that of the modality."""
    if model.law is None or model.preview is None:
        return ()
    cut = len(model.name) + 1
    own = tuple(replace(field, name=field.name[cut:]) for field in model.law.fields())
    size = state_size(model.preview.finger)
    return (
        *own,
        Field("preview_finger", "f8", size, unit="K", doc="modes of the finger of the contact that runs ahead"),
        Field(
            "preview_object",
            "f8",
            model.preview.widest,
            unit="K",
            doc="modes of the object of the contact that runs ahead",
        ),
        Field(
            "preview_index",
            "i8",
            low=-1,
            high=len(model.curves) - 1,
            unit="1",
            doc="number of the object that runs ahead, -1: none",
        ),
        Field("reached", "i8", unit="tick", doc="up to which tick of the touch the contact that runs ahead has come"),
        Field("tracked", "i8", unit="tick", doc="up to when readings have been taken in"),
        Field("force_before", unit="N", doc="force on the plate in the update before", show="no"),
        Field("force_before_at", "i8", unit="tick", doc="when that was measured"),
        Field("came", "i8", unit="tick", doc="when the finger came to the plate, as the force tells"),
        Field("came_doubt", low=0.0, unit="s", doc="standard deviation of that, 0: it is not there", show="no"),
        Field("scale_before", unit="1", doc="factor on the contact resistance in the update before"),
        *wires.FIELDS,
    )


def control(
    model: FluxModel, law: ModelLaw, course: Preview, state: Record, touching: bool, tick: int
) -> tuple[float, float]:
    """Return current [A] and pumped flux [W/m2]; all servo periods since the last update are caught up with."""
    names = model.names
    pressed = approach.on_plate(model, state)
    if model.wire and model.force_from and not state[names.on_plate].item():
        _feel(model, state, pressed)
    ticks = tick - state[names.begun].item() if touching else 0
    scale = _scale(model, state, ticks) if touching and not model.steady else 1.0
    press = _press(model, state, scale) if touching and not model.steady else 0.0
    law.feel(state, _force(model, state) if touching else None)
    _take(model, law, state, touching and not pressed, tick, scale, press)
    if (pressed and not state[names.on_plate].item()) or (model.hold > 1 and not state["ready"].item()):
        law.disturb(state)
    if touching:
        if state[names.fresh].item():
            _begin(model, law, course, state, ticks)
        elif model.curves[state[names.object].item()] is None:
            _continue(model, law, course, state, ticks)
        if pressed and not state[names.on_plate].item():
            _set(model, law, state, scale)
        if state[names.on_plate].item():
            coming = wires.coming(model, state, tick)
            _want(model, law, state, ticks, coming.wait)
            if not model.steady:
                scale = _scale(model, state, ticks + law.delay + coming.wait)
            return law.follow(state, scale, model.hold, coming)
    if model.force_from and not model.wire:
        state[names.force_before] = abs(state[model.force_from][2].item())
    start, coming = state[names.start_temperature].item(), wires.coming(model, state, tick)
    current, flux, error = law.approach(state, start, coming)
    approach.judge(model, state, error, tick)
    return current, flux


def set_down(model: FluxModel, state: Record, tick: int) -> None:
    """Begin a touch between two updates, in the tick in which it began."""
    law, course = model.law, model.preview
    if law is None or course is None or not approach.on_plate(model, state):
        return
    scale = 1.0 if model.steady else _scale(model, state, 0)
    _pass(model, law, state, tick, scale)
    law.feel(state, _force(model, state))
    _place(model, law, course, state)
    _set(model, law, state, scale)


def _set(model: FluxModel, law: ModelLaw, state: Record, scale: float) -> None:
    """Set the finger down as of when, by the force, it came: a reading is a period old, and the force had to grow."""
    names = model.names
    ago, doubt = _late(model, state) if model.force_from else (0, PRIOR_ONSET)
    law.begin(state, state[names.flux].item(), scale, doubt)
    state[names.on_plate] = 1
    flowing = wires.flowing(law, state) if model.wire else state[names.sent].item()
    for _ in range(ago):
        advance(
            law.constants, law.fine.tissue, law.fine.plate, state[names.x], state[names.theta], state[names.memory],
            flowing, scale,
        )  # fmt: skip


def _late(model: FluxModel, state: Record) -> tuple[int, float]:
    """Return how many servo periods ago the finger came to the plate, and the standard deviation of that [s]."""
    names, tick = model.names, int(state["tick"].item())
    if model.hold > 1:  # it was not there when the touch began, else it would have been set down then
        return max(1, min(model.hold, tick - int(state[names.begun].item()))), PRIOR_ONSET
    if model.wire:
        return max(1, min(EARLY, tick - int(state[names.came].item()))), state[names.came_doubt].item()
    return grown_for(abs(state[model.force_from][2].item()), state[names.force_before].item()), PRIOR_ONSET


def _feel(model: FluxModel, state: Record, pressed: bool) -> None:
    """Behind a wire, note the last reading of the force without a finger, and by the first one with it, when it came.

    It came between the two readings or, if there was some force in the earlier one, where a line through both is zero.
    """
    names, (field, at) = model.names, model.force_at
    force, measured = abs(state[model.force_from][2].item()), int(state[field][at].item())
    if not pressed:
        state[names.force_before], state[names.force_before_at] = force, measured
        state[names.came_doubt] = 0.0
    elif not state[names.came_doubt].item():
        before = state[names.force_before].item()
        since = max(1, measured - int(state[names.force_before_at].item()))
        ago = 0.5 * (since + 1) if before < UNFELT else min(since + LATE, since * force / (force - before))
        state[names.came] = measured - int(ago + 0.5)
        state[names.came_doubt] = min(PRIOR_ONSET, 0.25 * (1 + since) * model.period)


def leave_out(model: FluxModel, state: Record, periods: int) -> None:
    """Add ``periods`` in which no tick was run to those that are caught up with in the next tick.

    Only then is it known which current has left in them.
    """
    state[model.names.tracked] -= periods
    if model.wire:
        wires.leave_out(model, state, periods)


def take_off(model: FluxModel, state: Record, tick: int) -> None:
    """End a touch, if need be between two updates."""
    if model.law is not None and state[model.names.on_plate].item():
        _pass(model, model.law, state, tick, 1.0)
        model.law.end(state)
        state[model.names.on_plate] = 0
        if model.wire:  # a finger that slides to another object is on the plate already when the next touch begins
            state[model.names.came], state[model.names.came_doubt] = tick, 0.5 * model.period


def _want(model: FluxModel, law: ModelLaw, state: Record, ticks: int, wait: int) -> None:
    """Fill in the plan's desired flux [W/m2], for a command that leaves in ``wait`` periods."""
    names, offsets = model.names, law.offsets + wait if wait else law.offsets
    curve = model.curves[state[names.object].item()]
    if curve is None:
        look_ahead(state[names.future], ticks, offsets, state[names.desired].item(), state[names.wanted])
    else:
        state[names.wanted] = curve.at((ticks + offsets + 1) * model.period)


def _pass(model: FluxModel, law: ModelLaw, state: Record, tick: int, scale: float, press: float = 0.0) -> None:
    """Let the periods before this one in which nothing was taken in pass without readings; too many are cut short."""
    names = model.names
    if model.wire:
        wires.pass_by(model, law, state, tick - 1, scale)
        return
    sent, passed = state[names.sent].item(), min(wires.MISSED, tick - 1 - state[names.tracked].item())
    for _ in range(passed):
        law.track(state, sent, math.nan, math.nan, math.nan, scale, press)
    state[names.tracked] = tick - 1


def _take(
    model: FluxModel, law: ModelLaw, state: Record, hovering: bool, tick: int, scale: float, press: float
) -> None:
    """Let the law take in what was sent and read, but no readings that are old or of a finger that hovers."""
    names = model.names
    if model.wire:
        wires.take(model, law, state, hovering, tick, scale, press)
        return
    if state[names.tracked].item() != tick - 1:
        _pass(model, law, state, tick, scale, press)
    if model.display.command == "temperature":
        _correct(model, law, state)
    sent = state[names.sent].item()
    if state[names.age].item() or hovering:
        law.track(state, sent, math.nan, math.nan, math.nan, scale, press)
    else:
        law.track(
            state, sent, state[names.heat_flux].item(), state[names.plate_temperature].item(),
            state[names.sink].item(), scale, press,
        )  # fmt: skip
    state[names.tracked] = tick


def _correct(model: FluxModel, law: ModelLaw, state: Record) -> None:
    """Replace the current that was asked of a temperature driver by the one that it reports."""
    if law.delay > 0 and model.names.actual:
        slot = int(state[f"{model.name}.slots"][0])
        state[f"{model.name}.line"][slot] = state[model.names.actual].item()


def _force(model: FluxModel, state: Record) -> float:
    """Return the force on the plate [N], measured or virtual."""
    sensor = model.force_from
    found: float = abs(state[sensor][2].item()) if sensor else state[model.names.normal_force].item()
    return found


def _scale(model: FluxModel, state: Record, ticks: int) -> float:
    """Return the contact resistance that the force explains, as a multiple of the expected one.

    ``ticks`` is the time for which it is asked, in servo periods since the touch began.
    """
    time = (ticks + 1) * model.period
    return scale_of(model.numbers, _force(model, state), model.expected, time, model.press)


def _press(model: FluxModel, state: Record, scale: float) -> float:
    """Return how strongly the finger is being pressed on: how fast the resistance that the force explains changes."""
    now, before = math.log(scale), state[model.names.scale_before].reshape(1)
    if state[model.names.fresh].item():  # a finger that has just come is being pressed on
        return press_anew(before, now)
    return press_on(before, now, part(model))


def part(model: FluxModel) -> float:
    """Return by what share the filter of a press approaches its input in an update; it lags by PRESS_FILTER [s]."""
    time = model.hold * model.period
    return time / (PRESS_FILTER + time)


def _begin(model: FluxModel, law: ModelLaw, course: Preview, state: Record, ticks: int) -> None:
    """Take over the model finger as it is after its first step, and run it and the object ahead."""
    names = model.names
    index = state[names.object].item()
    state[names.preview_index] = index
    if not state[names.on_plate].item():
        _place(model, law, course, state)
    if model.curves[index] is None and course.bodies[index] is not None:
        _restart(model, course, state, ticks, law.ahead)


def _place(model: FluxModel, law: ModelLaw, course: Preview, state: Record) -> None:
    """Tell the law which finger is about to touch: the model finger as it is now or, without one, a resting one."""
    if model.heat:
        converted(course.into, state[model.names.finger], state[model.names.x][0])
    else:
        skin = state[model.skin_from].item() if model.skin_from else model.skin
        law.place(state, rising(law.fine, skin))


def _ahead(model: FluxModel, course: Preview, state: Record) -> Ahead | None:
    """Return the contact that runs ahead, on State; None: nothing is known of its object."""
    names, body = model.names, course.bodies[state[model.names.preview_index].item()]
    if body is None:
        return None
    modes = state[names.preview_finger], state[names.preview_object]
    return Ahead(course.finger, modes[0], body, modes[1], state[names.future], state[names.reached].reshape(1))


def _now(model: FluxModel, state: Record) -> tuple[Array, Array, float]:
    """Return the modes of the model finger and of the object below it, and the desired flux [W/m2]."""
    names = model.names
    below = state[names.bodies][state[names.preview_index].item()]
    return state[names.finger], below, state[names.desired].item()


def _restart(model: FluxModel, course: Preview, state: Record, ticks: int, count: int) -> None:
    """Run ahead from the model finger and object as they are after step ``ticks`` of the touch."""
    ahead = _ahead(model, course, state)
    if ahead is not None:
        begin_ahead(
            ahead, *_now(model, state), _coming(model, course, state), model.press / model.period, ticks,
            first_steps(count, model.period), count,
        )  # fmt: skip


def _coming(model: FluxModel, course: Preview, state: Record) -> float:
    """Return the resistance [K m2/W] that is expected to last at the felt force, without the effect of a press."""
    if model.steady:
        return course.resistance
    return model.resistance.at(state[model.names.felt_force].item())


def _continue(model: FluxModel, law: ModelLaw, course: Preview, state: Record, ticks: int) -> None:
    """Keep the preview a horizon ahead."""
    ahead = _ahead(model, course, state)
    if ahead is not None:
        keep_ahead(
            ahead, *_now(model, state), _coming(model, course, state), model.press / model.period, ticks, law.ahead,
            model.hold, model.steady,
        )  # fmt: skip
