"""Flux error of a contact that the plate rendered, for the report: means, peaks, sensor beside estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from itouch.plugin import Field, Measured, Record, Role
from itouch.plugin.kernels import linked
from itouch_thermal.flux import onset
from itouch_thermal.flux.views import Floats

#: Sums beside an estimate: squares of the sensor's relative error and of the estimate's standard deviation, and their
#: number; where a virtual rig knows the true flux, squares of its relative error, their number, squares of the
#: estimate's error against it, and their number.
_RAW, _DEVIATION, _READ, _TRUE, _SEEN, _MISSED, _ASKED = range(7)
#: Seconds after the start from which the flux error counts, and the least flux [W/m2] it is relative to.
SCORED_FROM, FLOOR = 0.1, 50.0

FIELDS: tuple[Field, ...] = (
    Field("account", "f8", 9, unit="mixed", doc="sums of the open contact, of which the report's figures are made"),
    Field(
        "beside",
        "f8",
        7,
        unit="mixed",
        doc="the same of what stands beside an estimate: sensor, and truth",
    ),
)

#: The figures of each contact, null where unknown; `measures` adds those that only some contacts have.
MEASURED: tuple[Measured, ...] = (
    Measured("flux_source", "1", "where the flux is known from: twin, estimate or sensor", show="no"),
    Measured(
        "mean_flux_W_m2", "W/m^2", "mean of the obtained flux, > 0 out of the finger", "mean flux", "W/m2", 0,
        role=Role.HEAT_FLUX,
    ),
    Measured("peak_flux_W_m2", "W/m^2", "extreme of the obtained flux, of twins the true one: a sensor's curve lags",
             "peak flux", digits=0, show="page"),
    Measured("skin_begin_degC", "degC", "skin temperature at the start", "skin at start", "skin degC"),
    Measured("skin_drop_K", "K", "skin temperature at the start minus its extreme, of the twin's finger", "skin drop",
             "skin K", role=Role.SKIN_TEMPERATURE),
    Measured(
        "flux_error_rms", "1", "rms of the flux error from 0.1 s on, as a share of the desired flux",
        "flux error rms", "flux err", 1, percent=True, maximum_label="greatest flux error (rms)",
        relative_error=True,
    ),
    Measured(
        "plate_ready", "1", "whether the plate was at its start temperature when it met the finger", show="no",
        required_value=True, failure_reason="the plate was not ready",
    ),
    Measured(
        "plate_limited", "1", "whether the start temperature was outside the plate's band, and was clipped", show="no",
        required_value=False, failure_reason="the plate was limited",
    ),
)  # fmt: skip


@linked
def enter(account: Floats, flux: float, desired: float, skin: float, period: float) -> None:
    """Enter one tick into the account (9,): obtained and desired flux [W/m2], skin temperature [K] (NaN: unknown)."""
    ticks, first = account[onset.TICKS], account[onset.SKIN_BEGIN]
    if abs(flux) > abs(account[onset.PEAK]):
        account[onset.PEAK] = flux
    if abs(skin - first) > abs(account[onset.SKIN_EXTREME] - first):
        account[onset.SKIN_EXTREME] = skin
    if scored(account, period):
        error = (flux - desired) / max(abs(desired), FLOOR)
        account[onset.SQUARES] += error * error
        account[onset.SCORED] += 1.0
    account[onset.TICKS] = ticks + 1.0
    account[onset.SUM] += flux


@linked  # Python calls it in a tick: a kernel that it called by itself would first be loaded there
def scored(account: Floats, period: float) -> bool:
    """Tell whether the flux error of this tick counts: it does from 0.1 s after the start of the touch on.

    ``account`` (9,) is the contact's, without a unit as a whole; ``period`` is that of an update [s].
    """
    return bool(account[onset.TICKS] * period >= SCORED_FROM)


@linked
def compare(beside: Floats, sensor: float, deviation: float, desired: float) -> None:
    """Take in, beside an estimate, the sensor's reading [W/m2] and the estimate's standard deviation [W/m2].

    ``beside`` (7,) are the contact's sums; ``desired`` is the flux [W/m2] that was desired.
    """
    beside[_RAW] += _relative(sensor - desired, desired)
    beside[_DEVIATION] += deviation * deviation
    beside[_READ] += 1.0


def note_ground_truth(state: Record, name: str, truth: float, estimate: float, desired: float) -> None:
    """Take in the true flux [W/m2], which a virtual rig knows; ``estimate`` [W/m2], NaN in ticks without a new one."""
    beside = state[f"{name}.beside"]
    beside[_TRUE] += _relative(truth - desired, desired)
    beside[_SEEN] += 1.0
    if math.isfinite(estimate):
        beside[_MISSED] += _relative(estimate - truth, desired)
        beside[_ASKED] += 1.0


@linked
def _relative(error: float, desired: float) -> float:
    relative = error / max(abs(desired), FLOOR)
    return float(relative * relative)


def measures(state: Record, name: str, source: str) -> dict[str, float | str | bool | None]:
    """Return the report's figures of the contact."""
    rendered, ready, ticks, total, peak, first, extreme, squares, scored = state[f"{name}.account"].tolist()
    if not rendered or not ticks:
        keys = ("flux_source", "mean_flux_W_m2", "peak_flux_W_m2", "skin_begin_degC", "skin_drop_K", "flux_error_rms",
                "plate_ready", "plate_limited")  # fmt: skip
        return {**dict.fromkeys(keys), "plate_ready": bool(ready) if rendered else None}
    drop = first - extreme
    found = {
        "flux_source": source,
        "mean_flux_W_m2": total / ticks,
        "peak_flux_W_m2": peak,
        "skin_begin_degC": first - 273.15 if math.isfinite(first) else None,
        "skin_drop_K": drop if math.isfinite(drop) else None,
        "flux_error_rms": math.sqrt(squares / scored) if scored else None,
        "plate_ready": bool(ready),
        "plate_limited": rendered == onset.CLIPPED,
    }
    # what judges an estimate, where there is one; that of the true flux only in a virtual rig
    raw, deviation, read, true, seen, missed, asked = state[f"{name}.beside"].tolist()
    if read:
        found["flux_deviation_W_m2"] = math.sqrt(deviation / read)
        found["sensor_error_rms"] = math.sqrt(raw / read)
    if seen:
        found["true_error_rms"] = math.sqrt(true / seen)
        found["estimate_error_rms"] = math.sqrt(missed / max(1.0, asked))
    return found


