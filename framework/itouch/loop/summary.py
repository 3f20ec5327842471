"""The report of a run, as plain data; its keys are fixed and documented in ``docs/reference/report.md``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from itouch.loop.timing import Timing

if TYPE_CHECKING:
    from itouch.loop.engine import Engine


def timing_report(times: Timing, real: bool) -> dict[str, Any]:
    """Return what a tick is made of, and in real time what made it overrun, with histograms [us, us, count]."""
    paced = {
        "culprits": times.culprits(),
        "skipped": times.skipped,
        "histograms_us": {"lateness": times.histogram(0), "tick": times.histogram(1)},
    }
    return {"parts_us": times.split(), **(paced if real else {})}


def summary(engine: Engine, open_contacts: list[dict[str, Any]], wall: float) -> dict[str, Any]:
    """Return what happened in a run.

    Parameters
    ----------
    engine
        The engine, after or during a run.
    open_contacts
        Entries of the contacts that have not ended.
    wall
        Host seconds spent running.
    """
    model, ledger, times = engine.model, engine.ledger, engine.times
    real = engine.clock.pace == "real"
    tracking = ledger.tracking.summary(1e3)
    return {
        "scene": model.scene.source,
        "simulated_s": engine.seconds,
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
        "table": {"tracking_mm": tracking, "height_error_mm_max": ledger.height_error * 1e3},
        "devices": {
            name: {
                "status": engine.status(name).name,
                "limited": int(engine.state[f"{name}.clamped"]),
                "locked_dropped": int(engine.state[f"{name}.dropped"]),
            }
            for name in model.devices
        },
        "notices": list(model.notices),
        "modalities": {m.name: m.instance.report(m.model, engine.state) for m in model.modalities},
        "contacts": [*ledger.contacts, *open_contacts],
        "faults": sorted([*ledger.faults, *engine.injected], key=lambda entry: int(entry["tick"])),
    }
