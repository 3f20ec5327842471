"""The controllers `paper` and `hold` in a scene: equation 3 before the touch, PI or a constant temperature in it.

In the touch both keep within the plate's band and its greatest rate, as `model` does.
"""

from __future__ import annotations

from itouch.plugin import Field, Record
from itouch_thermal.display.column import plate_capacity
from itouch_thermal.display.peltier import current_for
from itouch_thermal.flux.flux_model import APPROACH, FluxModel
from itouch_thermal.flux.joined import Tick
from itouch_thermal.flux.limits import RATE, RATE_OVER
from itouch_thermal.flux.masking import masked
from itouch_thermal.flux.proportional import proportional_integral
from itouch_thermal.flux.start import MARGIN

#: The share of the plate's greatest rate in a touch that is used.
RATE_USED = 0.9
#: How many temperatures of that time are remembered, and the time [s] in which the plate is stopped at a limit.
PIECES, STOPPING = 50, 0.1


def memory(model: FluxModel) -> tuple[Field, ...]:
    """Return the State fields of `paper` and `hold`: the plate's temperatures in the last half second."""
    return (
        ()
        if model.law is not None
        else (Field("passed", "f8", PIECES, unit="K", doc="where the plate was in the last half second"),)
    )


def control(model: FluxModel, tick: Tick, state: Record, period: float) -> None:
    """Command the display by `paper` or `hold`."""
    names, p, now = model.names, model.display, state["tick"].item()
    plate, sink, touching = (
        state[names.plate_temperature].item(),
        state[names.sink].item(),
        state[names.touching].item(),
    )
    if touching:
        flux = _bounded(model, state, _touch(model, state, plate, period), plate, now, period)
    else:
        flux = _approach(model, state, plate)
    current = current_for(p.seebeck, p.resistance, p.conductance, flux * p.area, plate, sink)
    current = float(min(model.current, max(-model.current, current)))
    state[names.fresh], state[names.flux] = 0, flux
    tick.scene.command[...] = current if touching else masked(current, model.preset_noise, model.current, now)
    tick.issue()


def _approach(model: FluxModel, state: Record, plate: float) -> float:
    """Return the flux that brings the plate to its start temperature."""
    error: float = plate - state[model.names.start_temperature].item()
    limit = model.display.flux_limit
    return min(limit, max(-limit, plate_capacity(model.display.plate) * error / APPROACH))


def _touch(model: FluxModel, state: Record, plate: float, period: float) -> float:
    if model.params.controller == "hold":
        return _approach(model, state, plate)
    error = state[model.names.desired].item() - state[model.names.heat_flux].item()
    gains = (model.params.proportional, model.params.integral)
    return proportional_integral(state, model.name, error, gains, model.display.flux_limit, period)


def _bounded(model: FluxModel, state: Record, flux: float, plate: float, tick: int, period: float) -> float:
    """Return a flux [W/m2], limited so that the plate neither leaves its band nor exceeds its greatest rate."""
    passed, since = state[f"{model.name}.passed"], tick - state[model.names.begun].item()
    length = max(RATE_OVER / PIECES, period)
    piece, pieces = int(since * model.period / length), int(RATE_OVER / length)
    if state[model.names.fresh].item():
        passed[:] = plate
    before: float = passed[(piece + 1) % pieces].item()
    passed[piece % pieces] = plate
    swing = RATE * RATE_OVER * RATE_USED
    low, high = max(model.band[0] + MARGIN, before - swing), min(model.band[1] - MARGIN, before + swing)
    capacity = plate_capacity(model.display.plate) / max(STOPPING, 2.0 * period)
    # What must at least be pumped to keep the plate's temperature: the finger's heat, spread over the plate.
    resting = model.display.cover * float(state[model.names.heat_flux].item())
    return min(resting + capacity * (plate - low), max(resting + capacity * (plate - high), flux))
