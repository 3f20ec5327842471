"""The modality contract: a rendering engine that owns State, hears contact events and may command devices."""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

from itouch.plugin.bound import Bound
from itouch.plugin.channel import Channel, of_role
from itouch.plugin.measured import Measured
from itouch.plugin.quantity import Role
from itouch.plugin.record import Field, Record

Vector = tuple[float, float, float]


class Contact(enum.IntEnum):
    """Kinds of contact event."""

    NEAR = 0
    BEGIN = 1
    MOVE = 2
    END = 3


class ContactEvent(NamedTuple):
    """What happened between a probe and an object in this tick; lengths in m, world frame.

    ``distance`` is that between surface and probe (0 in contact), ``speed`` the approach speed along the normal
    (> 0: closing), ``tangential_velocity`` that of the finger along the surface, both relative to it;
    ``force`` is the normal force [N], ``area`` that of contact by Hertz's law [m2]; ``time_to_contact`` is infinite
    unless approaching.
    """

    kind: Contact
    tick: int
    probe: str
    object: str
    object_index: int
    point: Vector
    normal: Vector
    distance: float
    speed: float
    tangential_velocity: Vector
    penetration: float
    force: float
    time_to_contact: float
    area: float = 0.0


@dataclass(frozen=True, slots=True)
class WorldObject:
    """An object as a modality sees it; ``material`` is the plugin's own part of the material, or None."""

    name: str
    index: int
    material_name: str
    temperature: float
    material: Any


@dataclass(frozen=True, slots=True)
class WorldDevice:
    """A device as a modality sees it: its plugin's name, parameters, channels and limits in force (name -> SI).

    ``wire`` tells whether something between it and the loop takes time: then State has its ``out`` and ``left``.
    ``twin_fields`` are what the State of its twin consists of, whether it runs on that twin or not.  A modality finds
    what it needs by role and unit, so that a device works with it whatever its author calls things.
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
        """Return the first reading of a role, in a unit if one is given, or None."""
        return of_role(self.reads, role, unit)

    def command(self, role: Role, unit: str = "") -> Channel | None:
        """Return the first command of a role, in a unit if one is given, or None."""
        return of_role(self.commands, role, unit)

    def read_field(self, role: Role, unit: str = "") -> str:
        """Return the field of State that holds the first reading of a role; empty: it has none."""
        channel = self.reading(role, unit)
        return f"{self.name}.{channel.name}" if channel is not None else ""

    def truth(self, role: Role) -> str:
        """Return the field, of those of its twin, that holds what is true of a role beside the sensors; or nothing."""
        return next((field.name for field in self.twin_fields() if field.role is role), "")


@dataclass(frozen=True, slots=True)
class WorldSurface:
    """The surface that a device brings to a probe's finger, as a modality sees it.

    Where the device's frame is in the world changes with a touch-off and with what carries it: State has it as
    ``DEVICE.frame``, origin [m] and rotation matrix row by row, shape (12,); that of the arm likewise.

    Attributes
    ----------
    device, arm
        What brings the surface, and what else pushes the finger; empty: nothing does.
    face
        Where the flat top is that the finger meets, in the frame of what the device's pose is the pose of [m].
    pad_stiffness, pad_damping
        Of the finger's pad [N/m], [N s/m].
    touch_off
        Whether a touch-off finds the height at the start; before it is done, ``ready`` in State is 0.
    greatest_force
        With how much the surface may press [N]: its part, where several surfaces meet one finger.
    clearance, plate_angle
        What the probe's attributes say: how far below the finger the surface waits [m], the steepest slope that it
        renders [rad].  A modality that keeps to one names it in ``Modality.keeps_to``.
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
    """Refuse a file: the reader of a world without a scene.

    Raises
    ------
    ValueError
        Always.
    """
    raise ValueError(f"cannot read '{file}': there is no scene whose folder it could be in")


@dataclass(frozen=True, slots=True)
class World:
    """What a modality may know of the scene when it is compiled.

    ``ambient`` is the room's temperature [K], ``skin_temperature`` [K] the operator twin's, if there is one;
    ``period`` [s] is that of the modality's own updates, ``servo_period`` [s] that of a tick; ``read``
    returns the content of a file that the scene names, relative to its folder, of at most so many bytes (or raises a
    ValueError); the file is kept with sessions.  ``probes`` has the radius [m] of each finger, ``surfaces`` what is
    brought to those of them that are met by a surface.
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


class ParameterError(ValueError):
    """A parameter that cannot work; ``field`` names it, so that the problem points at its attribute."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


