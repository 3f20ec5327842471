"""The device contract: what a plugin that moves, pushes, heats or measures must offer."""

from __future__ import annotations

import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.bound import Bound
from itouch.plugin.channel import Channel
from itouch.plugin.declaration_rules import faults_of, unguessable
from itouch.plugin.groups import Grouped
from itouch.plugin.record import Field, Record
from itouch.plugin.stamps import Stamps
from itouch.plugin.trace import Trace
from itouch.schema import ItouchError


class DeviceError(ItouchError):
    """A device that is missing, refuses, or has failed; the message says what to do."""


@dataclass(frozen=True, slots=True)
class Attached:
    """A device that is really there: where, whether it can be used as it is, and how well or why not."""

    where: str
    usable: bool
    note: str


class TwinInputs:
    """What the simulated world presents to a twin in one tick, in the device's frame.

    ``finger_pose`` (7,) and ``finger_twist`` (6,) are those of the finger's centre; ``wrench`` (6,) acts on the
    device; ``force`` [N] presses on the device's face and ``gap`` [m] is the distance between face and finger pad
    (negative while they touch), both together the array ``face`` (2,); ``ambient`` [K] is the room.

    A device that is worn, for it is mounted on what tracks the finger, sits on it: ``face`` has what acts on the finger
    and no gap, ``skin`` (1,) is the skin's temperature [K], and its twin writes into ``taken`` (1,) what heat it takes
    from the finger [W/m2, out of the finger], as the mean over the fingertip.  ``beside`` (1,) is what worn devices
    take altogether, for a twin that has the finger's tissue of its own.
    """

    __slots__ = (
        "ambient", "beside", "face", "finger_attached", "finger_pose", "finger_twist", "skin", "taken", "wrench",
    )  # fmt: skip

    def __init__(
        self, *, force: float = 0.0, gap: float = 1.0, ambient: float = 296.15, finger_attached: bool = False
    ) -> None:
        self.finger_pose: NDArray[np.float64] = np.array([0.0, 0, 0, 1, 0, 0, 0])
        self.finger_twist: NDArray[np.float64] = np.zeros(6)
        self.wrench: NDArray[np.float64] = np.zeros(6)
        self.face: NDArray[np.float64] = np.array([force, gap])
        self.skin: NDArray[np.float64] = np.array([306.15])
        self.taken: NDArray[np.float64] = np.zeros(1)
        self.beside: NDArray[np.float64] = np.zeros(1)
        self.ambient, self.finger_attached = ambient, finger_attached

    @property
    def force(self) -> float:
        """What presses on the face [N]."""
        force: float = self.face[0].item()
        return force

    @force.setter
    def force(self, value: float) -> None:
        self.face[0] = value

    @property
    def gap(self) -> float:
        """The distance between face and finger pad [m]."""
        gap: float = self.face[1].item()
        return gap

    @gap.setter
    def gap(self, value: float) -> None:
        self.face[1] = value


