"""What the report says of a contact that the plate rendered: means, peaks and the error of the flux."""

from __future__ import annotations

import math

from itouch.plugin import Field, Record

#: Seconds after the begin from which the flux error counts, and the least flux [W/m2] it is relative to.
SCORED_FROM, FLOOR = 0.1, 50.0

#: The numbers of the account, in their order.
_RENDERED, _READY, _TICKS, _SUM, _PEAK, _SKIN_BEGIN, _SKIN_EXTREME, _SQUARES, _SCORED = range(9)

FIELDS: tuple[Field, ...] = (
    Field("account", "f8", 9, unit="mixed", doc="sums of the open contact, of which the report's figures are made"),
)


def begin(state: Record, name: str, rendered: bool, ready: bool, skin: float) -> None:
    """Open the account of a contact; ``skin`` [K] is the skin temperature before it (NaN: unknown)."""
    account = state[f"{name}.account"]
    account[:] = 0.0
    account[_RENDERED], account[_READY] = rendered, ready
    account[_SKIN_BEGIN] = account[_SKIN_EXTREME] = skin


def add(state: Record, name: str, flux: float, desired: float, skin: float, period: float) -> None:
    """Take in one tick: obtained and desired flux [W/m2] and skin temperature [K] (NaN: unknown)."""
    view = state[f"{name}.account"]
    rendered, ready, ticks, total, peak, first, extreme, squares, scored = view.tolist()
    if abs(flux) > abs(peak):
        peak = flux
    if abs(skin - first) > abs(extreme - first):
        extreme = skin
    if ticks * period >= SCORED_FROM:
        error = (flux - desired) / max(abs(desired), FLOOR)
        squares += error * error
        scored += 1.0
    view[:] = (rendered, ready, ticks + 1.0, total + flux, peak, first, extreme, squares, scored)


def measures(state: Record, name: str, source: str) -> dict[str, float | str | bool | None]:
    """Return the report's figures of the contact."""
    rendered, ready, ticks, total, peak, first, extreme, squares, scored = state[f"{name}.account"].tolist()
    if not rendered or not ticks:
        keys = ("flux_source", "mean_flux_W_m2", "peak_flux_W_m2", "skin_drop_K", "flux_error_rms", "plate_ready")
        return {**dict.fromkeys(keys), "plate_ready": bool(ready) if rendered else None}
    drop = first - extreme
    return {
        "flux_source": source,
        "mean_flux_W_m2": total / ticks,
        "peak_flux_W_m2": peak,
        "skin_drop_K": drop if math.isfinite(drop) else None,
        "flux_error_rms": math.sqrt(squares / scored) if scored else None,
        "plate_ready": bool(ready),
    }