class Carries(NamedTuple):
    """That a modality itself brings a device's surface to a probe's finger, and which of its own fields say how.

    Each names a field that the modality declares (``fields``), of one number, without the modality's own name in front.

    Attributes
    ----------
    probe, device
        The probe, and the device that it names in ``surface-to``.
    renders
        Field: 1 where the contact is the surface's to render, 0 where it is the arm's alone.
    present
        Field: 1 while what touches the finger is the surface, so that its temperature is what is felt.
    distance
        Field: how far the finger's pad is from the surface [m]; below 0 where it is pressed in, infinite out of reach.
    gap
        Field: by how much the surface is short of the virtual one [m]; below 0 where it stands out, infinite where
        there is no virtual one.  Over the first millimetre the arm takes over the normal force.
    coming
        Field: how far the surface still has to come, or where the contact is the arm's to go [m]; 0 where it is where
        it is wanted, below 0 if that can't be said.  So long the change of force between surface and arm is led over.
    missed
        Field: why the surface renders no more: 1, it was not felt where it should be; 2, it was felt below that; 0,
        nothing is wrong.  The contact then is the arm's, and report and log tell of the first place.
    yields
        Field: how far its command gives way already, because the surface presses harder than it may [m].  The framework
        (K4) then lowers it by what is wanting to its own yielding only, not by all of that once more.
    presses
        Field: how hard the finger presses on the surface now [N], where the device's own reading is older than this
        tick: what the arm gives follows it.  Below 0: as the device reads.
    risen
        Field: how much higher the surface is now than the device reads [m], where that reading is older; 0: it is
        there.  Monitors take the readings as they are.
    """

    probe: str
    device: str
    renders: str
    present: str
    distance: str
    gap: str
    coming: str = ""
    missed: str = ""
    yields: str = ""
    presses: str = ""
    risen: str = ""

    @property
    def said(self) -> tuple[str, ...]:
        """The fields that are named."""
        return tuple(name for name in self[2:] if name)


