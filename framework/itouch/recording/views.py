"""What 3-D viewers draw of a recording: solids once, the poses of their frames and the forces thirty times a second.

Viewers know the two schemas and need no plugin.  Frames are named after objects, probes and devices; solids are fixed
to frames, so that only frames move.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from itouch.recording.wellknown import descriptor, encode

#: Topic -> name of its schema.  Solids have a topic of their own: a viewer that jumps to another time asks for the
#: newest message of each topic before it, which would no longer be the solids once a force was drawn.
TRANSFORMS, SOLIDS, SCENE = "/view/transforms", "/view/solids", "/view/scene"
TOPICS: Final[Mapping[str, str]] = {TRANSFORMS: "FrameTransforms", SOLIDS: "SceneUpdate", SCENE: "SceneUpdate"}
#: How often frames and forces are written [Hz].
RATE: Final = 30.0
#: The frame in which all is.
WORLD: Final = "world"
#: Length of a force arrow per newton [m/N], its greatest length [m], and the smallest force that is shown [N].
ARROW_PER_NEWTON, ARROW_MAX, FORCE_LEAST = 0.02, 0.08, 0.01
#: Colours of the arrows of force, and of a material that states none: also those of the window.
FORCE, UNPAINTED = (0.95, 0.90, 0.35), (0.62, 0.62, 0.64)
_WORDS = (0.95, 0.95, 0.95, 1.0)


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame that moves, and its pose in its parent.

    Attributes
    ----------
    field, first, size
        The numbers of State with its pose (7) or position (3), beginning with number ``first`` of the field.
    fixed
        A fixed pose (7) between the parent and that pose, such as that of a mount; empty: none.
    """

    name: str
    parent: str
    field: str
    first: int
    size: int
    fixed: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Solid:
    """A shape in a frame: ``box`` (three edges), ``ball`` (radius), ``rod`` (radius, half length), ``skin`` (mesh)."""

    name: str
    frame: str
    kind: str
    sizes: tuple[float, ...]
    colour: tuple[float, ...]
    pose: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    #: Of a mesh, as base64: points (n, 3) as float32, corners (m, 3) as uint32.
    points: str = ""
    corners: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True)
class Force:
    """A force of three numbers of State, drawn at the origin of a frame, in the axes of the world."""

    name: str
    frame: str
    field: str


@dataclass(frozen=True, slots=True)
class TemperatureLabel:
    """A temperature [K] of State, written at a frame."""

    name: str
    frame: str
    field: str


@dataclass(frozen=True, slots=True)
class View:
    """Everything that is drawn of a session."""

    frames: tuple[Frame, ...] = ()
    solids: tuple[Solid, ...] = ()
    forces: tuple[Force, ...] = ()
    #: The name ``warmths`` is that in recordings.
    warmths: tuple[TemperatureLabel, ...] = ()

    @property
    def fields(self) -> list[str]:
        """The fields of State that it needs."""
        listed = [frame.field for frame in self.frames] + [force.field for force in self.forces]
        return list(dict.fromkeys(listed + [warmth.field for warmth in self.warmths]))

    def dump(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)

    @classmethod
    def load(cls, data: Mapping[str, Any]) -> View:
        """Return it from plain data."""
        parts = {"frames": Frame, "solids": Solid, "forces": Force, "warmths": TemperatureLabel}
        found: dict[str, Any] = {}
        for key, kind in parts.items():
            plain = ({k: tuple(v) if isinstance(v, list) else v for k, v in item.items()} for item in data[key])
            found[key] = tuple(kind(**item) for item in plain)
        return cls(**found)


