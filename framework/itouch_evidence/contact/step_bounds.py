"""The bounds on the time of a contact step, and whether a run kept them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

from itouch_evidence.contact.measure import Row

#: Time of a step of CHAI3D 3.3.0 with friction, 99th percentile [us], measured once for these surfaces on one machine;
#: and the share of it that is allowed.
CHAI3D = {"10k": (12.0, 0.45), "100k": (86.0, 0.1), "1M": (1005.0, 0.02)}
#: Greatest time of a step in the compiled loop, in contact, median [us].
LOOP = {"10k": 1.0, "100k": 1.5, "1M": 3.0}
SHARE_OF_OPEN3D = 0.7
BUILD_OF_OPEN3D, BUILD_MEMORY_MB = 2.5, 150.0
FORCE_ERROR_N = 0.1


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure that is judged: ``measured`` must be at most ``limit``."""

    work: str
    name: str
    measured: float
    limit: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the limit is kept."""
        return self.measured <= self.limit

    def as_dict(self) -> dict[str, object]:
        """Return the figure as plain data, with its verdict."""
        return {**asdict(self), "pass": self.passed}

    def line(self) -> str:
        """Return the figure as a line of the table."""
        verdict = "pass" if self.passed else "FAIL"
        return f"  {verdict}  {self.work:<10} {self.name:<66} {self.measured:9.3g} <= {self.limit:g} {self.unit}"


def judged(work: str, size: str, rows: Sequence[Row], *, smooth: bool) -> Iterator[Figure]:
    """Judge the rows of one work.

    Parameters
    ----------
    work
        The work's name.
    size
        "10k", "100k" or "1M" for the standard height fields, else empty: no absolute times are judged.
    rows
        The measurements.
    smooth
        Whether the force without friction must be that of the exact penetration.
    """
    by_name = {row.name: row for row in rows}
    open3d = by_name.get("open3d compute_closest_points")
    for kind in ("friction 0.5/0.3", "no friction"):
        step = by_name.get(f"itouch step, {kind}")
        if step is None:
            continue
        yield from _correct(work, kind, step, smooth)
        if kind != "no friction":
            yield from _fast(work, size, step, open3d)
    loop = by_name.get("itouch step in the compiled loop, in contact, friction 0.5/0.3")
    if loop is not None and size in LOOP:
        yield Figure(work, "step in the compiled loop, p50 in contact", loop.p50_us, LOOP[size], "us")
    search = by_name.get("itouch closest")
    if search is not None and search.build_ms and search.memory_mb is not None and size == "1M":
        if open3d is not None and open3d.build_ms:
            share = search.build_ms / open3d.build_ms
            yield Figure(work, "build of the hierarchy over open3d's scene", share, BUILD_OF_OPEN3D, "times")
        yield Figure(work, "memory of the hierarchy and its building", search.memory_mb, BUILD_MEMORY_MB, "MB")


def _correct(work: str, kind: str, step: Row, smooth: bool) -> Iterator[Figure]:
    for name, count in (
        ("locked steps", step.locked),
        ("steps with force in free space", step.force_in_free_space),
        ("steps through the surface", step.popped_through),
        ("steps outside the friction cone", step.outside_cone),
    ):
        if count is not None:
            yield Figure(work, f"{name}, {kind}", float(count), 0.0, "steps")
    if smooth and step.error_p99_n is not None:
        name = "spring force against k x exact penetration, p99, no friction"
        yield Figure(work, name, step.error_p99_n, FORCE_ERROR_N, "N")


def _fast(work: str, size: str, step: Row, open3d: Row | None) -> Iterator[Figure]:
    if size in CHAI3D:
        theirs, share = CHAI3D[size]
        name = f"step from Python with friction, p99, over CHAI3D's {theirs:g} us"
        yield Figure(work, name, step.p99_us / theirs, share, "times")
    if open3d is not None:
        name = "step from Python with friction, p99, over open3d's closest point"
        yield Figure(work, name, step.p99_us / open3d.p99_us, SHARE_OF_OPEN3D, "times")