class Modality(ABC):
    """A modality plugin.  ``model`` is what ``compile`` returned: read-only; everything that changes is in State.

    The fields that it declares appear in State as ``NAME.field``; it may write those, and the command channels that
    ``commands`` names, and nothing else.
    """

    #: Frozen dataclass of schema fields: its element under ``<interaction>``.
    Params: ClassVar[type]
    #: Frozen dataclass of schema fields: its element under ``<material>``, if it has one.
    Material: ClassVar[type | None] = None
    #: Kinds of event that ``on_contact`` wants; MOVE comes in every tick of a contact.
    hears: ClassVar[frozenset[Contact]] = frozenset(Contact)
    #: What it measures of a contact, in the order of the columns that terminal, page and summary show of it.
    measured: ClassVar[tuple[Measured, ...]] = ()
    #: Those of its fields that are of the person or the devices: they go on when a scene with other objects takes the
    #: place of this one between two touches.  All others begin as after ``reset``.
    goes_on: ClassVar[tuple[str, ...]] = ()
    #: Fields that earlier versions had and whose content is not needed any more: a session stored with them goes on.
    dropped: ClassVar[frozenset[str]] = frozenset()
    #: Where it carries a surface: which attributes of the probe it keeps to, of ``clearance`` and ``plate-angle``.  The
    #: others have no effect then, and whoever writes them is warned.
    keeps_to: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def compile(self, name: str, params: Any, world: World) -> Any:
        """Return the read-only model.

        Raises
        ------
        ValueError
            If the parameters cannot work together; the message becomes a problem at the element's place, that of a
            `ParameterError` at the attribute's.
        """

    def notices(self, model: Any) -> tuple[str, ...]:
        """Return what must be known before a run, one sentence each; shown by check and run, kept in the report."""
        return ()

    def fields(self, model: Any) -> tuple[Field, ...]:
        """Return the State that the modality needs."""
        return ()

    def commands(self, model: Any) -> tuple[str, ...]:
        """Return the command channels that it writes, as ``device.channel``; each has exactly one writer."""
        return ()

    def carries(self, model: Any) -> Carries | None:
        """Return what it says of a surface that it brings to a finger in the place of the default; None: none.

        Its ``update`` then runs in each tick after contact and before the force on the finger: it finds the virtual
        surface in ``PROBE.surface_height`` (the highest below the finger), ``PROBE.normal`` and ``PROBE.object`` (-1:
        nothing is touched), and commands the device.  Touch-off, the withdrawal of T4, the speed at which a surface
        may come near, and every other limit stay with the framework, and have the last word.
        """
        return None

    def reads(self, model: Any) -> tuple[str, ...] | None:
        """Return the fields of State that it reads besides its own, for whoever looks at the plan; None: not said.

        A name that ends in ``*`` stands for all that begin so.
        """
        return None

    @abstractmethod
    def reset(self, model: Any, state: Record) -> None:
        """Set its fields to their start."""

    def on_contact(self, event: ContactEvent, model: Any, state: Record) -> None:  # noqa: B027
        """Take note of a contact event; called within the tick, before ``update``."""

    def attends(self, model: Any) -> bool:
        """Tell whether it wants to be called in the ticks between its updates, too."""
        return False

    def between(self, model: Any, state: Record) -> None:  # noqa: B027
        """Take note of what has come in a tick without an ``update``, and write its commands anew if it has cause.

        ``DEVICE.measured`` in State holds, for each channel that the device reads, the tick at which it was measured;
        it may be long ago.  A device behind a wire has its newest command that has left in ``DEVICE.out.CHANNEL``, and
        in ``DEVICE.left`` the tick in which it left.
        """

    @abstractmethod
    def update(self, model: Any, state: Record, period: float) -> None:
        """Advance its fields by one period and write its commands."""

    def left_out(self, model: Any, state: Record, seconds: float) -> None:  # noqa: B027
        """Let time go on in its fields: between two ticks, a loop that was late has left out so many seconds [s].

        Called with hardware in the rig only, before the tick that comes next: a real finger has gone on touching, and a
        real display heating, while nobody looked.  Readings are still those from before.  Simulated devices have stood
        still; who models what one of these does (``WorldDevice.twin``) has nothing to do.
        """

    def witness(self, model: Any, state: Record, twins: Mapping[str, Record]) -> None:  # noqa: B027
        """Take note of what is true, for its figures: a virtual rig that runs the scene in step shows its twins' State.

        Called after each tick with the State of each device's twin as it was when that tick's readings were taken.
        Nothing that is rendered may depend on it.
        """

    def bound_update(self, model: Any, state: Record, period: float) -> Bound | tuple[Bound, ...] | None:
        """Return what ``update`` does with these, which stay the same, as one compiled call; None: it is Python.

        It then runs joined with the steps beside it.  A call that returns another number than 0 has changed nothing,
        and leaves this tick to ``update``.  Several calls are run one after the other; the first one decides.
        """
        return None

    def measures(
        self, model: Any, state: Record, probe: str, object_index: int
    ) -> dict[str, float | str | bool | None]:
        """Return what the report shall say of the contact that has just ended, or is still open.

        What ``measured`` declares has a column of its own wherever contacts are shown, and is null where it is not
        returned; other keys go to the report's data only.
        """
        return {}

    def ended(self, model: Any, entry: Mapping[str, Any]) -> str:
        """Return the few words that a terminal shows when a contact has ended; empty: nothing.

        ``entry`` is the report's entry of the contact, with what ``measures`` has returned.
        """
        return ""

    def remarks(self, model: Any, entry: Mapping[str, Any]) -> tuple[str, ...]:
        """Return what a terminal shows of a contact below the table, one sentence each: what was not as it should be.

        ``entry`` is the report's entry of the contact.
        """
        return ()

    def status(self, model: Any, state: Record) -> str:
        """Return the few words that the live line shows of it, such as ``plate 60 %``; empty: nothing."""
        return ""

    def report(self, model: Any, state: Record) -> dict[str, Any]:
        """Return what the report shall say of the whole run, as plain data for JSON; empty: nothing."""
        return {}
