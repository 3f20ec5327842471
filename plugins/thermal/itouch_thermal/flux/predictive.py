"""The controller `model` in Python, where the compiled calls do not stand one after the other in the loop's plan.

Python decides what comes between them: readings over a wire, and ticks that must be caught up with first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contact_heat.live import state_size
from itouch.plugin import Contact, ContactEvent, Field, Record
from itouch_thermal.display.column import F_PORT
from itouch_thermal.flux import model_over_wire
from itouch_thermal.flux.approach import TOUCHED
from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.joined import Tick
from itouch_thermal.flux.law import PRIOR_ONSET, ModelLaw
from itouch_thermal.flux.onset import LATE, converted
from itouch_thermal.flux.preview import Preview

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
        Field("reached", "i8", unit="tick", doc="last tick of the touch simulated by the look-ahead contact"),
        Field("tracked", "i8", unit="tick", doc="up to when readings have been taken in"),
        Field("force_before", unit="N", doc="force on the plate in the update before", show="no"),
        Field("force_before_at", "i8", unit="tick", doc="when that was measured"),
        Field("came", "i8", unit="tick", doc="when the finger came to the plate, as the force tells"),
        Field("came_doubt", low=0.0, unit="s", doc="standard deviation of that, 0: it is not there", show="no"),
        Field("scale_before", unit="1", doc="factor on the contact resistance in the update before"),
        *model_over_wire.FIELDS,
    )


def control(model: FluxModel, law: ModelLaw, course: Preview, tick: Tick, state: Record) -> None:
    """Command the display; all servo periods since the last update are caught up with."""
    names, now = model.names, state["tick"].item()
    with _Alone(model, law, course, tick, state):
        if tick.begin.run():
            catch_up(model, law, tick, state, 1.0)
            tick.begin.run()
        tick.attend.run()
        tick.prepare.run()
        if not model.wire:
            tick.track.run()
            tick.command(0).run()
        else:
            if model.force_from and not state[names.on_plate].item():
                feel(model, state)
            taken = tick.taken
            model_over_wire.take(model, law, state, bool(taken.unclear[0]), now, taken.scale.item(), taken.press.item())
            coming = model_over_wire.coming(model, state, now)
            taken.hold[0], taken.wait[0], taken.out[:] = coming
            tick.command(coming.wait).run()
    tick.issue()


def hear(
    model: FluxModel, law: ModelLaw, course: Preview, tick: Tick, state: Record, event: ContactEvent
) -> None:  # fmt: skip
    """Aim for the object that comes near; begin and end the touch."""
    with _Alone(model, law, course, tick, state):
        call = tick.hear(event)
        if call.run():
            catch_up(model, law, tick, state, 1.0)
            call.run()
        begins = event.kind is Contact.BEGIN and state[model.names.touching].item()
        if begins and model.hold > 1 and tick.feel_between.run():
            catch_up(model, law, tick, state, tick.taken.scale.item())
            tick.set_between.run()


class _Alone:
    """While Python runs the calls: they may ask it to catch up, and know the skin that no sensor sees."""

    def __init__(self, model: FluxModel, law: ModelLaw, course: Preview, tick: Tick, state: Record) -> None:
        self._alone, self._guess, self._before = tick.taken.alone, tick.scene.guess, tick.scene.guess.item()
        self._skin = self._before
        seen = model.skin_from and not (model.maybe_blind and state[model.skin_valid].item() < 0.5)
        if not seen and model.heat:
            column, modes = law.fine, np.empty(len(course.into))
            converted(course.into, state[model.names.finger], modes)
            self._skin = float(column.rest + column.tissue[F_PORT] @ modes)

    def __enter__(self) -> None:
        self._alone[0], self._guess[0] = 1, self._skin

    def __exit__(self, *what: object) -> None:
        self._alone[0], self._guess[0] = 0, self._before


def feel(model: FluxModel, state: Record) -> None:
    """Behind a wire, note the last reading of the force without a finger, and by the first one with it, when it came.

    It came between the two readings or, if there was some force in the earlier one, where a line through both is zero.
    """
    names, (field, at) = model.names, model.force_at
    force, measured = abs(state[model.force_from][2].item()), int(state[field][at].item())
    if not force > TOUCHED:
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
        model_over_wire.leave_out(model, state, periods)


def catch_up(model: FluxModel, law: ModelLaw, tick: Tick, state: Record, scale: float) -> None:
    """Let the periods before this one in which nothing was taken in pass without readings; too many are cut short."""
    if model.wire:
        model_over_wire.pass_by(model, law, state, state["tick"].item() - 1, scale)
        return
    taken = tick.taken
    taken.scale[0], taken.press[0], taken.passes[0] = scale, 0.0, 1
    tick.track.run()
    taken.passes[0] = 0