class Twin(ABC):
    """The simulated stand-in of a device: it keeps nothing that changes in attributes, only in its State fields."""

    def __init__(self, params: Any) -> None:
        self.params = params

    #: What it declares in an older way, one sentence each.
    outdated: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        if "stand" in cls.__dict__ and "set_environment" not in cls.__dict__:  # for one version
            cls.set_environment = cls.__dict__["stand"]  # type: ignore[method-assign]
            cls.outdated = (*cls.outdated, f"method 'stand' of {cls.__name__} is 'set_environment' now: rename it")

    def set_environment(self, ambient: float, skin_temperature: float | None) -> None:  # noqa: B027
        """Learn, before anything else, the temperatures [K] of the room and of the operator's skin, if there is one."""

    def stand(self, ambient: float, skin_temperature: float | None) -> None:
        """Do what ``set_environment`` of this class does: its old name, for one version."""
        warnings.warn("'stand' is 'set_environment' now: call that", DeprecationWarning, stacklevel=2)
        overridden = any("stand" in vars(kind) for kind in type(self).__mro__ if kind is not Twin)
        if not overridden:  # else it was called by that one, and is what all twins do: nothing
            self.set_environment(ambient, skin_temperature)

    def fields(self) -> tuple[Field, ...]:
        """Return the State that the twin needs."""
        return ()

    def reset(self, state: Record, rng: np.random.Generator) -> None:  # noqa: B027
        """Set the State to its start; draw the words of random generators from ``rng``."""

    def position(self, state: Record) -> NDArray[np.float64] | None:
        """Return the view of State, shape (3,), that is the true position [m] of what the device carries, or None."""
        return None

    @abstractmethod
    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Advance the State by ``period`` seconds under the command that safety let through."""

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound | None:
        """Return what ``step`` does with these, which stay the same, as one compiled call; None: it is Python.

        It then runs joined with others, without the interpreter; `step` should be the same call.  A call that returns
        another number than 0 has changed nothing, and leaves this tick to ``step``.
        """
        return None

    @abstractmethod
    def read(self, state: Record, reading: Record) -> bool | None:
        """Fill every field of the reading; return False if there is nothing new."""

    def bound_read(self, state: Record, reading: Record) -> Bound | None:
        """Return what ``read`` does with these, which stay the same, as one compiled call; None: it is Python.

        It returns 0 for a new reading.  A call that returns another number has changed nothing, and leaves this tick
        to ``read``.
        """
        return None


def is_new(said: object) -> bool:
    """Tell whether a reading has come, by what ``read`` has returned: None, or anything that is true.

    A comparison of NumPy's gives a False of its own, which is as false as Python's.
    """
    return said is None or bool(said)


class Device(Grouped, ABC):
    """A device plugin: three declarations and four methods; lifecycle, limits, threads and NaN belong to the framework.

    Four methods: ``open`` and ``close`` pair exactly once; ``read`` and ``write`` see the device's own frame in SI
    units.  Three declarations: ``Params``, ``reads`` and ``commands``; a ``Twin`` where the ideal one is not enough.
    All else has a default that most plugins never touch, and stands in groups: ``timing``, ``opening``, ``emulation``,
    ``operator_input``, ``mechanics``.

    Raises
    ------
    ValueError
        When the class is defined: a reading that would hurt if it were taken for another one has no role.
    """

    #: Frozen dataclass of schema fields: the device's XML element ``<NAME:hardware>``.
    Params: ClassVar[type]
    reads: ClassVar[tuple[Channel, ...]] = ()
    commands: ClassVar[tuple[Channel, ...]] = ()
    #: The twin class; None: the ideal twin made from the channels.
    Twin: ClassVar[type[Twin] | None] = None

    #: What the channels do not say, one sentence each; found when the class is defined.
    undeclared: ClassVar[tuple[str, ...]] = ()

    #: Where to write what goes over the wire; set before ``open``, None: nowhere.
    trace: Trace | None = None

    #: Where a blocking device may note when it measured and when its command left; set before ``open``, None: nowhere.
    stamps: Stamps | None = None

    #: The limits in force for it by name, SI, as in ``<limits>``; set before ``open``, for a device that knows its own.
    limits: Mapping[str, float | tuple[float, float]] = MappingProxyType({})

    #: The time [s] that it goes by where it needs one, as for the speed of what it is commanded: the host's, or the
    #: loop's where that is simulated.  How long an answer may take is of the host's own clock in either.
    clock: Callable[[], float] = staticmethod(time.monotonic)

    #: Factor on how long it waits for answers; more than 1 only where time is simulated on a busy machine.
    patience: float = 1.0

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
        """Fill every field; return False if nothing is new; do not keep the record."""

    def write(self, command: Record) -> None:
        """Send the command, which is already limited; do not keep the record."""

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return what this device reads and obeys with these parameters; by default the class's declarations."""
        return cls.reads, cls.commands

    @classmethod
    def takes(cls, params: Any) -> float:
        """Return the seconds that one exchange takes with these parameters; by default ``exchange_time``."""
        return cls.exchange_time

    @classmethod
    def lets_go(cls, params: Any) -> float | None:
        """Return after how many seconds without a command this device, with these parameters, makes itself safe.

        None: it does not, and runs with the guardian and hold-to-run only; by default ``watchdog``.
        """
        return cls.watchdog

    @classmethod
    def opens_twice(cls, params: Any) -> bool:
        """Tell whether another process can make it safe, with these parameters; by default ``second_opener``."""
        return cls.second_opener

    @classmethod
    def wires(cls, params: Any) -> tuple[str, ...]:
        """Return what no other device may command over at the same time, with these parameters: ports, addresses.

        Two drivers that write to one wire take each other's answers, and one would go on driving what the other has
        stopped: such a scene is refused.  By default the parameter ``port``, if there is one and it names something.
        """
        port = getattr(params, "port", "")
        return (port,) if isinstance(port, str) and port else ()

    @classmethod
    def bind(cls, params: Any, read: Callable[[str, int], bytes]) -> Any:
        """Return what driver and twin are made from: the parameters, with the content of files that they name.

        Parameters
        ----------
        params
            The parameters as the scene has them.
        read
            Returns the content of a file that the scene names, of at most so many bytes; it is kept with sessions.

        Raises
        ------
        ValueError
            If a file does not hold what it must; the message becomes a problem at the element's place, that of a
            `ParameterError` at the attribute's.
        """
        return params

    @classmethod
    def duration(cls, bound: Any) -> float:
        """Return how long the twin's own motion lasts [s], from what ``bind`` returned; 0: it has none."""
        return 0.0

    @classmethod
    def face(cls, params: Any) -> tuple[float, float] | None:
        """Return the half extents [m] of the flat face at the device's origin that a finger can touch, if any."""
        return None

    @classmethod
    def discover(cls) -> tuple[Attached, ...] | None:
        """Look for such devices without moving or heating anything; None: they cannot be looked for."""
        return None

    @classmethod
    def attached(cls) -> tuple[Attached, ...] | None:
        """Do what ``discover`` does: its old name, for one version."""
        warnings.warn("'attached' is 'discover' now: call that", DeprecationWarning, stacklevel=2)
        overridden = any("attached" in vars(kind) for kind in cls.__mro__ if kind is not Device)
        return None if overridden else cls.discover()

    @classmethod
    def missing(cls, bound: Any) -> str:
        """Return why the device can't be opened as far as that is seen without touching it; empty: nothing is known.

        It is asked before anybody is asked to hold a switch, of devices that move when they are opened; others are
        opened then.
        """
        return ""

    def make_safe(self, safe: Record) -> None:
        """Make the device safe from a process that does not run it: called on a new instance, and only once.

        Parameters
        ----------
        safe
            The safe command, made from the channels and from what was sent last.
        """
        self.open()
        try:
            self.write(safe)
        finally:
            self.close()

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        hurting = list(unguessable(cls.reads))
        if hurting:
            raise ValueError(f"device class {cls.__name__}: {'; '.join(hurting)}")
        if "attached" in cls.__dict__ and "discover" not in cls.__dict__:  # for one version
            cls.discover = cls.__dict__["attached"]  # type: ignore[method-assign]
            cls.outdated = (*cls.outdated, "class method 'attached' is 'discover' now: rename it")
        cls.undeclared = (*faults_of(cls.reads, "reading"), *faults_of(cls.commands, "command"))
