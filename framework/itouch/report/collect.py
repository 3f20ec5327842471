"""What a session's page tells: figures, contacts and curves, out of a recording or a snapshot."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.viewer.signals import Chart, Signal, charts
from itouch.world import Model

#: Samples of a curve at most; a longer session is thinned out.
MOST = 20_000


@dataclass(slots=True)
class Curves:
    """Charts with their sampled signals; ``values`` has one row a signal of all charts in order."""

    charts: tuple[Chart, ...]
    times: NDArray[np.float64]
    values: NDArray[np.float64]


@dataclass(slots=True)
class Findings:
    """All that the page shows."""

    title: str
    kind: str
    summary: dict[str, Any]
    contacts: list[dict[str, Any]]
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


class Sampler:
    """Reads the signals of a model every so many ticks."""

    def __init__(self, model: Model, ticks: int) -> None:
        self.charts = (*charts(model), *_gaps(model))
        self._signals = [signal for chart in self.charts for signal in chart.signals]
        self._every, self._period = max(1, -(-ticks // MOST)), model.period
        self._times: list[float] = []
        self._rows: list[list[float]] = []
        self._count = 0

    def add(self, state: Record) -> None:
        """Take a sample, if one is due."""
        if self._count % self._every == 0:
            self._times.append(int(state["tick"]) * self._period)
            self._rows.append([signal.read(state) for signal in self._signals])
        self._count += 1

    def curves(self) -> Curves:
        """Return what was sampled."""
        values = np.array(self._rows, float).reshape(len(self._rows), len(self._signals)).T
        return Curves(self.charts, np.array(self._times), values)


def _gaps(model: Model) -> tuple[Chart, ...]:
    found = tuple(
        Signal(probe.name, (0.0, 0.0, 0.0), _millimetres(f"{probe.name}.plate_gap"))
        for probe in model.probes
        if probe.scene.surface_to
    )
    return (Chart("gap between plate and virtual surface", "mm", found, 0.1),) if found else ()


def _millimetres(key: str) -> Any:
    return lambda state: float(state[key]) * 1e3


def collect(path: str | os.PathLike[str]) -> Findings:
    """Return what a recording (.mcap) or a snapshot (.itouch) tells.

    A recording is replayed, so that all of State is known at every tick, not only what was recorded.

    Raises
    ------
    ItouchError
        If the file can't be read.
    """
    name = os.fspath(path)
    return _recording(name) if name.endswith(".mcap") else _snapshot(name)


def _recording(path: str) -> Findings:
    from itouch.recording import read
    from itouch.session.replay import Replay

    recording = read(path)
    work = Replay(recording)
    sampler = Sampler(work.session.model, len(recording.ticks))
    while work.step():
        sampler.add(work.session.state)
    outcome, report = work.outcome(), work.session.report()
    summary = _summary(report, recording.duration)
    summary["replayed"] = f"{outcome.mismatches} of {outcome.compared} commands differ"
    return Findings(
        os.path.basename(path), "recording", summary, report["contacts"], recording.faults, recording.marks,
        list(recording.losses), _timing(recording.timing), _provenance(dict(recording.session.get("manifest", {}))),
        recording.scene, sampler.curves(), work.session.model, work.session.state, list(work.session.notices),
    )  # fmt: skip


def _snapshot(path: str) -> Findings:
    from itouch.session import restore
    from itouch.session.open import read_session

    stored = read_session(path, Catalog())
    session = restore(path)
    report = session.report()
    from itouch.scene import write

    return Findings(
        os.path.basename(path), "snapshot", _summary(report, session.seconds), report["contacts"], report["faults"], [],
        [], dict(report["servo"]), _provenance(stored.manifest), write(session.model.scene), None, session.model,
        session.state, list(session.notices),
    )  # fmt: skip


def _summary(report: dict[str, Any], seconds: float) -> dict[str, Any]:
    contacts = report["contacts"]
    forces = [c["peak_force_N"] for c in contacts if c.get("peak_force_N") is not None]
    gaps = [abs(c["plate_gap_mm"]) for c in contacts if c.get("plate_gap_mm") is not None]
    errors = [c["flux_error_rms"] for c in contacts if c.get("flux_error_rms") is not None]
    tracking = report["table"]["tracking_mm"]["p99"]
    return {
        "duration": f"{seconds:.3f} s",
        "contacts": str(len(contacts)),
        "faults": str(len(report["faults"])),
        "greatest force": f"{max(forces):.2f} N" if forces else "-",
        "greatest plate gap": f"{max(gaps):.3f} mm" if gaps else "-",
        "table within (p99)": f"{tracking:.2f} mm" if tracking is not None else "-",
        "greatest flux error (rms)": f"{100 * max(errors):.1f} %" if errors else "-",
    }


def _timing(letters: list[dict[str, Any]]) -> dict[str, Any]:
    return dict(letters[-1]) if letters else {}


def _provenance(manifest: dict[str, Any]) -> dict[str, Any]:
    told = {"scene": manifest.get("source"), "itouch-py": manifest.get("itouch-py"), "format": manifest.get("format"),
            "seed": manifest.get("seed"), "twins": manifest.get("twins"), "git": manifest.get("git")}  # fmt: skip
    told |= {f"plugin {name}": version for name, version in (manifest.get("plugins") or {}).items()}
    told |= {f"host {name}": value for name, value in (manifest.get("host") or {}).items()}
    told |= {f"digest {name}": value for name, value in manifest.items() if name.endswith("digest")}
    return {name: value for name, value in told.items() if value not in (None, "", [], {})}
