"""`model` behind a wire: readings count as of the tick of their measurement, currents from that in which they left.

Between two exchanges nothing is known of the plate: the law runs on under the current that left last, and is corrected
by what arrives later.  A command is computed in every tick, and the newest one leaves with the next exchange.  How long
it will wait for that, and for how long it will stand then, is learnt from the last ones.
"""

from __future__ import annotations

from itouch.plugin import Field, Record
from itouch_thermal.flux.current_command import FutureCurrent
from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.law import MISSED, ModelLaw

#: Weight of the newest departure in the estimate for the next one (exponential smoothing), and the greatest number of
#: periods for which a current is expected to stand.
LEARNT, LONG = 0.3, 50.0
#: How many of the currents that were sent are remembered.
LOG = 64

#: Sequence number and tick of the reading taken in last; the current that left last, when it left, and the current
#: before it; how many periods a current waits until it leaves, and how many pass between two that leave; the currents
#: that were sent, by tick.
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


def coming(model: FluxModel, state: Record, tick: int) -> FutureCurrent:
    """Return what will become of a current that is asked for in this tick."""
    names = model.names
    wait, span = int(state[names.waited].item() + 0.5), int(state[names.interval].item() + 0.5)
    later = max(0.0, float(state[names.departed].item() - tick))
    return FutureCurrent(max(1, span), wait, (state[names.before].item(), state[names.acting].item(), later))


def take(model: FluxModel, law: ModelLaw, state: Record, hovering: bool, tick: int, scale: float, press: float) -> None:
    """Go on to this tick, and take in a reading that has arrived, unless it is ambiguous because the finger hovers."""
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
    """Let the periods up to a tick pass, under the currents that had left by then."""
    names = model.names
    tracked, left = state[names.tracked].item(), state[names.left].item()
    count = max(0, min(MISSED, tick - tracked))
    first, departed = tick - count, state[names.departed].item()
    change = max(0, departed - first)
    acting, out = state[names.acting].item(), state[names.out].item()
    # Another current has left, maybe in a tick that was tracked already; after a gap its tick may equal the last one's.
    if left != departed or out != acting:
        if count <= 1:
            _learn(model, state, left, departed)
        elif out not in state[names.sent_log]:  # the wire has sent this by itself in a gap; the newest left before it
            acting = state[names.sent].item()
        state[names.before] = acting
        state[names.acting], state[names.departed] = out, left
        change = left - first
    law.pass_by(state, count, state[names.before].item(), state[names.acting].item(), change, scale, press)
    state[names.tracked] = max(tick, tracked)


def leave_out(model: FluxModel, state: Record, periods: int) -> None:
    """Shift the times that are remembered back by ``periods``, in which no tick was run."""
    names = model.names
    state[names.taken_at] -= periods
    for moment in (names.force_before_at, names.came):
        state[moment] -= periods
    state[names.before] = state[names.acting].item()  # it flows until another is known to have left


def _learn(model: FluxModel, state: Record, left: int, last: int) -> None:
    """Learn how long the current that has now left had waited, and how long the one before it had stood."""
    names = model.names
    log, out = state[names.sent_log], state[names.out].item()
    found = next((float(ago) for ago in range(LOG) if log[(left - ago) % LOG] == out), None)
    if found is not None and model.law is not None:
        waited = state[names.waited].item()
        state[names.waited] = waited + LEARNT * (min(found, float(model.law.wait)) - waited)
    if last >= 0:
        span = state[names.interval].item()
        state[names.interval] = span + LEARNT * (min(LONG, float(left - last)) - span)