class Drawing:
    """Makes the messages of one recording from rows of State; there is a row of every ``step``-th tick."""

    def __init__(self, view: View, places: Mapping[str, int], *, period: float, start_ns: int, step: int = 1) -> None:
        self._view, self._places, self._start = view, places, start_ns
        self._period, self._every = period, step * max(1, round(1.0 / (RATE * period * step)))
        self._begun = False
        self._drawn: set[str] = set()

    def messages(self, ticks: NDArray[np.int64], rows: NDArray[np.uint8]) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, tick and bytes for rows (n, bytes) of ticks (n,); rows between two pictures are skipped."""
        if not self._view.frames and not self._view.solids:
            return
        due = ticks % self._every == 0
        if not self._begun and len(ticks):
            due[0] = True
        for tick, row in zip(ticks[due].tolist(), rows[due], strict=True):
            stamp = self._stamp(tick)
            yield TRANSFORMS, tick, encode("FrameTransforms", {"transforms": self.transforms(row, stamp)})
            if not self._begun and self._view.solids:
                solids = [_entity(solid, stamp) for solid in self._view.solids]
                yield SOLIDS, tick, encode("SceneUpdate", {"entities": solids})
            self._begun = True
            now = self._marks(row, stamp)
            marks = {"entities": now, "deletions": self._gone(now, stamp)}
            if marks["entities"] or marks["deletions"]:
                yield SCENE, tick, encode("SceneUpdate", marks)

    def _stamp(self, tick: int) -> dict[str, int]:
        nanoseconds = self._start + max(0, round(tick * self._period * 1e9))
        return {"seconds": nanoseconds // 10**9, "nanos": nanoseconds % 10**9}

    def _numbers(self, row: NDArray[np.uint8], field: str, first: int, size: int) -> list[float]:
        at = self._places[field] + 8 * first
        found: list[float] = row[at : at + 8 * size].copy().view(np.float64).tolist()
        return found

    def transforms(self, row: NDArray[np.uint8], stamp: Mapping[str, int]) -> list[dict[str, Any]]:
        """Return the poses of the frames in a row of State (bytes,), as contents of ``foxglove.FrameTransform``."""
        found = []
        for frame in self._view.frames:
            place = self._numbers(row, frame.field, frame.first, frame.size)
            if not all(map(math.isfinite, place)):
                continue
            pose = [*place, 1.0, 0.0, 0.0, 0.0] if frame.size == 3 else place
            whole = _after(frame.fixed, pose) if frame.fixed else pose
            found.append({"timestamp": stamp, "parent_frame_id": frame.parent, "child_frame_id": frame.name,
                          **_pose(whole, "translation", "rotation")})  # fmt: skip
        return found

    def _marks(self, row: NDArray[np.uint8], stamp: Mapping[str, int]) -> list[dict[str, Any]]:
        found = []
        for force in self._view.forces:
            vector = self._numbers(row, force.field, 0, 3)
            if _shown(vector):
                found.append({**_head(force.name, force.frame, stamp), "arrows": [_arrow(vector)]})
        for warmth in self._view.warmths:
            (kelvin,) = self._numbers(row, warmth.field, 0, 1)
            if math.isfinite(kelvin) and kelvin > 0.0:
                said = {"pose": _pose((0, 0, 0.012, 1, 0, 0, 0)), "billboard": True, "font_size": 12.0,
                        "scale_invariant": True, "color": _colour(_WORDS),
                        "text": f"{kelvin - 273.15:.1f} °C"}  # fmt: skip
                found.append({**_head(warmth.name, warmth.frame, stamp), "texts": [said]})
        return found

    def _gone(self, now: Sequence[Mapping[str, Any]], stamp: Mapping[str, int]) -> list[dict[str, Any]]:
        """Return the deletions of what was drawn before and is not drawn now."""
        names = {str(entity["id"]) for entity in now}
        gone, self._drawn = sorted(self._drawn - names), names
        return [{"timestamp": stamp, "type": 0, "id": name} for name in gone]


def schema(topic: str) -> tuple[str, bytes]:
    """Return full name and descriptor of a topic's schema."""
    return f"foxglove.{TOPICS[topic]}", descriptor(TOPICS[topic])


def packed(points: NDArray[Any], corners: NDArray[Any]) -> dict[str, str]:
    """Return the fields of a mesh for ``Solid``: points (n, 3) [m] and corners (m, 3) as base64."""
    pairs = (("points", points.astype("<f4")), ("corners", corners.astype("<u4")))
    return {name: base64.b64encode(np.ascontiguousarray(array).tobytes()).decode() for name, array in pairs}


