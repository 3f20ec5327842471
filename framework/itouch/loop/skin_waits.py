"""What is said of an operator twin that waits for its skin to recover, in the live line and in the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from itouch.plugin import Record
from itouch.schema.hold_until import Until
from itouch.twin.waits import BACK, NOT_YET
from itouch.world import Model, ProbeModel


def waits_of(model: Model, state: Record) -> list[dict[str, Any]]:
    """Return an entry of the report for each wait that has begun, in the order in which they began."""
    found = [entry for probe in model.probes for entry in _entries(model, probe, state)]
    return sorted(found, key=lambda entry: float(entry["begin_s"]))


def _entries(model: Model, probe: ProbeModel, state: Record) -> Iterator[dict[str, Any]]:
    own = f"{probe.name}.hand"
    if probe.operator is None or f"{own}.waited" not in state:
        return
    targets = [(k, target) for k, target in enumerate(probe.operator.motion.targets) if isinstance(target.hold, Until)]
    columns = (state[f"{own}.{name}"].tolist() for name in ("wait_begin", "waited", "wait_end", "wait_skin"))
    for (number, target), begin, waited, end, skin in zip(targets, *columns, strict=True):
        if end == NOT_YET and not waited:
            continue
        place = model.scene.places.of(target, "hold")
        yield {
            "probe": probe.name,
            "target": number,
            "begin_s": begin * model.period,
            "waited_s": waited * model.period,
            "ended": end != NOT_YET,
            "back": end == BACK if end != NOT_YET else None,
            "within_K": target.hold.within,
            "skin_degC": skin - 273.15 if skin > 0.0 else None,
            "baseline_degC": _celsius(state[f"{own}.baseline"].item()),
            "scene": str(place) if place is not None else None,
        }


def _celsius(kelvin: float) -> float | None:
    return kelvin - 273.15 if kelvin > 0.0 else None


def unrecovered_waits(model: Model, state: Record) -> tuple[str, ...]:
    """Return a sentence for each wait that ended although the skin had not recovered."""
    return tuple(_sentence(entry) for entry in waits_of(model, state) if entry["back"] is False)


def _sentence(entry: dict[str, Any]) -> str:
    skin, baseline = entry["skin_degC"], entry["baseline_degC"]
    where = f" ({entry['scene']})" if entry["scene"] else ""
    after = f"the finger of '{entry['probe']}' waited {entry['waited_s']:.0f} s for its skin{where}"
    if skin is None or baseline is None:
        return f"{after}, which was not read meanwhile, and went on"
    return (
        f"{after} and went on: it was {skin:.1f} degC and not within {entry['within_K']:g} K of {baseline:.1f} degC, "
        "as at the session's start"
    )


def waiting_now(model: Model, probe: ProbeModel, state: Record) -> str:
    """Return a few words about a finger that is waiting now; empty: it is not."""
    for entry in _entries(model, probe, state):
        if not entry["ended"]:
            return f"waits for its skin {entry['waited_s']:.0f} s"
    return ""
