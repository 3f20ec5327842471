"""Element `<devices>`: each device with its mount, limits and calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.scene.elements.include import PluginPart
from itouch.scene.elements.objects import POS, QUAT, RPY
from itouch.schema.fields import (
    child,
    children,
    choice,
    flag,
    integer,
    name,
    plugin_parts,
    quantity,
    ref,
    temperature,
    text,
)


@dataclass(frozen=True, slots=True)
class Mount:
    """Where a device is mounted: its frame in the world, or in the frame of the device that carries it."""

    TAG: ClassVar[str] = "mount"
    EXCLUSIVE: ClassVar[tuple[tuple[str, ...], ...]] = (("quat", "rpy"),)
    on: str = ref("device", default="", doc="the device that carries it")
    pos: tuple[float, float, float] = quantity("m", size=3, low=-10, high=10, default=(0.0, 0.0, 0.0), doc=POS)
    quat: tuple[float, ...] | None = quantity("", size=4, low=-1e3, high=1e3, default=None, doc=QUAT)
    rpy: tuple[float, ...] | None = quantity("rad", size=3, low=-100, high=100, default=None, doc=RPY)
    mount_error: tuple[float, float, float] = quantity(
        "m", size=3, low=-0.05, high=0.05, default=(0.0, 0.0, 0.0),
        doc="twin only: how far the true mount is from what is written here",
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one device; they may only be tighter than the defaults and the device's own."""

    TAG: ClassVar[str] = "limits"
    force: float | None = quantity("N", positive=True, default=None, doc="greatest force on the operator")
    torque: float | None = quantity(
        "N*m", positive=True, default=None, doc="greatest torque on the operator; never more than 20 mm times the force"
    )
    speed: float | None = quantity("m/s", positive=True, default=None, doc="greatest speed")
    current: float | None = quantity("A", positive=True, default=None, doc="greatest current")
    temperature: tuple[float, float] | None = temperature(
        size=2, low=200, high=400, default=None, doc="lowest and highest commanded plate temperature"
    )


@dataclass(frozen=True, slots=True)
class Calibration:
    """How the device's mount is found at start."""

    TAG: ClassVar[str] = "calibration"
    method: str = choice("touch-off", "none", default="touch-off", doc="touch-off: the plate rises until it is felt")
    points: int = integer(low=3, high=9, default=3, doc="how many points of the plate are touched")
    stored_in: str = text(
        default="", doc="JSON file of this device's calibration records, beside the scene; empty: the scene's own"
    )


@dataclass(frozen=True, slots=True)
class DeviceElement:
    """A device: the plugin that drives it, its mount and its limits."""

    TAG: ClassVar[str] = "device"
    name: str = name()
    plugin: str = text(doc="the device plugin's name; `itouch-py devices` lists them")
    optional: bool = flag(default=False, doc="whether the session may go on without it")
    twin: bool | str = flag(
        also=("remote",), default=True,
        doc="whether its simulated twin runs instead of the hardware; remote: in a process of its own, in real time",
    )  # fmt: skip
    mount: Mount = child(Mount, default=Mount())
    limits: Limits = child(Limits, default=Limits())
    calibration: Calibration | None = child(Calibration)
    parts: tuple[PluginPart, ...] = plugin_parts(doc="the plugin's parameters, <PLUGIN:hardware>")


@dataclass(frozen=True, slots=True)
class Devices:
    """A list of devices: a rig."""

    TAG: ClassVar[str] = "devices"
    devices: tuple[DeviceElement, ...] = children(DeviceElement)