def contact_summary(entry: Mapping[str, Any]) -> str:
    """Return a few words on a contact that has ended."""
    mean = entry.get("mean_flux_W_m2")
    return "no heat rendered" if mean is None else f"mean flux {mean:.0f} W/m2"


def contact_warnings(entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Say in which ways a touch was not as it should have been, and how good its estimated flux is."""
    found, where = [], f"{entry['object']} at {entry['begin_s']:.3f} s"
    if entry.get("plate_ready") is False:
        found.append(f"{where}: began before the plate was ready")
    if entry.get("plate_limited"):
        found.append(f"{where}: its start temperature is out of the plate's band and was clipped")
    if entry.get("flux_source") == "estimate" and entry.get("sensor_error_rms") is not None:
        found.append(_judged(entry))
    return tuple(found)


def _judged(entry: Mapping[str, Any]) -> str:
    """Say how far the flux is off: as estimated (with deviation), by the sensor alone, and truly in a virtual rig."""
    error, sensor = entry["flux_error_rms"] or 0.0, entry["sensor_error_rms"]
    line = f"{entry['object']}: flux off by {100.0 * error:.1f} % as estimated (+- "
    line += f"{entry['flux_deviation_W_m2']:.0f} W/m2), {100.0 * sensor:.1f} % by the sensor alone"
    if entry.get("true_error_rms") is not None:
        line += f"; truly {100.0 * entry['true_error_rms']:.1f} %, the estimate itself by "
        line += f"{100.0 * entry['estimate_error_rms']:.1f} %"
    return line
