"""The height map of a texture, read along the path of a finger that slides over it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.contact.heightmap import height_map
from itouch.plugin import poses
from itouch.world import Model
from itouch_tools.sound.modal import RATE

#: Heights are clipped to this many standard deviations of the map.
_HIGHEST = 2.0
#: Rate [samples of the map/s] above which a texture fades: what is finer than the ear's range must not alias.
_FADE = 16_000.0
#: In-plane axes of a map that is projected along x, y or z, as in ``itouch.contact.effects``.
_PLANES = ((1, 2), (0, 2), (0, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Relief:
    """A height map: ``heights`` of unit rms about zero, shape (rows, columns), and the size of a sample [m].

    ``axis`` is the axis of projection: 0 to 2 for x to z, or -1 for the one nearest to the surface's normal.
    """

    heights: NDArray[np.float64]
    pitch: float
    axis: int

    def rates(self, velocity: NDArray[np.float64], normal: NDArray[np.float64]) -> tuple[float, float]:
        """Return how fast the map goes by [samples/s] along columns and rows.

        ``velocity`` (3,) [m/s] and ``normal`` (3,) of length 1 are in the object's frame.
        """
        axis = self.axis if self.axis >= 0 else int(np.argmax(np.abs(normal)))
        u, v = (float(velocity[k]) / self.pitch for k in _PLANES[axis])
        return (u, -v) if math.isfinite(u) and math.isfinite(v) else (0.0, 0.0)


class Way(NamedTuple):
    """A relief and how fast it goes by [samples/s]."""

    relief: Relief
    columns: float
    rows: float


class TextureReader:
    """Reads the heights of a relief along a way, without steps in the sound, also where one relief follows another."""

    def __init__(self, follow: float) -> None:
        self._follow = follow
        self._relief: Relief | None = None
        self._place, self._rates, self._share = np.zeros(2), np.zeros(2), 0.0

    def read(self, way: Way | None, count: int) -> NDArray[np.float64] | None:
        """Return the next heights, shape (count,), or None where there is no relief."""
        wanted = way.relief if way is not None else None
        if self._share < 0.01:
            self._relief, self._share = wanted, 0.0
        if self._relief is None:
            return None
        left = np.exp(-np.arange(1, count + 1) / (self._follow * RATE))
        target = 1.0 if self._relief is wanted else 0.0
        rates = np.array((way.columns, way.rows)) if way is not None else np.zeros(2)
        target /= 1.0 + (float(np.abs(rates).max()) / _FADE) ** 4
        shares = target + left * (self._share - target)
        steps = (rates + np.outer(left, self._rates - rates)) / RATE
        places = self._place + np.cumsum(np.clip(steps, -1.0, 1.0), axis=0)
        self._share, self._rates = float(shares[-1]), steps[-1] * RATE
        self._place = places[-1] % np.array(self._relief.heights.shape[::-1])
        return _sampled(self._relief.heights, places) * shares


def _sampled(heights: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return heights (n,) at places (column, row), shape (n, 2): linear between samples; the map repeats."""
    rows, columns = heights.shape
    low = np.floor(places).astype(np.int64)
    s, t = (places - low).T
    i, j = low[:, 0] % columns, low[:, 1] % rows
    k, m = (i + 1) % columns, (j + 1) % rows
    made: NDArray[np.float64] = (1.0 - t) * ((1.0 - s) * heights[j, i] + s * heights[j, k]) + t * (
        (1.0 - s) * heights[m, i] + s * heights[m, k]
    )
    return made


def reliefs(model: Model) -> dict[str, Relief]:
    """Return the relief of each material whose texture is not flat, by the material's name."""
    files, found = {file.file: file.data for file in model.files}, {}
    for material in model.scene.materials:
        texture = material.texture
        if texture is None or texture.file not in files:
            continue
        heights = height_map(files[texture.file])
        spread = float(heights.std())
        if spread > 1e-6:
            unit = np.clip((heights - heights.mean()) / spread, -_HIGHEST, _HIGHEST)
            axis = {"x": 0, "y": 1, "z": 2}.get(texture.projection, -1)
            found[material.name] = Relief(unit, texture.width / heights.shape[1], axis)
    return found


def turned(pose: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a vector of the world in the frame of an object at this pose.

    ``pose`` (7,): position [m], quaternion; ``vector`` (3,) in any unit.
    """
    made: NDArray[np.float64] = poses.rotate(poses.conjugate(pose[3:]), vector)
    return made