def arrow_of(vector: Sequence[float]) -> tuple[float, float, float] | None:
    """Return the arrow [m] that shows a force [N], from its start to its end; None if it is too small to be shown."""
    if not _shown(vector):
        return None
    size = math.hypot(*vector)
    x, y, z = (part * min(ARROW_MAX, ARROW_PER_NEWTON * size) / size for part in vector)
    return x, y, z


def _shown(vector: Sequence[float]) -> bool:
    return all(map(math.isfinite, vector)) and math.hypot(*vector) >= FORCE_LEAST


def _head(name: str, frame: str, stamp: Mapping[str, int]) -> dict[str, Any]:
    return {"timestamp": stamp, "frame_id": frame, "id": name, "frame_locked": True}


def _pose(pose: Sequence[float], position: str = "position", orientation: str = "orientation") -> dict[str, Any]:
    x, y, z, w, i, j, k = (float(number) for number in pose)
    return {position: {"x": x, "y": y, "z": z}, orientation: {"x": i, "y": j, "z": k, "w": w}}


def _colour(colour: Sequence[float]) -> dict[str, float]:
    return dict(zip("rgba", (*colour, 1.0)[:4], strict=True))


def _after(first: Sequence[float], second: Sequence[float]) -> list[float]:
    """Return the pose (7,) of ``second`` in the frame of ``first``."""
    turn, offset = np.asarray(first[3:]), np.asarray(second[:3])
    w, u = turn[0], turn[1:]
    moved = offset + 2.0 * np.cross(u, np.cross(u, offset) + w * offset) + np.asarray(first[:3])
    v, s = np.asarray(second[4:]), second[3]
    return [*moved.tolist(), float(w * s - u @ v), *(w * v + s * u + np.cross(u, v)).tolist()]


def _entity(solid: Solid, stamp: Mapping[str, int]) -> dict[str, Any]:
    said = {**_head(solid.name, solid.frame, stamp),
            "metadata": [{"key": "note", "value": solid.note}] if solid.note else []}  # fmt: skip
    pose, colour = _pose(solid.pose), _colour(solid.colour)
    if solid.kind == "box":
        return {**said, "cubes": [{"pose": pose, "size": _edges(solid.sizes), "color": colour}]}
    if solid.kind == "ball":
        return {**said, "spheres": [{"pose": pose, "size": _edges((2 * solid.sizes[0],) * 3), "color": colour}]}
    if solid.kind == "rod":
        radius, half = solid.sizes
        shape = {"pose": pose, "size": _edges((2 * radius, 2 * radius, 2 * half)), "bottom_scale": 1.0,
                 "top_scale": 1.0, "color": colour}  # fmt: skip
        return {**said, "cylinders": [shape]}
    points = np.frombuffer(base64.b64decode(solid.points), "<f4").reshape(-1, 3).tolist()
    corners = np.frombuffer(base64.b64decode(solid.corners), "<u4").tolist()
    skin = {"pose": pose, "points": [dict(zip("xyz", point, strict=True)) for point in points], "color": colour,
            "indices": corners}  # fmt: skip
    return {**said, "triangles": [skin]}


def _edges(sizes: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", sizes, strict=True))


def _arrow(vector: Sequence[float]) -> dict[str, Any]:
    """Return the arrow of a force [N]; the schema's arrows point along x, and are turned to the force."""
    size = math.hypot(*vector)
    x, y, z = (part / size for part in vector)
    turn = (1.0 + x, 0.0, -z, y) if x > -1.0 + 1e-9 else (0.0, 0.0, 0.0, 1.0)
    norm = math.hypot(*turn)
    length = math.hypot(*(arrow_of(vector) or (0.0, 0.0, 0.0)))
    head = min(0.35 * length, 0.008)
    return {"pose": _pose((0, 0, 0, *(part / norm for part in turn))), "shaft_length": length - head,
            "shaft_diameter": 0.0024, "head_length": head, "head_diameter": 0.006,
            "color": _colour((*FORCE, 1.0))}  # fmt: skip
