"""The encountered-type rule: a table carries a plate to where the virtual surface under the finger is.

With s the height at which the finger would rest on the highest virtual surface below it, f the lowest point of the
probe and c the clearance, the plate's top is commanded to max(s, f - c); x and y follow the finger.  Where the plate
renders the contact, the arm gives the tangential force only, so that no force is given twice.
"""

from __future__ import annotations

import math

import numpy as np

from itouch.contact.cast import sphere_cast
from itouch.loop.frames import Frame, Vector
from itouch.loop.runner import Runner
from itouch.loop.touch import Toucher
from itouch.plugin import Record
from itouch.world import Model, ProbeModel
from itouch.world import limits as default

#: Gap [m] over which the arm takes over the normal force from a plate that is too low.
HAND_OVER = 1e-3
#: How fast the plate yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
_REACH = 0.2


class Surface:
    """Carries the plate of one probe on its part of State."""

    def __init__(self, model: Model, probe: ProbeModel, state: Record, table: Runner, face: Runner) -> None:
        self.model, self.probe, self.table, self.face = model, probe, table, face
        name = probe.name
        self.height, self.gap = state[f"{name}.surface_height"], state[f"{name}.plate_gap"]
        self.plate, self.given_way = state[f"{name}.plate"], state[f"{name}.plate_yield"]
        self.top = state[f"{name}.plate_top"]
        self._poses = state["objects.pose"]
        self.offset = _offset(face, table)
        self._cosine = math.cos(probe.scene.plate_angle)
        self._down = np.array([0.0, 0.0, -1.0])
        self._start, self._normal = np.zeros(3), np.zeros(3)
        self._position, self._target = table.reading["pose"][:3], table.command["pose_target"]
        self._felt = table.reading["wrench"] if "wrench" in table.reading else None  # noqa: SIM401  not a dict

    def plate_frame(self) -> Frame:
        """Return the frame of the plate's top in the world, as readings and calibration say."""
        base = self.table.base_frame()
        x, y, z = self._position.tolist()
        ox, oy, oz = self.offset
        x, y, z = base.point((x + ox, y + oy, z + oz))
        return Frame(x, y, z, base.r)

    def update(self, toucher: Toucher) -> None:
        """Find the virtual surface under the finger, and command the plate to it."""
        radius, clearance = self.probe.scene.radius, self.probe.scene.clearance
        hip = toucher.hip.tolist()
        lowest = hip[2] - radius
        height = self._surface(hip, radius)
        self.height[...] = height
        frame = self.plate_frame()
        top = frame.z
        self.top[...] = top
        self.gap[...] = height - top if height > -math.inf else math.inf
        self.plate[...] = self._renders(toucher, frame)
        wanted = max(height, lowest - clearance) - self._yield()
        base = self.table.base_frame()
        x, y, z = base.into((hip[0], hip[1], wanted))
        self._target[:] = (x - self.offset[0], y - self.offset[1], z - self.offset[2], 1.0, 0.0, 0.0, 0.0)
        near = lowest - top < default.NEAR
        limits = self.table.model.limits
        self.table.closing = (limits.speed_near if near else limits.speed) or 0.0

    def _surface(self, hip: list[float], radius: float) -> float:
        """Return the height at which the probe's lowest point would rest on the surface below it; -inf if none."""
        if not self.model.objects:
            return -math.inf
        self._start[:] = hip
        geometry = self.model.geometry
        distance, _ = sphere_cast(
            geometry.world, geometry.mesh, self._poses, self._start, self._down, radius, _REACH, self._normal
        )
        return hip[2] - radius - distance if distance < _REACH else -math.inf

    def _renders(self, toucher: Toucher, frame: Frame) -> int:
        """Tell whether the plate renders the contact: the normals agree within the angle."""
        if toucher.object.item() < 0:
            return 0
        nx, ny, nz = toucher.normal.tolist()
        r = frame.r
        return int(nx * r[2] + ny * r[5] + nz * r[8] >= self._cosine)

    def _yield(self) -> float:
        """Give way while the plate presses harder than it may."""
        given: float = self.given_way.item()
        if self._felt is None:
            return given
        force = abs(self._felt[2].item())
        period = self.model.period
        if force > default.PLATE_FORCE:
            given += YIELD_RATE * (force - default.PLATE_FORCE) * period
        elif given > 0.0 and force < 0.9 * default.PLATE_FORCE:
            given = max(0.0, given - YIELD_RETURN * period)
        self.given_way[...] = given
        return given

    def share(self, force: Vector, toucher: Toucher) -> Vector:
        """Return the arm's part of the contact force: where the plate renders, the normal part only across a gap."""
        if not self.plate.item():
            return force
        weight = min(1.0, max(0.0, self.gap.item() / HAND_OVER))
        nx, ny, nz = toucher.normal.tolist()
        along = (force[0] * nx + force[1] * ny + force[2] * nz) * (1.0 - weight)
        return (force[0] - along * nx, force[1] - along * ny, force[2] - along * nz)


def _offset(face: Runner, table: Runner) -> Vector:
    """Return where the plate's top is in the frame of what the table carries."""
    if face is table:
        return (0.0, 0.0, 0.0)
    x, y, z = face.model.mount[:3]
    return (x, y, z)
