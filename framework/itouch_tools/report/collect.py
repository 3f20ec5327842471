"""Collects what a session's page shows: figures, contacts and curves, out of a recording or a snapshot."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.schema.regular_files import stored_kind
from itouch.world import Model
from itouch_tools.report.columns import measured
from itouch_tools.report.curves import Curves, Sampler

if TYPE_CHECKING:
    from itouch.recording import Recording

#: Ticks between two calls of ``progress``.
_TOLD_EVERY = 5000

Progress = Callable[[float], None]


@dataclass(slots=True)
class Findings:
    """All that the page shows.

    ``report`` is the session's own, with the keys of ``docs/reference/report.md``; the page takes every figure from it.
    ``timing`` has the keys of the report's ``servo``, as far as they are known.
    """

    title: str
    kind: str
    summary: dict[str, str]
    report: dict[str, Any]
    faults: list[dict[str, Any]]
    marks: list[dict[str, Any]]
    losses: list[str]
    timing: dict[str, Any]
    provenance: dict[str, Any]
    scene_xml: str
    curves: Curves | None
    model: Model | None
    state: Record | None
    notices: list[str] = field(default_factory=list)
    #: Whether ``state`` is from a touch, and not from the end of the session.
    touching: bool = False

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """The contacts, one entry each, as in the report."""
        return list(self.report["contacts"])


def collect(path: str | os.PathLike[str], *, progress: Progress | None = None) -> Findings:
    """Return what the page shows of a recording (.mcap) or a snapshot (.itouch).

    A recording is replayed, so that all of State is known at every tick, not only what was recorded; ``progress`` is
    called now and then with the share of it that is done, 0 to 1.

    Raises
    ------
    ItouchError
        If the file can't be read.
    """
    name = os.fspath(path)
    return _recording(name, progress) if stored_kind(name) == "recording" else _snapshot(name)


def _recording(path: str, progress: Progress | None) -> Findings:
    from itouch.recording import read
    from itouch.servo.prepare import prepare_replay

    recording = read(path)
    work = prepare_replay(recording)
    ticks = len(recording.ticks)
    sampler = Sampler(work.session.model, ticks)
    shown = _Shown(work.session.model)
    work.session.taps.append(lambda tick: sampler.add(work.session.state))  # a tap runs in the safe sequence, too
    work.session.taps.append(lambda tick: shown.look(work.session.state))
    while work.step():
        if progress is not None and work.feed.at % _TOLD_EVERY == 0:
            progress(work.feed.at / ticks)
    outcome, report = work.outcome(), _report(recording.report, work.session.report())
    faults = report["faults"] if recording.report else recording.faults
    spans = [(contact["begin_s"], contact["end_s"]) for contact in report["contacts"]]
    summary = _summary(report, faults, recording.duration, work.session.model)
    summary["commands that differ in its replay"] = f"{outcome.mismatches} of {outcome.compared}"
    losses = list(recording.losses)
    if outcome.skipped:
        losses.append(f"{outcome.skipped} ticks after gaps could not be replayed: curves and contacts lack them")
    manifest = dict(recording.session.get("manifest", {}))
    begin = _time(
        int(recording.session["start_ns"]) * 1e-9 + float(recording.ticks[0] if ticks else 0) * recording.period
    )
    return Findings(
        os.path.basename(path), "recording", summary, report, faults, recording.marks, losses,
        _timing(recording, report), _provenance(manifest, {"begin": begin}), recording.scene,
        sampler.curves(spans), work.session.model, shown.state or work.session.state, list(work.session.notices),
        touching=shown.state is not None,
    )  # fmt: skip


class _Shown:
    """Keeps the State to be pictured: that of the first touch to last half a second, at its half second."""

    def __init__(self, model: Model) -> None:
        self.state: Record | None = None
        self._names = [f"{probe.name}.object" for probe in model.probes]
        self._left = self._whole = round(0.5 / model.period)

    def look(self, state: Record) -> None:
        """Look at the State after a tick."""
        if self.state is not None:
            return
        touched = any(int(state[name]) >= 0 for name in self._names)
        self._left = self._left - 1 if touched else self._whole
        if self._left <= 0:
            self.state = state.copy()


def _snapshot(path: str) -> Findings:
    from itouch.scene import write
    from itouch.session import restore
    from itouch.session.open import read_session

    stored = read_session(path, Catalog())
    session = restore(path, opens=False)
    report = session.report()
    faults = report["faults"]
    timing = {"ticks": report["servo"]["ticks"], **_figures(session.statistics.histograms())}
    summary = _summary(report, faults, session.seconds, session.model)
    return Findings(
        os.path.basename(path), "snapshot", summary, report, faults, [], [], timing,
        _provenance(stored.manifest, {}), write(session.model.scene), None, session.model, session.state,
        list(session.notices),
    )  # fmt: skip


def _summary(
    report: Mapping[str, Any], faults: list[dict[str, Any]], seconds: float, model: Model | None = None
) -> dict[str, str]:
    contacts = report["contacts"]
    forces, gaps = _sizes(contacts, "peak_force_N"), _sizes(contacts, "plate_gap_mm")
    figures = report["table"].get("tracking_mm")
    tracking = figures.get("p99") if isinstance(figures, Mapping) else None
    found = {
        "duration": f"{seconds:.3f} s",
        "contacts": str(len(contacts)),
        "faults": str(len(faults)),
        "greatest force felt": f"{max(forces):.2f} N" if forces else None,
        "greatest plate gap": f"{max(gaps):.3f} mm" if gaps else None,
        "table within (p99)": f"{tracking:.2f} mm" if _finite(tracking) else None,
    }
    for one in measured(model, contacts):
        if one.maximum_label and (sizes := _sizes(contacts, one.key)):
            found[one.maximum_label] = f"{one.scale * max(sizes):.{one.digits}f} {one.shown_unit}".rstrip()
    return {name: value for name, value in found.items() if value is not None}


def _sizes(contacts: list[dict[str, Any]], key: str) -> list[float]:
    return [abs(contact[key]) for contact in contacts if _finite(contact.get(key))]


def _report(recorded: dict[str, Any] | None, replayed: dict[str, Any]) -> dict[str, Any]:
    """Return the recorded report; what it lacks, or what is malformed in it, is taken from the replay's."""
    if not isinstance(recorded, dict):
        return replayed
    found = {key: recorded[key] if isinstance(recorded.get(key), type(value)) else value
             for key, value in replayed.items()}  # fmt: skip
    for key in ("contacts", "faults", "devices"):
        entries = found[key].values() if key == "devices" else found[key]
        if not all(isinstance(entry, dict) for entry in entries):
            found[key] = replayed[key]
    if not all(map(_is_contact, found["contacts"])):
        found["contacts"] = replayed["contacts"]
    return found


