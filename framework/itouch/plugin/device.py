"""The device contract: what a plugin for hardware that moves, pushes, heats or measures must offer."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.moved import HasOldNames, OldName, with_old_fields
from itouch.plugin.bound import Bound
from itouch.plugin.channel import Channel
from itouch.plugin.declaration_rules import faults_of, unguessable
from itouch.plugin.groups import Grouped
from itouch.plugin.record import Field, Record
from itouch.plugin.timestamps import Timestamps
from itouch.plugin.trace import Trace
from itouch.schema import ItouchError


class DeviceError(ItouchError):
    """A device is missing, refuses, or has failed; the message says what to do."""


@dataclass(frozen=True, slots=True)
class Attached:
    """A device that was found plugged in: where, whether it can be used as it is, and a note on how well or why not."""

    where: str
    usable: bool
    note: str


@with_old_fields(face="force_and_gap", skin="skin_temperature", taken="heat_flux", beside="total_heat_flux")
class TwinInputs:
    """What the simulated world presents to a twin in one tick, in the device's frame.

    ``finger_pose`` (7,) [m; quaternion] and ``finger_twist`` (6,) [m/s, rad/s] are those of the finger's centre;
    ``wrench`` (6,) [N, N m] acts on the device; ``force`` [N] presses on the device's face and ``gap`` [m] is the
    distance between face and finger pad (negative while they touch), the two together being the array
    ``force_and_gap`` (2,); ``ambient`` [K] is the room's temperature.

    A worn device, which is mounted on the device that tracks the finger, is always in contact with it:
    ``force_and_gap`` then has the force on the finger and no gap, ``skin_temperature`` (1,) is the skin's temperature
    [K], and the twin writes to ``heat_flux`` (1,) the heat flux that it takes out of the finger [W/m2], as the mean
    over the fingertip.  ``total_heat_flux`` (1,) is the heat flux that all worn devices take together, for a twin with
    a model of the finger's tissue.
    """

    __slots__ = (
        "ambient", "finger_attached", "finger_pose", "finger_twist", "force_and_gap", "heat_flux", "skin_temperature",
        "total_heat_flux", "wrench",
    )  # fmt: skip

    def __init__(
        self, *, force: float = 0.0, gap: float = 1.0, ambient: float = 296.15, finger_attached: bool = False
    ) -> None:
        self.finger_pose: NDArray[np.float64] = np.array([0.0, 0, 0, 1, 0, 0, 0])
        self.finger_twist: NDArray[np.float64] = np.zeros(6)
        self.wrench: NDArray[np.float64] = np.zeros(6)
        self.force_and_gap: NDArray[np.float64] = np.array([force, gap])
        self.skin_temperature: NDArray[np.float64] = np.array([306.15])
        self.heat_flux: NDArray[np.float64] = np.zeros(1)
        self.total_heat_flux: NDArray[np.float64] = np.zeros(1)
        self.ambient, self.finger_attached = ambient, finger_attached

    @property
    def force(self) -> float:
        """The force that presses on the face [N]."""
        force: float = self.force_and_gap[0].item()
        return force

    @force.setter
    def force(self, value: float) -> None:
        self.force_and_gap[0] = value

    @property
    def gap(self) -> float:
        """The distance between face and finger pad [m]."""
        gap: float = self.force_and_gap[1].item()
        return gap

    @gap.setter
    def gap(self, value: float) -> None:
        self.force_and_gap[1] = value


class Twin(HasOldNames, ABC):
    """The simulated stand-in of a device: whatever changes is in its State fields, never in attributes."""

    _OLD_NAMES = {"stand": "set_environment"}

    def __init__(self, params: Any) -> None:
        self.params = params

    def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
        """Take the temperatures [K] of the room and of the operator's skin (None without operator); called first."""

    def fields(self) -> tuple[Field, ...]:
        """Return the State that the twin needs."""
        return ()

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Set the State to its initial values; draw the seeds of random generators from ``rng``."""

    def position(self, state: Record) -> NDArray[np.float64] | None:
        """Return the view of State, shape (3,), that has the true position [m] of what the device carries, or None."""
        return None

    @abstractmethod
    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Advance the State by ``period`` [s] under the command that the supervisor has let through."""

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound | None:
        """Return ``step`` with these arguments, which stay the same, as one compiled call; None: it is Python.

        The call runs joined with others, without the interpreter; ``step`` should do the same.  A call that does not
        return 0 must have changed nothing, and leaves this tick to ``step``.
        """
        return None

    @abstractmethod
    def read(self, state: Record, reading: Record) -> bool | None:
        """Fill every field of the reading; return False if there is nothing new."""

    def bound_read(self, state: Record, reading: Record) -> Bound | None:
        """Return ``read`` with these arguments, which stay the same, as one compiled call; None: it is Python.

        The call returns 0 for a new reading.  One that returns another number must have changed nothing, and leaves
        this tick to ``read``.
        """
        return None


