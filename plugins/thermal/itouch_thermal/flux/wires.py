"""`model` behind a wire: readings are taken at the tick of their measurement, currents at that in which they left.

Between two exchanges nothing is known of the plate; the law runs on under the current that has left last, and what
comes later is put right then.  A command waits for the next exchange, too: how long is learnt from the last ones.
"""

from __future__ import annotations

import math

from itouch.plugin import Field, Record
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.observer import M_QUIET
from itouch_thermal.flux.setting import FluxModel

#: Servo periods without news that are caught up with; after more the plate is where its sensors say.
MISSED = 250
#: By what part a departure moves what is thought of the wait.
LEARNT = 0.3

#: Sequence number and tick of the reading taken last, the current that has left last, when, and how long it had waited.
FIELDS = (
    Field("taken", "i8", unit="1", doc="number of the reading that was taken in last"),
    Field("taken_at", "i8", unit="tick", doc="when it was measured"),
    Field("acting", unit="A", doc="the current that has left last"),
    Field("departed", "i8", unit="tick", doc="when it left"),
    Field("waited", low=0.0, unit="tick", doc="how long currents wait until they leave"),
)


def news(model: FluxModel, state: Record) -> bool:
    """Tell whether the display has a reading that was not taken in."""
    return bool(state[model.names.sequence].item() != state[model.names.taken].item())


def wait(model: FluxModel, state: Record) -> int:
    """Return after how many periods a command of this update is thought to leave."""
    return int(state[model.names.waited].item() + 0.5) if model.wire else 0


def flowing(law: ModelLaw, state: Record) -> float:
    """Return the current [A] that flows in the module now."""
    if law.delay == 0:
        return float(state[f"{law.prefix}acting"].item())
    return float(state[f"{law.prefix}line"][int(state[f"{law.prefix}slots"][0])])


def take(model: FluxModel, law: ModelLaw, state: Record, hovering: bool, tick: int, scale: float, press: float) -> None:
    """Go on to this tick, and take in a reading that has come; one of a finger that hovers is unclear."""
    names = model.names
    pass_by(model, law, state, tick, scale)
    if not news(model, state):
        return
    state[names.taken] = state[names.sequence].item()
    measured, (flux_at, film_at) = state[names.measured], model.at
    flux_tick, film_tick = measured[flux_at].item(), measured[film_at].item()
    since = max(1, film_tick - state[names.taken_at].item()) * model.period
    state[names.taken_at] = film_tick
    if not hovering:
        law.recall(
            state, state[names.heat_flux].item(), max(0, tick - flux_tick), state[names.plate_temperature].item(),
            max(0, tick - film_tick), state[names.sink].item(), since, press,
        )  # fmt: skip


def pass_by(model: FluxModel, law: ModelLaw, state: Record, tick: int, scale: float) -> None:
    """Let the periods pass up to a tick, under the currents that had left by then."""
    names = model.names
    tracked, before = state[names.tracked].item(), state[names.acting].item()
    count = max(0, min(MISSED, tick - tracked))
    after, change = before, count
    left = state[names.left].item()
    if left != state[names.departed].item() and left <= tick:
        after, change = state[names.out].item(), left - (tick - count)
        state[names.acting], state[names.departed] = after, left
        _learn(model, state, left, tick)
    # While it learns nothing, the law only follows the plate's sensor, in every period as if it were read.
    quiet = state[names.memory][M_QUIET].item() > count * model.period
    film = state[names.plate_temperature].item() if quiet else math.nan
    law.pass_by(state, count, before, after, change, scale, film)
    state[names.tracked] = max(tick, tracked)


def _learn(model: FluxModel, state: Record, left: int, tick: int) -> None:
    """Note how long a command had waited that left in a tick: it was written in the last update before."""
    waited, found = state[model.names.waited].item(), float(left % model.hold)
    if left == tick and found == 0.0:  # before the update of this tick: it was that of the one before
        found = float(model.hold)
    if abs(found - waited) > 0.5 * model.hold:
        waited = found
    state[model.names.waited] = waited + LEARNT * (found - waited)