def _is_contact(entry: Mapping[str, Any]) -> bool:
    """Tell whether an entry of a file has what the page needs of a contact; anything else in it is shown as it is."""
    begin, end = entry.get("begin_s"), entry.get("end_s", "")
    named = isinstance(entry.get("probe"), str) and isinstance(entry.get("object"), str)
    return named and _finite(begin) and (end is None or _finite(end))


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and -1e9 < value < 1e9


def _timing(recording: Recording, report: Mapping[str, Any]) -> dict[str, Any]:
    """Return how the loop kept time, under a report's keys: from the report, or from a cut recording's last note."""
    histograms = recording.histograms_us
    lost = {"lost": recording.timing[-1].get("lost")} if recording.timing else {}
    if recording.report is not None and isinstance(report["servo"], dict):
        return {**report["servo"], **lost, "histograms_us": histograms}
    if not recording.timing:
        return {}
    last = recording.timing[-1]
    percentiles = {name: last[name] for name in ("p50", "p99", "max") if name in last}
    return {"ticks": len(recording.ticks), "tick_us": percentiles, "overruns": last.get("overruns"), **lost,
            "histograms_us": histograms}  # fmt: skip


def _figures(histograms: dict[str, list[list[float]]]) -> dict[str, Any]:
    """Return histograms and their percentiles, to within the width of a bin, under a report's keys."""
    found: dict[str, Any] = {"histograms_us": histograms}
    for name, bins in histograms.items():
        total, seen = sum(count for _, _, count in bins), 0.0
        figures: dict[str, float] = {}
        for low, high, count in bins:
            seen += count
            for key, percent in (("p50", 50.0), ("p99", 99.0), ("p99.9", 99.9)):
                if key not in figures and seen >= percent / 100.0 * total:
                    figures[key] = (low * high) ** 0.5
        found[f"{name}_us"] = figures
    return found


def _provenance(manifest: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    twins = manifest.get("twins")
    told = {"scene": manifest.get("source"), **more, "itouch-py": manifest.get("itouch-py"),
            "session format": manifest.get("format"), "seed": manifest.get("seed"),
            "git": manifest.get("git")}  # fmt: skip
    if isinstance(twins, Mapping):
        told["simulated devices"] = ", ".join(str(name) for name, twin in twins.items() if twin)
        told["real devices"] = ", ".join(str(name) for name, twin in twins.items() if not twin)
    told |= {f"plugin {name}": version for name, version in (manifest.get("plugins") or {}).items()}
    told |= {f"host {name}": value for name, value in (manifest.get("host") or {}).items()}
    told |= {f"digest of {name}": manifest.get(name) for name in ("scene", "model", "layout")}
    return {name: value for name, value in told.items() if value not in (None, "", [], {})}


def _time(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
