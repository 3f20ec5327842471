"""What a modality may know of a scene when it is compiled: objects, devices, probes, surfaces and shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from itouch.moved import with_old_fields
from itouch.plugin.channel import Channel, of_role
from itouch.plugin.quantity import Role
from itouch.plugin.record import Field

if TYPE_CHECKING:
    from itouch.contact.geometry_tables import Geometry

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class WorldObject:
    """An object as a modality sees it; ``material`` is the plugin's own element of the material, or None."""

    name: str
    index: int
    material_name: str
    temperature: float
    material: Any
    #: Coefficients of static and dynamic friction [1].
    friction: tuple[float, float] = (0.0, 0.0)


@with_old_fields(truth="true_field")
@dataclass(frozen=True, slots=True)
class WorldDevice:
    """A device as a modality sees it: its plugin's name, parameters, channels and limits in force (name -> SI).

    ``wire`` tells whether exchanges with it take time: then State has its ``out`` and ``left``.  ``twin_fields``
    returns the State fields of its twin, whether the session runs on the twin or not.  A modality finds what it needs
    by role and unit, so that a device works with it whatever names its author has chosen.
    """

    name: str
    plugin: str
    params: Any
    reads: tuple[Channel, ...]
    commands: tuple[Channel, ...]
    limits: Mapping[str, float | tuple[float, float]]
    twin: bool
    wire: bool = False
    twin_fields: Callable[[], Sequence[Field]] = tuple

    def reading(self, role: Role, unit: str = "") -> Channel | None:
        """Return the first reading with a role, and with a unit if one is given; or None."""
        return of_role(self.reads, role, unit)

    def command(self, role: Role, unit: str = "") -> Channel | None:
        """Return the first command with a role, and with a unit if one is given; or None."""
        return of_role(self.commands, role, unit)

    def read_field(self, role: Role, unit: str = "") -> str:
        """Return the field of State that has the first reading with a role; empty if there is none."""
        channel = self.reading(role, unit)
        return f"{self.name}.{channel.name}" if channel is not None else ""

    def true_field(self, role: Role) -> str:
        """Return the field of its twin's State that has the true value of a role, without sensor error; empty: none."""
        return next((field.name for field in self.twin_fields() if field.role is role), "")


@dataclass(frozen=True, slots=True)
class WorldSurface:
    """The surface that a device brings to a probe's finger, as a modality sees it.

    The device's frame in the world changes with a touch-off and with the device that carries it: State has it as
    ``DEVICE.frame``, origin [m] and rotation matrix row by row, shape (12,), and the arm's frame likewise.

    Attributes
    ----------
    device, arm
        The device that brings the surface, and the arm that also pushes the finger; empty: there is no arm.
    face
        Position [m] of the flat top that the finger meets, in the frame whose pose the device reads.
    pad_stiffness, pad_damping
        Stiffness [N/m] and damping [N s/m] of the finger's pad.
    touch_off
        Whether a touch-off finds the height at the start; until it is done, ``ready`` in State is 0.
    greatest_force
        Greatest force with which the surface may press [N]: its share, if several surfaces meet one finger.
    clearance, plate_angle
        The probe's attributes: how far below the finger the surface waits [m], and the steepest slope that it renders
        [rad].  A modality that respects one of them names it in ``Modality.probe_attributes``.
    """

    device: str
    arm: str
    face: Vector
    pad_stiffness: float
    pad_damping: float
    touch_off: bool
    greatest_force: float
    clearance: float
    plate_angle: float


def no_file(file: str, most: int) -> bytes:
    """Refuse to read a file: the default of ``World.read``, for a world without a scene.

    Raises
    ------
    ValueError
        Always.
    """
    raise ValueError(f"cannot read '{file}': there is no scene whose folder it could be in")


@dataclass(frozen=True, slots=True)
class World:
    """What a modality may know of the scene when it is compiled.

    ``ambient`` is the room's temperature [K], ``skin_temperature`` [K] that of the first operator's twin, if there is
    one; `skin_of` has that of each finger, and `devices_at` the devices at it, for a scene may have several fingers;
    ``period`` [s] is that of the modality's own updates, ``servo_period`` [s] that of a tick.  ``read`` takes the name
    of a file, relative to the scene's folder, and the greatest size [bytes], and returns its content or raises
    ValueError; the content is stored with sessions.  ``probes`` has the radius [m] of each finger, ``surfaces`` the
    surface of each finger that one is brought to, ``near`` how far from each finger objects are looked for [m].
    ``geometry`` has the shapes of the objects, for the functions of `itouch.plugin.geometry`; None: there is no scene.
    ``skins`` and ``at_finger`` are what `skin_of` and `devices_at` look up; ``fields`` has the State fields of each
    modality from which this one takes input, which `field_of` looks through, and ``fingers`` the probes that each
    modality refers to.
    """

    objects: tuple[WorldObject, ...]
    devices: Mapping[str, WorldDevice]
    probes: Mapping[str, float]
    modalities: Mapping[str, Any]
    period: float
    ambient: float
    skin_temperature: float
    servo_period: float = 1e-3
    read: Callable[[str, int], bytes] = no_file
    surfaces: Mapping[str, WorldSurface] = field(default_factory=dict)
    near: Mapping[str, float] = field(default_factory=dict)
    geometry: Geometry | None = None
    skins: Mapping[str, float] = field(default_factory=dict)
    at_finger: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    fields: Mapping[str, tuple[Field, ...]] = field(default_factory=dict)
    fingers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def field_of(self, modality: str, role: Role) -> str:
        """Return the name of the State field in which a modality has a role, such as `Role.HEAT_FLUX`; empty: none.

        Only modalities to which this one refers by a `schema.ref` are known: these are made, and updated, before it.
        """
        found = next((one.name for one in self.fields.get(modality, ()) if one.role is role), "")
        return f"{modality}.{found}" if found else ""

    def skin_of(self, probe: str) -> float:
        """Return the skin temperature [K] of a probe's finger at the start."""
        return self.skins.get(probe, self.skin_temperature)

    def devices_at(self, probe: str) -> list[WorldDevice]:
        """Return the devices at a probe's finger, then those at no finger, none that are at another finger.

        What the finger touches comes first, then what is on the devices that track, push or meet it.
        """
        return [self.devices[name] for name in self.at_finger.get(probe, tuple(self.devices)) if name in self.devices]
