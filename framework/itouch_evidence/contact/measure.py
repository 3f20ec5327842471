"""Measures the time of one engine or peer library on one work."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from itouch.contact import Proxy, Surface
from itouch.contact.vectors import Floats
from itouch_evidence.contact.contact_workload import Work
from itouch_evidence.contact.peers import Peer

Made = TypeVar("Made")

PASSES = 3
_BUILDING = 2.0
CHUNK = 40  # steps of the compiled loop that are timed together
STIFFNESS = 1000.0
TOO_MUCH = 2.0  # a force of more than this many times the greatest right one counts as locked
_TETRAHEDRON = (np.eye(4)[:, :3], np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32))


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table; times are in microseconds per step or query, the best of three passes for each."""

    name: str
    p50_us: float
    p99_us: float
    max_us: float
    build_ms: float | None = None
    memory_mb: float | None = None
    locked: int | None = None
    force_in_free_space: int | None = None
    popped_through: int | None = None
    outside_cone: int | None = None
    error_p99_n: float | None = None

    def as_dict(self) -> dict[str, object]:
        """Return the row as plain data, without what was not measured."""
        return {key: value for key, value in asdict(self).items() if value is not None}


def resident_mb() -> float:
    """Return the resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def building(make: Callable[[], Made]) -> tuple[Made, float, float]:
    """Make something up to three times within two seconds; return it, the least time [ms], and its memory [MB]."""
    before, spent = resident_mb(), []
    while True:
        begin = time.perf_counter()
        made = make()
        spent.append(time.perf_counter() - begin)
        if len(spent) == 1:
            memory = resident_mb() - before
        if len(spent) == PASSES or sum(spent) > _BUILDING:
            return made, min(spent) * 1e3, memory


def times(call: Callable[[Floats], object], start: Callable[[], object], points: Floats) -> Floats:
    """Return the time of each call (n,) [s], the least of three passes over the same points (n, 3) [m]."""
    best = np.full(len(points), np.inf)
    clock = time.perf_counter
    for turn in range(PASSES + 1):
        start()
        for i, point in enumerate(points):
            begin = clock()
            call(point)
            spent = clock() - begin
            if turn > 0 and spent < best[i]:
                best[i] = spent
    return best


def _row(name: str, seconds: Floats, **more: float | None) -> Row:
    us = seconds * 1e6
    return Row(name, float(np.median(us)), float(np.percentile(us, 99)), float(us.max()), **more)  # type: ignore[arg-type]


def closest_row(surface: Surface, work: Work, build_ms: float, memory_mb: float) -> Row:
    """Measure the search for the closest point alone, called from Python."""
    seconds = times(surface.closest, lambda: None, work.hips)
    return _row("itouch closest", seconds, build_ms=build_ms, memory_mb=memory_mb)


def proxy_rows(surface: Surface, work: Work, friction: tuple[float, float]) -> list[Row]:
    """Measure a step called from Python, and a step inside the compiled loop while in contact."""
    proxy = Proxy(surface, radius=work.radius, stiffness=STIFFNESS, static_friction=friction[0],
                  dynamic_friction=friction[1])  # fmt: skip
    first = work.hips[0]
    forces = np.concatenate([[proxy.reset(first)], proxy.follow(work.hips[1:])])
    size = np.linalg.norm(forces, axis=1)
    _, away, _ = surface.closest(work.hips)
    right = STIFFNESS * np.maximum(work.radius - away, 0.0)
    error = None if friction[0] > 0 else float(np.percentile(np.abs(size - right), 99))
    through = _through(surface, work, forces, away)
    kind = f"friction {friction[0]:g}/{friction[1]:g}" if friction[0] > 0 else "no friction"
    called = _row(
        f"itouch step, {kind}",
        times(proxy.step, lambda: proxy.reset(first), work.hips),
        locked=int((size > TOO_MUCH * right.max()).sum()),
        force_in_free_space=int((size[away >= work.radius] > 1e-9).sum()),
        popped_through=through,
        outside_cone=_outside_cone(proxy, work, friction[0]),
        error_p99_n=error,
    )
    return [called, *_looped(proxy, work, size, kind)]


def _through(surface: Surface, work: Work, forces: Floats, away: Floats) -> int:
    """Count steps whose proxy has sunk in, or that press without any force: the probe has popped through."""
    proxies = work.hips + forces / STIFFNESS
    _, clear, _ = surface.closest(proxies)
    slack = 1e-4 * work.radius
    unheld = (away < work.radius - slack) & (np.linalg.norm(forces, axis=1) == 0.0)
    return int(((clear < work.radius - slack) | unheld).sum())


def _outside_cone(proxy: Proxy, work: Work, friction: float) -> int:
    """Count steps whose force lies outside the cone of static friction about the normal force."""
    count = 0
    proxy.reset(work.hips[0])
    for hip in work.hips:
        force, normal = proxy.step(hip), proxy.normal
        push = float(force @ normal)
        aside = float(np.linalg.norm(force - push * normal))
        count += aside > friction * push * (1 + 1e-6) + 1e-9
    return count


def _looped(proxy: Proxy, work: Work, size: Floats, kind: str) -> list[Row]:
    chunks = [slice(i, i + CHUNK) for i in range(0, len(work.hips) - CHUNK, CHUNK)]
    best = np.full(len(chunks), np.inf)
    for turn in range(PASSES + 1):
        proxy.reset(work.hips[0])
        for i, chunk in enumerate(chunks):
            begin = time.perf_counter()
            proxy.follow(work.hips[chunk])
            spent = (time.perf_counter() - begin) / CHUNK
            if turn > 0:
                best[i] = min(best[i], spent)
    touching = np.array([(size[chunk] > 0).all() for chunk in chunks], dtype=bool)
    if not touching.any():
        return []
    return [_row(f"itouch step in the compiled loop, in contact, {kind}", best[touching])]


def peer_row(name: str, peer: Peer, work: Work, most: int) -> Row:
    """Measure a query of another library, ``most`` of them at most."""
    peer(*_TETRAHEDRON, work.radius)  # what a library does only once is not counted
    query, built, memory = building(lambda: peer(work.vertices, work.faces, work.radius))
    seconds = times(query, lambda: None, work.hips[:: max(1, len(work.hips) // most)])
    return _row(name, seconds, build_ms=built, memory_mb=memory)
