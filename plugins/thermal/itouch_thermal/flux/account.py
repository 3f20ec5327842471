"""What the report says of a contact that the plate rendered: means, peaks and the error of the flux."""

from __future__ import annotations

import math

from itouch.plugin import Field, Record

#: Seconds after the begin from which the flux error counts, and the least flux [W/m2] it is relative to.
SCORED_FROM, FLOOR = 0.1, 50.0

FIELDS: tuple[Field, ...] = (
    Field("account.rendered", "i8"),
    Field("account.ticks", "i8"),
    Field("account.sum"),
    Field("account.peak"),
    Field("account.skin_begin"),
    Field("account.skin_extreme"),
    Field("account.squares"),
    Field("account.scored", "i8"),
    Field("account.ready", "i8"),
)


def begin(state: Record, name: str, rendered: bool, ready: bool) -> None:
    """Open the account of a contact."""
    for field in FIELDS:
        state[f"{name}.{field.name}"] = 0
    state[f"{name}.account.rendered"] = int(rendered)
    state[f"{name}.account.ready"] = int(ready)


def add(state: Record, name: str, flux: float, desired: float, skin: float, period: float) -> None:
    """Take in one tick: obtained and desired flux [W/m2] and skin temperature [K] (NaN: unknown)."""
    prefix = f"{name}.account."
    ticks = state[prefix + "ticks"].item()
    if ticks == 0:
        state[prefix + "skin_begin"] = state[prefix + "skin_extreme"] = skin
    state[prefix + "ticks"] = ticks + 1
    state[prefix + "sum"] += flux
    if abs(flux) > abs(state[prefix + "peak"].item()):
        state[prefix + "peak"] = flux
    first = state[prefix + "skin_begin"].item()
    if abs(skin - first) > abs(state[prefix + "skin_extreme"].item() - first):
        state[prefix + "skin_extreme"] = skin
    if ticks * period >= SCORED_FROM:
        state[prefix + "squares"] += ((flux - desired) / max(abs(desired), FLOOR)) ** 2
        state[prefix + "scored"] += 1


def measures(state: Record, name: str, source: str) -> dict[str, float | str | bool | None]:
    """Return the report's figures of the contact."""
    prefix = f"{name}.account."
    ticks, scored = state[prefix + "ticks"].item(), state[prefix + "scored"].item()
    if not state[prefix + "rendered"].item() or ticks == 0:
        keys = ("flux_source", "mean_flux_W_m2", "peak_flux_W_m2", "skin_drop_K", "flux_error_rms", "plate_ready")
        return dict.fromkeys(keys)
    drop = state[prefix + "skin_begin"].item() - state[prefix + "skin_extreme"].item()
    return {
        "flux_source": source,
        "mean_flux_W_m2": state[prefix + "sum"].item() / ticks,
        "peak_flux_W_m2": state[prefix + "peak"].item(),
        "skin_drop_K": drop if math.isfinite(drop) else None,
        "flux_error_rms": math.sqrt(state[prefix + "squares"].item() / scored) if scored else None,
        "plate_ready": bool(state[prefix + "ready"].item()),
    }
