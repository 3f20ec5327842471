"""A modality that computes contact by penalty: a spring and a damper along the shortest way out of each object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from itouch.plugin import ContactFields, Field, Modality, Record, World, schema
from itouch.plugin.geometry import Geometry, point_distance


@dataclass(frozen=True, slots=True)
class Penalty:
    """Its element: ``<PLUGIN:penalty probe="..."/>``."""

    probe: str = schema.ref("probe", doc="the finger")


class Springs(NamedTuple):
    """The read-only model: names, the radius of the finger [m], and the shapes."""

    name: str
    probe: str
    radius: float
    geometry: Geometry


class PenaltyContact(Modality):
    """Pushes the finger out of the object in which it is deepest."""

    Params = Penalty
    subscribes_to = frozenset()

    def compile(self, name: str, params: Any, world: World) -> Springs:
        """Take the shapes of the scene."""
        if world.geometry is None:
            raise ValueError("there is nothing to touch")
        self._scratch = world.geometry.new_scratch()  # not in the model: it is written, and means nothing afterwards
        return Springs(name, params.probe, world.probes[params.probe], world.geometry)

    def fields(self, model: Springs) -> tuple[Field, ...]:
        """Declare what it says of the contact."""
        return (
            Field("object", unit="1", doc="the object that is touched; -1: none"),
            Field("force", "f8", 3, unit="N", doc="force on the finger"),
            Field("normal", "f8", 3, unit="1", doc="normal of the touched surface"),
            Field("point", "f8", 3, unit="m", doc="the touched point"),
        )

    def contact_fields(self, model: Springs) -> ContactFields | None:
        """Say that it computes the probe's contact, and where it tells what it has found."""
        return ContactFields(model.probe, "object", "force", "normal", "point")

    def reads(self, model: Springs) -> tuple[str, ...]:
        """Name what it reads of State."""
        figures = f"{model.probe}.hip", f"{model.probe}.velocity", f"{model.probe}.coupling.*"
        return (*figures, "objects.pose", "objects.twist")

    def reset(self, model: Springs, state: Record) -> None:
        """Begin without contact."""
        state[f"{model.name}.object"] = -1.0

    def update(self, model: Springs, state: Record, period: float) -> None:
        """Find the object in which the finger is deepest, and push the finger out of it."""
        own, probe = model.name, model.probe
        hip, poses = state[f"{probe}.hip"], state["objects.pose"]
        deepest, found = 0.0, -1
        for index in range(len(poses)):
            away, normal, foot = point_distance(
                model.geometry.world, model.geometry.mesh, poses, index, hip, 2 * model.radius, self._scratch
            )
            if (depth := model.radius - away) > deepest:
                deepest, found, out, point = depth, index, np.array(normal), np.array(foot)
        state[f"{own}.object"] = found
        if found < 0:
            return
        twist = state["objects.twist"][found]
        surface = twist[:3] + np.cross(twist[3:], point - poses[found, :3])
        closing = (state[f"{probe}.velocity"] - surface) @ out
        stiffness, damping = (state[f"{probe}.coupling.{one}"][found] for one in ("stiffness", "damping"))
        push = max(0.0, stiffness * deepest - damping * closing)
        state[f"{own}.force"], state[f"{own}.normal"], state[f"{own}.point"] = push * out, out, point