def is_new(said: object) -> bool:
    """Tell whether there is a new reading, by what ``read`` has returned: None, or anything that is true.

    It is not compared with ``False``, because comparisons of NumPy arrays return a False of NumPy's own.
    """
    return said is None or bool(said)


class Device(Grouped, ABC):
    """A device plugin: three declarations and four methods; lifecycle, limits, threads and NaN belong to the framework.

    The methods: each ``open`` that succeeds is followed by exactly one ``close``; ``read`` and ``write`` use the
    device's own frame and SI units.  The declarations: ``Params``, ``reads`` and ``commands``; and a ``Twin`` if the
    ideal one is not enough.  Everything else has a default that most plugins never change, and is declared in groups:
    ``timing``, ``opening``, ``emulation``, ``operator_input``, ``mechanics``.

    Raises
    ------
    ValueError
        When the class is defined, if a reading has no role and could hurt if it were taken for another one.
    TypeError
        Then too, if ``reads`` or ``commands`` has anything but channels, or is a single channel.
    """

    _OLD_NAMES = {
        "attached": "discover", "duration": "motion_duration", "face": "surface_half_extents",
        "lets_go": "watchdog_for", "missing": "unavailable_reason", "opens_twice": "second_opener_for",
        "patience": "timeout_factor", "stamps": "timestamps", "takes": "exchange_time_for",
    }  # fmt: skip

    #: Frozen dataclass of schema fields: the device's XML element ``<NAME:hardware>``.
    Params: ClassVar[type]
    reads: ClassVar[tuple[Channel, ...]] = ()
    commands: ClassVar[tuple[Channel, ...]] = ()
    #: The twin class; None: the ideal twin made from the channels.
    Twin: ClassVar[type[Twin] | None] = None

    #: What the channels fail to declare, one sentence each; found when the class is defined.
    declaration_problems: ClassVar[tuple[str, ...]] = ()

    #: Trace of the transfers on the wire; set before ``open``, None: nothing is traced.
    trace: Trace | None = None

    #: Where a blocking device can record when it measured and when its command left; set before ``open``, or None.
    timestamps: Timestamps | None = None

    #: The limits in force, SI, by their names in ``<limits>``; set before ``open``, for a device that has its own too.
    limits: Mapping[str, float | tuple[float, float]] = MappingProxyType({})

    #: The time [s] by which the device computes, for example, the speed of its commands: the host's time, or the loop's
    #: where that is simulated.  Timeouts of answers always use the host's own clock.
    clock: Callable[[], float] = staticmethod(time.monotonic)

    #: Factor on timeouts of answers; more than 1 only if time is simulated on a busy machine.
    timeout_factor: float = 1.0

    def __init__(self, params: Any) -> None:
        self.params = params

    @abstractmethod
    def open(self) -> None:
        """Find and open the device; may block.

        Raises
        ------
        DeviceError
            If it is missing or refuses; say what to do.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the device; called exactly once after each ``open`` that succeeded."""

    @abstractmethod
    def read(self, reading: Record) -> bool | None:
        """Fill every field of the reading; return False if nothing is new; do not keep the record."""

    def write(self, command: Record) -> None:
        """Send the command, which has been limited already; do not keep the record."""

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return what this device reads and obeys with these parameters; by default the class's declarations."""
        return cls.reads, cls.commands

    @classmethod
    def exchange_time_for(cls, params: Any) -> float:
        """Return how long [s] one exchange takes with these parameters; by default ``exchange_time``."""
        return cls.exchange_time

    @classmethod
    def watchdog_for(cls, params: Any) -> float | None:
        """Return after how long [s] without a command the device, with these parameters, makes itself safe.

        None: it does not, and needs the guardian and the dead-man's switch; by default ``watchdog``.
        """
        return cls.watchdog

    @classmethod
    def second_opener_for(cls, params: Any) -> bool:
        """Tell whether another process can make it safe, with these parameters; by default ``second_opener``."""
        return cls.second_opener

    @classmethod
    def wires(cls, params: Any) -> tuple[str, ...]:
        """Return the wires that belong to this device alone, with these parameters: ports, addresses.

        Two drivers that write to one wire take each other's answers, and one would go on driving what the other has
        stopped: such a scene is refused.  By default it is the parameter ``port``, if there is one and it is not empty;
        pyserial's ``loop://`` is none, as each process has its own.
        """
        port = getattr(params, "port", "")
        return (port,) if isinstance(port, str) and port and not port.startswith("loop://") else ()

    @classmethod
    def bind(cls, params: Any, read: Callable[[str, int], bytes]) -> Any:
        """Return what driver and twin are made from: the parameters, with the content of the files that they name.

        Parameters
        ----------
        params
            The parameters as the scene has them.
        read
            Takes the name of a file as in the scene and the greatest size [bytes], and returns its content, which is
            then stored with sessions.

        Raises
        ------
        ValueError
            If the content of a file is wrong; the message becomes a problem at the place of the element, or, for a
            `ParameterError`, of the attribute.
        """
        return params

    @classmethod
    def motion_duration(cls, bound: Any) -> float:
        """Return how long the twin's own motion lasts [s], given what ``bind`` returned; 0: it has none."""
        return 0.0

    @classmethod
    def surface_half_extents(cls, params: Any) -> tuple[float, float] | None:
        """Return the half extents [m] of the flat face at the device's origin that a finger can touch, or None."""
        return None

    @classmethod
    def discover(cls) -> tuple[Attached, ...] | None:
        """Look for attached devices of this kind, without moving or heating anything; None: there is no way to look."""
        return None

    @classmethod
    def unavailable_reason(cls, bound: Any) -> str:
        """Return why the device cannot be opened, as far as that is known without opening it; empty: nothing is known.

        It is called for devices that move when they are opened, before a person is asked to hold the dead-man's switch;
        other devices are simply opened at that time.
        """
        return ""

    def make_safe(self, safe: Record) -> None:
        """Make the device safe in another process than the one that ran it: called once, on a new instance.

        Parameters
        ----------
        safe
            The safe command, made from the channels and from the command that was sent last.
        """
        self.open()
        try:
            self.write(safe)
        finally:
            self.close()

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        for name in ("reads", "commands"):
            told: Any = getattr(cls, name)
            if isinstance(told, Channel) or (  # a property, which some instance has, is none of the class's
                isinstance(told, tuple | list) and not all(isinstance(channel, Channel) for channel in told)
            ):
                raise TypeError(f"device class {cls.__name__}: {name} = {told!r:.60}: write {name} = (Channel(...),)")
        hurting = list(unguessable(cls.reads))
        if hurting:
            raise ValueError(f"device class {cls.__name__}: {'; '.join(hurting)}")
        cls.declaration_problems = (*faults_of(cls.reads, "reading"), *faults_of(cls.commands, "command"))


# Found for each class, never declared by a plugin.
setattr(Device, "undeclared", OldName(Device, "undeclared", "declaration_problems"))  # noqa: B010
