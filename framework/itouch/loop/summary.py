"""The report of a run as plain data; `docs/reference/report.md` documents its keys."""

from __future__ import annotations

from typing import Any

from itouch.exchange import ThreadedDevice
from itouch.loop.contact_report import of_run
from itouch.loop.engine_view import Running
from itouch.loop.late_coupling import late_couplings
from itouch.loop.plate_notices import lingering_plates, missed_plates
from itouch.loop.skin_waits import unrecovered_waits, waits_of
from itouch.loop.timing import Timing
from itouch.world import limits


def timing_report(times: Timing, real: bool) -> dict[str, Any]:
    """Return what a tick is made of, and in real time what made it overrun, with histograms [us, us, count]."""
    paced = {
        "processor_us": times.processor(),
        "culprits": times.culprits(),
        "skipped": times.skipped,
        "worst": times.worst(),
        "histograms_us": times.histograms(),
    }
    return {"parts_us": times.split(), **(paced if real else {})}


def summary(engine: Running, open_contacts: list[dict[str, Any]], wall: float, ticks: int) -> dict[str, Any]:
    """Return what happened in a run.

    Parameters
    ----------
    engine
        The engine, after or during a run.
    open_contacts
        Entries of the contacts that have not ended.
    wall
        Host seconds spent running.
    ticks
        How many ticks were run in that time; those before a session was saved are not among them.
    """
    model, statistics, times = engine.model, engine.statistics, engine.times
    real = engine.clock.pace == "real"
    tracking = statistics.tracking.summary(1e3)
    return {
        "scene": model.scene.source,
        "simulated_s": engine.seconds,
        "ran_s": ticks * model.period,
        "wall_s": wall,
        "pace": engine.clock.pace,
        "seed": int(engine.state["seed"]),
        "twins": [device.name for device in model.devices.values() if device.twin],
        "servo": {
            "rate_hz": model.scene.rates.servo,
            "ticks": int(engine.state["tick"]),
            "overruns": times.overruns if real else None,
            "tick_us": times.summary(),
            "lateness_us": times.lateness() if real else None,
            **timing_report(times, real),
        },
        "table": {"tracking_mm": tracking, "height_error_mm_max": statistics.height_error * 1e3},
        "devices": {
            name: {
                "status": engine.status(name).name,
                "limited": int(engine.state[f"{name}.clamped"]),
                "locked_dropped": int(engine.state[f"{name}.dropped"]),
                **_dose(engine, name),
                **_worn(engine, name),
                **_exchanges(engine, name),
            }
            for name in model.devices
        },
        "notices": [
            *model.notices,
            *statistics.notices(),
            *missed_plates(model, engine.state),
            *lingering_plates(model, engine.state),
            *late_couplings(model, engine.state),
            *unrecovered_waits(model, engine.state),
        ],
        "modalities": {m.name: said for m in model.modalities if (said := of_run(m, engine.state)) or not m.default_of},
        "contacts": [*statistics.contacts, *open_contacts],
        "waits": waits_of(model, engine.state),
        "faults": sorted([*statistics.faults, *engine.injected], key=lambda entry: int(entry["tick"])),
    }


def _dose(engine: Running, name: str) -> dict[str, Any]:
    """Return the thermal dose that a plate has given in this session, and whether that is much of what it may."""
    runner = next(one for one in engine.runners if one.model.name == name)
    if not runner.gate.heats:
        return {}
    dose = sum(float(post.state["dose"]) for post in runner.gate.heats)
    most = runner.model.limits.dose or limits.DOSE
    much = dose > limits.told_from(most)
    told = f"has given {dose / 60.0:.2f} of at most {most / 60.0:g} CEM43 in this session" if much else None
    return {"dose_cem43_min": dose / 60.0, "dose_warning": told}


def _worn(engine: Running, name: str) -> dict[str, Any]:
    """Return on which finger's twin a device is worn, and how cold and warm the skin under it has been."""
    probe = next(one.worn_by for one in engine.runners if one.model.name == name)
    if not probe:
        return {}
    now, lowest, highest = (value - 273.15 for value in engine.state[f"{probe}.skin"].tolist())
    return {"worn_by": probe, "skin_degC": {"now": now, "lowest": lowest, "highest": highest}}


def _exchanges(engine: Running, name: str) -> dict[str, Any]:
    """Return how fast a device that is exchanged with in a thread has answered."""
    device = next(runner.gate.device for runner in engine.runners if runner.model.name == name)
    figures = device.figures() if isinstance(device, ThreadedDevice) else None
    return {"exchanges": figures} if figures is not None else {}
