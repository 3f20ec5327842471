"""What `flux-control` shows on the live line, and its part of the report."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from itouch.plugin import Record
from itouch_thermal.display.switching import least_time, strongest
from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.observer import DELAY
from itouch_thermal.flux.start import within

#: Cached, for reports are made again and again: for each run of a sweep, and for each cell of a matrix of faults.
_least_time = lru_cache(maxsize=256)(least_time)

#: Greatest number of materials between which the report lists the times of switches.
LISTED = 16


def status(model: FluxModel, state: Record) -> str:
    """Return the desired flux in a touch, else the plate's temperature and how ready it is; "" before it is read."""
    names = model.names
    kelvin = state[names.plate_temperature].item()
    if kelvin <= 0.0:
        return ""
    plate = f"plate {kelvin - 273.15:5.2f} degC"
    if state[names.plate_limited].item() and (state[names.touching].item() or state[names.plate_ready].item()):
        low, high = (end - 273.15 for end in model.band)
        plate += f", limited: its band is {low:.0f} to {high:.0f} degC"
    if state[names.touching].item():
        return f"desired {state[names.desired].item():7.0f} W/m2  {plate}"
    if state[names.plate_ready].item():
        return f"{plate} ready"
    return f"{plate} {100.0 * state[names.readiness].item():3.0f} %"


def report(model: FluxModel, state: Record) -> dict[str, Any]:
    """Return the modality's part of the report."""
    names = model.names
    return {
        "controller": model.params.controller,
        "target": model.params.target,
        "command": model.display.command,
        "plate_band_C": [end - 273.15 for end in model.band],
        "dew_point_C": model.dew - 273.15 if model.dew > 0.0 else None,
        "condensation_s": state[names.condensation_time].item(),
        "preset_s": model.preset_time or None,
        "contacts_before_ready": state[names.unready].item(),
        "delay_found_s": _delay(model, state),
        "switching": switches(model),
    }


def _delay(model: FluxModel, state: Record) -> float | None:
    """Return the time [s] after which commands act, as estimated; None where it is no parameter of the estimator."""
    if not model.wire or len(state[model.names.theta]) <= DELAY:
        return None
    return model.display.delay + float(state[model.names.theta][DELAY])


def switches(model: FluxModel) -> list[dict[str, Any]]:
    """Return the least time [s] of a switch between any two materials, the driver's delay included.

    If several objects are of one material, the temperature of the first one counts.
    """
    starts: dict[str, float] = {}
    for name, start in zip(model.materials, model.starts, strict=True):
        if start is not None and len(starts) < LISTED:
            starts.setdefault(name, within(model.band, start[1]))
    limit = strongest(model.display, model.current)
    times: dict[float, float] = {}
    found = []
    for first, begin in starts.items():
        for second, end in starts.items():
            if first == second:
                continue
            apart = round(abs(end - begin), 3)
            if apart not in times:
                times[apart] = model.display.delay + _least_time(model.display, begin, end, limit=limit)
            found.append(
                {
                    "from": first,
                    "to": second,
                    "from_start_C": begin - 273.15,
                    "to_start_C": end - 273.15,
                    "seconds": times[apart],
                }
            )
    return found
