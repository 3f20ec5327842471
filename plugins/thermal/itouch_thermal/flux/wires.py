"""`model` behind a wire: readings are taken at the tick of their measurement, currents at that in which they left.

Between two exchanges nothing is known of the plate; the law runs on under the current that has left last, and what
comes later is put right then.  A command is computed in every tick, of which the newest leaves with the next exchange:
how long that takes, and for how long it will stand then, is learnt from the last ones.
"""

from __future__ import annotations

from itouch.plugin import Field, Record
from itouch_thermal.flux.law import Coming, ModelLaw
from itouch_thermal.flux.setting import FluxModel

#: Servo periods without news that are caught up with; after more the plate is where its sensors say.
MISSED = 250
#: By what part a departure moves what is thought of the next one; most periods that a current is thought to stand.
LEARNT, LONG = 0.3, 50.0
#: How many currents are remembered that were sent.
LOG = 64

#: Sequence number and tick of the reading taken last; the current that has left last and when; how many periods it had
#: waited for that, and how many there are between two such; the currents that were sent, by tick.
FIELDS = (
    Field("taken", "i8", unit="1", doc="number of the reading that was taken in last"),
    Field("taken_at", "i8", unit="tick", doc="when it was measured"),
    Field("acting", unit="A", doc="the current that has left last", show="no"),
    Field("departed", "i8", unit="tick", doc="when it left"),
    Field("before", unit="A", doc="the current that flows until then, if that is still to come", show="no"),
    Field("waited", low=0.0, unit="tick", doc="how long currents wait until they leave"),
    Field("interval", low=0.0, unit="tick", doc="ticks from one current that leaves to the next"),
    Field("sent_log", "f8", LOG, unit="A", doc="currents that were sent in the last ticks"),
)


def coming(model: FluxModel, state: Record, tick: int) -> Coming:
    """Return what will become of a current that is asked for in this tick."""
    names = model.names
    if not model.wire:
        return model.at_once
    wait, span = int(state[names.waited].item() + 0.5), int(state[names.interval].item() + 0.5)
    later = max(0.0, float(state[names.departed].item() - tick))
    return Coming(max(1, span), wait, (state[names.before].item(), state[names.acting].item(), later))


def flowing(law: ModelLaw, state: Record) -> float:
    """Return the current [A] that flows in the module now."""
    if law.delay == 0:
        return float(state[f"{law.prefix}acting"].item())
    return float(state[f"{law.prefix}line"][int(state[f"{law.prefix}slots"][0])])


def take(model: FluxModel, law: ModelLaw, state: Record, hovering: bool, tick: int, scale: float, press: float) -> None:
    """Go on to this tick, and take in a reading that has come; one of a finger that hovers is unclear."""
    names = model.names
    state[names.sent_log][(tick - 1) % LOG] = state[names.sent].item()  # what was sent in the tick before
    pass_by(model, law, state, tick, scale, press)
    if state[names.sequence].item() == state[names.taken].item():
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


def pass_by(model: FluxModel, law: ModelLaw, state: Record, tick: int, scale: float, press: float = 0.0) -> None:
    """Let the periods pass up to a tick, under the currents that had left by then."""
    names = model.names
    tracked, left = state[names.tracked].item(), state[names.left].item()
    count = max(0, min(MISSED, tick - tracked))
    first, departed = tick - count, state[names.departed].item()
    change = max(0, departed - first)
    acting, out = state[names.acting].item(), state[names.out].item()
    # Another has left, maybe before what was tracked already; after time left out its tick may be that of the last.
    if left != departed or out != acting:
        if count <= 1:
            _learn(model, state, left, departed)
        elif out not in state[names.sent_log]:  # what a wire sends by itself in a gap; before it the newest has left
            acting = state[names.sent].item()
        state[names.before] = acting
        state[names.acting], state[names.departed] = out, left
        change = left - first
    law.pass_by(state, count, state[names.before].item(), state[names.acting].item(), change, scale, press)
    state[names.tracked] = max(tick, tracked)


def leave_out(model: FluxModel, state: Record, periods: int) -> None:
    """Date what is remembered back by so many periods, in which no tick was run."""
    names = model.names
    state[names.taken_at] -= periods
    for moment in (names.force_before_at, names.came):
        state[moment] -= periods
    state[names.before] = state[names.acting].item()  # it flows until another is told of


def _learn(model: FluxModel, state: Record, left: int, last: int) -> None:
    """Note how long a current had waited that left in this tick, and how long the one before had stood."""
    names = model.names
    log, out = state[names.sent_log], state[names.out].item()
    found = next((float(ago) for ago in range(LOG) if log[(left - ago) % LOG] == out), None)
    if found is not None and model.law is not None:
        waited = state[names.waited].item()
        state[names.waited] = waited + LEARNT * (min(found, float(model.law.wait)) - waited)
    if last >= 0:
        span = state[names.interval].item()
        state[names.interval] = span + LEARNT * (min(LONG, float(left - last)) - span)
