"""The XYZ table as a device: three translations presented as six degrees of freedom, rotations locked.

The travel, speed and friction of the table in the literature are not published; the defaults here are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from itouch.plugin import RETRACT, ROTATIONS, Channel, Device, measured_wrench, pose, pose_target, schema
from itouch_xyz_table.twin import XyzTableTwin


@dataclass(frozen=True, slots=True)
class XyzTableParams:
    """What ``<xyz-table:hardware>`` may hold; its origin is the middle of the x and y travel, at the bottom."""

    travel: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=0.005, high=1.0, default=(0.16, 0.12, 0.04), doc="full travel along x, y and z"
    )
    speed: float = schema.quantity("m/s", low=0.01, high=2.0, default=0.3, doc="greatest speed of an axis")
    acceleration: float = schema.quantity(
        "m/s^2", low=0.1, high=200, default=20.0, doc="greatest acceleration of an axis"
    )
    mass: float = schema.quantity("kg", low=0.05, high=20, default=0.6, doc="of the twin: moving mass")
    friction: float = schema.quantity("N", low=0.0, high=20, default=0.8, doc="of the twin: dry friction of an axis")
    bandwidth: float = schema.quantity("Hz", low=5, high=100, default=40.0, doc="of the twin: of its position control")
    force_noise: float = schema.quantity(
        "N", low=0.0, high=0.5, default=0.005, doc="of the twin: rms of the force sensor"
    )


class XyzTable(Device):
    """An encountered-type display: it carries a plate to where the finger meets a surface."""

    Params = XyzTableParams
    reads = (pose(locked=ROTATIONS), measured_wrench(force=50.0, locked=ROTATIONS))
    commands = (pose_target(low=(-0.08, -0.06, 0.0), high=(0.08, 0.06, 0.04), speed=0.3, safe=RETRACT),)
    Twin = XyzTableTwin
    twin_only: ClassVar[bool] = True

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels with the travel and speed of these parameters."""
        x, y, z = params.travel
        target = pose_target(
            low=(-x / 2, -y / 2, 0.0), high=(x / 2, y / 2, z), speed=params.speed, safe=RETRACT, locked=ROTATIONS
        )
        return cls.reads, (target,)
