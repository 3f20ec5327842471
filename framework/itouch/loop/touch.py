"""The contact modality: HIP -> proxy -> force and events of one probe.

The proxy's spring force comes from the contact engine; damping is added here, where time is known.  BEGIN and END
are those of the virtual contact: it ends after 0.1 mm and 20 ms of separation, or when another object takes over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from itouch.contact import layout as at
from itouch.contact.step import step
from itouch.loop.frames import Vector
from itouch.plugin import Contact, ContactEvent, Record
from itouch.world import Model, ProbeModel

#: A contact has ended when the probe was this far away [m], for this long [s].
SEPARATION, SEPARATION_TIME = 1e-4, 0.020
#: Time constant [s] of the filter on the HIP's velocity.
VELOCITY_FILTER = 0.002

Listener = Callable[[ContactEvent], None]


class Toucher:
    """Renders the contact of one probe on its part of State."""

    def __init__(self, model: Model, probe: ProbeModel, state: Record) -> None:
        self.model, self.probe, self._state = model, probe, state
        name = probe.name
        self.hip, self.velocity = state[f"{name}.hip"], state[f"{name}.velocity"]
        self.proxy, self.normal = state[f"{name}.proxy"], state[f"{name}.normal"]
        self.force, self.point = state[f"{name}.force"], state[f"{name}.point"]
        self.memory, self.result = state[f"{name}.memory"], state[f"{name}.result"]
        self.penetration, self.normal_force = state[f"{name}.penetration"], state[f"{name}.normal_force"]
        self.object, self.near_object = state[f"{name}.object"], state[f"{name}.near_object"]
        self.near_distance, self.time_to_contact = state[f"{name}.near_distance"], state[f"{name}.time_to_contact"]
        self.current, self.separated = state[f"{name}.contact.object"], state[f"{name}.contact.separated"]
        self.begin = state[f"{name}.contact.begin"]
        self._world, self._mesh = model.geometry.world, model.geometry.mesh
        self._poses, self._twists = state["objects.pose"], state["objects.twist"]
        self._stiffness = _stiffness(probe)
        self._damping = [coupling.damping for coupling in probe.coupling]
        self._newest: list[float] = self.result.tolist()
        self._patience = round(SEPARATION_TIME / model.period)
        self._smooth = 1.0 - math.exp(-model.period / VELOCITY_FILTER)

    def reset(self) -> None:
        """Begin without contact."""
        for view in (self.object, self.near_object, self.current):
            view[...] = -1
        self.begin[...] = -1
        self.near_distance[...] = math.inf
        self.time_to_contact[...] = math.inf

    def update(self, position: Vector, first: bool) -> Vector:
        """Follow the HIP to ``position`` [m]; return the contact force on the operator [N], world frame."""
        hip, velocity, period = self.hip.tolist(), self.velocity.tolist(), self.model.period
        if not first:
            smooth = self._smooth
            for i in range(3):
                velocity[i] += smooth * ((position[i] - hip[i]) / period - velocity[i])
            self.velocity[:] = velocity
        self.hip[:] = position
        if not self.model.objects:
            return (0.0, 0.0, 0.0)
        step(
            self._world, self._mesh, self._poses, self._twists, self._stiffness, self.hip, self.probe.scene.radius,
            self.probe.scene.near, self.memory, self.result,
        )  # fmt: skip
        self._newest = self.result.tolist()
        return self._take_over(self._newest, velocity)

    def _take_over(self, result: list[float], velocity: list[float]) -> Vector:
        fx, fy, fz = result[0:3]
        nx, ny, nz = result[at.RESULT_NORMAL : at.RESULT_NORMAL + 3]
        self.proxy[:] = result[at.RESULT_PROXY : at.RESULT_PROXY + 3]
        primary = int(result[at.RESULT_PRIMARY])
        self.object[...] = primary
        self._approach(result, velocity)
        if primary < 0:
            if self.normal_force.item() or self.penetration.item():
                self.force[:] = 0.0
                self.normal_force[...] = 0.0
                self.penetration[...] = 0.0
            return (0.0, 0.0, 0.0)
        surface = result[at.RESULT_SURFACE_VELOCITY : at.RESULT_SURFACE_VELOCITY + 3]
        spring = fx * nx + fy * ny + fz * nz
        closing = (velocity[0] - surface[0]) * nx + (velocity[1] - surface[1]) * ny + (velocity[2] - surface[2]) * nz
        push = max(0.0, spring - self._damping[primary] * closing)  # damping may weaken the contact, never pull
        extra = push - spring
        self.normal[:] = (nx, ny, nz)
        self.point[:] = result[at.RESULT_CONTACTS + at.CONTACT_POINT : at.RESULT_CONTACTS + at.CONTACT_POINT + 3]
        self.force[:] = (fx, fy, fz)
        self.normal_force[...] = push
        self.penetration[...] = result[at.RESULT_PENETRATION]
        return (fx + extra * nx, fy + extra * ny, fz + extra * nz)

    def _approach(self, result: list[float], velocity: list[float]) -> None:
        nearest = int(result[at.RESULT_NEAREST])
        distance = result[at.RESULT_DISTANCE]
        if nearest < 0:
            self.near_distance[...] = math.inf
            self.time_to_contact[...] = math.inf
            return
        normal = result[at.RESULT_NEAREST_NORMAL : at.RESULT_NEAREST_NORMAL + 3]
        speed = -(velocity[0] * normal[0] + velocity[1] * normal[1] + velocity[2] * normal[2])
        self.near_distance[...] = distance
        self.time_to_contact[...] = 0.0 if distance <= 0.0 else distance / speed if speed > 1e-6 else math.inf

    def events(self, tick: int, tell: Listener) -> None:
        """Emit the events of this tick: NEAR, then END and BEGIN, or MOVE."""
        result = self._newest
        nearest = int(result[at.RESULT_NEAREST]) if self.model.objects else -1
        if nearest != self.near_object.item():
            self.near_object[...] = nearest
            if nearest >= 0:
                tell(self._event(Contact.NEAR, tick, nearest, result))
        current, primary = self.current.item(), self.object.item()
        if current >= 0:
            if self._touches(result, current):
                if self.separated.item():
                    self.separated[...] = 0
                tell(self._event(Contact.MOVE, tick, current, result))
                return
            far = nearest < 0 or result[at.RESULT_DISTANCE] > SEPARATION or nearest != current
            self.separated[...] = self.separated.item() + 1 if far else 0
            if primary < 0 and self.separated.item() < self._patience:
                tell(self._event(Contact.MOVE, tick, current, result))
                return
            tell(self._event(Contact.END, tick, current, result))
            self.current[...] = -1
        if primary >= 0:
            self.current[...] = primary
            self.separated[...] = 0
            self.begin[...] = tick
            tell(self._event(Contact.BEGIN, tick, primary, result))

    @staticmethod
    def _touches(result: list[float], index: int) -> bool:
        for row in range(int(result[at.RESULT_COUNT])):
            if result[at.RESULT_CONTACTS + row * at.CONTACT_WIDTH + at.CONTACT_OBJECT] == index:
                return True
        return False

    def _event(self, kind: Contact, tick: int, index: int, result: list[float]) -> ContactEvent:
        touching = kind is not Contact.NEAR and result[at.RESULT_PRIMARY] == index
        if touching:
            normal: Any = result[at.RESULT_NORMAL : at.RESULT_NORMAL + 3]
            point: Any = result[at.RESULT_CONTACTS + at.CONTACT_POINT : at.RESULT_CONTACTS + at.CONTACT_POINT + 3]
        else:
            normal = result[at.RESULT_NEAREST_NORMAL : at.RESULT_NEAREST_NORMAL + 3]
            point = result[at.RESULT_NEAREST_POINT : at.RESULT_NEAREST_POINT + 3]
        velocity = self.velocity.tolist()
        along = velocity[0] * normal[0] + velocity[1] * normal[1] + velocity[2] * normal[2]
        tangential = tuple(v - along * n for v, n in zip(velocity, normal, strict=True))
        return ContactEvent(
            kind, tick, self.probe.name, self.model.objects[index], index, tuple(point), tuple(normal),
            0.0 if touching else float(self.near_distance), -along, tangential, float(self.penetration),
            float(self.normal_force), float(self.time_to_contact),
        )  # fmt: skip


def _stiffness(probe: ProbeModel) -> Any:
    values = np.array([coupling.stiffness for coupling in probe.coupling], np.float64)
    values.setflags(write=False)
    return values
