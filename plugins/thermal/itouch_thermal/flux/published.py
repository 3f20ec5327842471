"""The controllers `paper` and `hold` in a scene: equation 3 before the touch, PI or nothing in it."""

from __future__ import annotations

from itouch.plugin import Record
from itouch_thermal.display.peltier import current_for
from itouch_thermal.flux.proportional import proportional_integral
from itouch_thermal.flux.setting import FluxModel

#: The plate is ready within this of its start temperature [K].
READY = 0.1
#: Time constant [s] of the approach to the start temperature.
APPROACH = 0.25


def control(model: FluxModel, state: Record, touching: bool, period: float) -> tuple[float, float]:
    """Return current [A] and pumped flux [W/m2] of `paper` and `hold`."""
    plate, sink = state[model.names.plate_temperature].item(), state[model.names.sink].item()
    flux = _touch(model, state, plate, period) if touching else _approach(model, state, plate)
    p = model.display
    current = current_for(p.seebeck, p.resistance, p.conductance, flux * p.area, plate, sink)
    return float(min(model.current, max(-model.current, current))), flux


def readiness(error: float) -> float:
    """Return how ready a plate is that differs from its start temperature by an error [K]: 0 to 1."""
    return max(0.0, min(1.0, 2.0 - abs(error) / READY))


def _approach(model: FluxModel, state: Record, plate: float) -> float:
    """Return the flux that brings the plate to its start temperature."""
    error: float = plate - state[model.names.start_temperature].item()
    state[model.names.readiness] = readiness(error)
    capacity = sum((layer.thickness or 0.0) * layer.heat_capacity for layer in model.display.plate)
    limit = model.display.flux_limit
    return min(limit, max(-limit, capacity * error / APPROACH))


def _touch(model: FluxModel, state: Record, plate: float, period: float) -> float:
    if model.params.controller == "hold":
        return _approach(model, state, plate)
    error = state[model.names.desired].item() - state[model.names.heat_flux].item()
    gains = (model.params.proportional, model.params.integral)
    return proportional_integral(state, model.name, error, gains, model.display.flux_limit, period)
