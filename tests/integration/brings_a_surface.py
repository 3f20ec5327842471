"""A modality that brings a prop to the finger in a way of its own: it waits further away than a table would."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from itouch.plugin import Field, Modality, ParameterError, Record, Role, SurfaceFields, World, schema

#: Cosine of the steepest slope that the prop renders.
LEVEL = 0.95
#: How near [m] the prop is to the finger when it counts as there.
THERE = 3e-4


@dataclass(frozen=True, slots=True)
class Brings:
    """Its element: ``<PLUGIN:brings probe="..." robot="..."/>``."""

    probe: str = schema.ref("probe", doc="the finger")
    robot: str = schema.ref("device", doc="what brings the prop")
    stands_off: float = schema.quantity("m", low=1e-3, high=0.1, default=0.012, doc="how far away the prop waits")


class Plan(NamedTuple):
    """The read-only model: names of what it works with, and lengths [m]; ``face`` (3,): the top, as the robot has it."""

    name: str
    probe: str
    robot: str
    channel: str
    prop: str
    face: tuple[float, float, float]
    radius: float
    stands_off: float


class Hover(Modality):
    """Keeps the prop where the virtual surface is, or well away from the finger."""

    Params = Brings
    subscribes_to = frozenset()  # else each tick of a contact would call it from Python

    def compile(self, name: str, params: Any, world: World) -> Plan:
        """Find the robot's command and reading by what they are for."""
        robot = world.devices[params.robot]
        goal = robot.command(Role.SURFACE_POSE)
        if goal is None:
            raise ValueError(f"device '{params.robot}' brings no surface")
        surface = world.surfaces.get(params.probe)
        if surface is None:
            raise ParameterError("probe", f"'{params.probe}' has no surface-to")
        prop, radius = robot.read_field(Role.TRACKED_POSE), world.probes[params.probe]
        return Plan(name, params.probe, params.robot, goal.name, prop, surface.face, radius, params.stands_off)

    def fields(self, model: Plan) -> tuple[Field, ...]:
        """Declare the numbers by which it says how the prop stands."""
        return (
            Field("renders", unit="1", doc="1: the contact is the prop's to render"),
            Field("there", unit="1", doc="1: the prop is at the finger"),
            Field("away", unit="m", doc="distance of the finger's pad from the prop"),
            Field("short", unit="m", doc="height of the virtual surface above the prop"),
            Field("coming", unit="m", doc="how far the prop still is from where it is wanted"),
        )

    def commands(self, model: Plan) -> tuple[str, ...]:
        """Command the robot."""
        return (f"{model.robot}.{model.channel}",)

    def surface_fields(self, model: Plan) -> SurfaceFields | None:
        """Say that it brings the robot's surface, and in which fields it tells how that stands."""
        return SurfaceFields(model.probe, model.robot, "renders", "there", "away", "short", "coming")

    def reads(self, model: Plan) -> tuple[str, ...]:
        """Name what it reads of State."""
        probe = model.probe
        figures = f"{probe}.hip", f"{probe}.surface_height", f"{probe}.surface.upright"
        return (*figures, model.prop, f"{model.robot}.frame")

    def reset(self, model: Plan, state: Record) -> None:
        """Begin out of reach."""
        state[f"{model.name}.away"] = state[f"{model.name}.short"] = math.inf

    def update(self, model: Plan, state: Record, period: float) -> None:
        """Send the prop to the virtual surface, or away from the finger, and say how it stands."""
        own = model.name
        x, y, z = state[f"{model.probe}.hip"].tolist()
        height, lowest = state[f"{model.probe}.surface_height"].item(), z - model.radius
        level = state[f"{model.probe}.surface.upright"].item() > LEVEL
        away = lowest - model.stands_off
        frame = state[f"{model.robot}.frame"]  # of the robot in the world, wherever it stands and however it is turned
        origin, turn = frame[:3], frame[3:].reshape(3, 3)
        wanted = max(height, away) if level else away
        place = np.array((x, y, wanted))
        goal = state[f"{model.robot}.command.{model.channel}"]
        goal[:3], goal[3:] = (place - origin) @ turn - model.face, (1.0, 0.0, 0.0, 0.0)
        top = (turn @ (state[model.prop][:3] + model.face) + origin)[2].item()
        state[f"{own}.renders"] = level
        state[f"{own}.there"] = level and lowest - top < THERE
        state[f"{own}.away"] = lowest - top
        state[f"{own}.short"] = height - top if math.isfinite(height) else math.inf
        state[f"{own}.coming"] = abs(wanted - top) if abs(wanted - top) > THERE else 0.0
