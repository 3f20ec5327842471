"""A camera that orbits a point: its pose, its projection, and how the mouse moves it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

#: Named views: azimuth and elevation of the eye about the target [deg]; 0, 0 is from the operator's side.
VIEWS = {
    "operator": (0.0, 28.0),
    "side": (90.0, 8.0),
    "front": (0.0, 4.0),
    "top": (0.0, 89.9),
    "corner": (-35.0, 30.0),
}
#: The vertical field of view of the camera [rad].
FIELD_OF_VIEW = math.radians(36.0)
#: Share of the picture that a framed box may fill.
FILLED = 0.80


@dataclass(slots=True)
class Camera:
    """Looks at ``target`` [m] from ``distance`` [m]; ``azimuth`` and ``elevation`` in degrees.

    Azimuth 0 looks along +y, from the operator's side; it grows counter-clockwise seen from above.
    """

    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    distance: float = 0.6
    azimuth: float = 0.0
    elevation: float = 28.0
    aside: float = 0.0
    under: float = 0.0

    @property
    def eye(self) -> NDArray[np.float64]:
        """The position of the eye, shape (3,) [m]."""
        return np.array(self.target) + self.distance * self._outward()

    def _outward(self) -> NDArray[np.float64]:
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        flat = math.cos(elevation)
        return np.array([flat * math.sin(azimuth), -flat * math.cos(azimuth), math.sin(elevation)])

    def _axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Right, up and outward unit vectors of the picture in the world."""
        azimuth = math.radians(self.azimuth)
        outward = self._outward()
        right = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        return right, np.cross(outward, right), outward

    def view(self) -> Matrix:
        """Return the matrix (4, 4) from world to eye."""
        right, up, outward = self._axes()
        matrix = np.eye(4)
        matrix[:3, :3] = (right, up, outward)
        matrix[:3, 3] = -matrix[:3, :3] @ self.eye
        return matrix

    def projection(self, aspect: float) -> Matrix:
        """Return the perspective matrix (4, 4) for a picture of this width over height.

        The share ``aside`` of the picture's width, at its right, is kept free for what stands beside the scene, the
        share ``under`` of its height, at the bottom, for what stands below it.
        """
        near, far = self.distance * 0.02, self.distance * 50.0
        scale = 1.0 / math.tan(FIELD_OF_VIEW / 2)
        matrix = np.zeros((4, 4))
        matrix[0, 0], matrix[1, 1] = scale / aspect, scale
        matrix[0, 2], matrix[1, 2] = self.aside, -self.under
        matrix[2, 2], matrix[2, 3] = (far + near) / (near - far), 2 * far * near / (near - far)
        matrix[3, 2] = -1.0
        return matrix

    def orbit(self, right: float, up: float) -> None:
        """Turn the scene about the target by these angles [deg]."""
        self.azimuth = (self.azimuth - right + 180.0) % 360.0 - 180.0
        self.elevation = min(89.9, max(-89.9, self.elevation - up))

    def pan(self, right: float, up: float) -> None:
        """Move the scene in the picture's plane by these shares of the picture's height."""
        across, upward, _ = self._axes()
        height = 2 * self.distance * math.tan(FIELD_OF_VIEW / 2)
        moved = np.array(self.target) - height * (right * across + up * upward)
        self.target = (float(moved[0]), float(moved[1]), float(moved[2]))

    def zoom(self, steps: float) -> None:
        """Come nearer by this many steps of the mouse wheel."""
        self.distance = min(50.0, max(0.01, self.distance * 0.9**steps))

    def look(self, view: str) -> None:
        """Take one of the named views, see VIEWS; the target and the distance stay."""
        self.azimuth, self.elevation = VIEWS[view]

    def frame(self, low: NDArray[np.float64], high: NDArray[np.float64], aspect: float = 16 / 9) -> None:
        """Put the whole of a box in the middle of a picture of this width over height.

        ``low`` and ``high`` (3,) [m] are its corners.
        """
        middle = (low + high) / 2
        radius = max(0.01, float(np.linalg.norm(high - low)) / 2)
        corners = np.array([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
        view = self.view()[:3, :3]
        half = math.tan(FIELD_OF_VIEW / 2) * np.array([aspect * (1.0 - self.aside), 1.0 - self.under]) * FILLED
        right, up, out = ((corners - middle) @ view.T).T
        self.distance = radius
        for _ in range(4):  # the centre of the projected box depends on the distance
            depth = np.maximum(self.distance - out, 0.05 * radius)
            across = np.stack([right / depth, up / depth])
            centre = (across.min(1) + across.max(1)) / 2 * self.distance
            seen = np.stack([right - centre[0], up - centre[1]])
            self.distance = float((out + (np.abs(seen) / half[:, None]).max(0)).max())
        target = middle + centre[0] * view[0] + centre[1] * view[1]
        self.target = (float(target[0]), float(target[1]), float(target[2]))

    def metre(self, height: int) -> float:
        """Return the length in pixels of a metre at the target, in a picture of this height [pixels]."""
        return height / (2.0 * self.distance * math.tan(FIELD_OF_VIEW / 2))

    def project(self, point: NDArray[np.float64], width: int, height: int) -> tuple[float, float] | None:
        """Return where a point appears in a picture [pixels from the lower left]; None if it is behind the eye.

        ``point`` (3,) [m], ``width`` and ``height`` [pixels].
        """
        clip = self.projection(width / height) @ self.view() @ np.append(point, 1.0)
        if clip[3] <= 0.0:
            return None
        return float((clip[0] / clip[3] + 1) / 2 * width), float((clip[1] / clip[3] + 1) / 2 * height)
