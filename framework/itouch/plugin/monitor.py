"""The monitor contract: what watches a device, cuts its drive down, and stops it; found by roles of channels."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

from itouch.plugin.channel import Channel
from itouch.plugin.quantity import Role
from itouch.plugin.record import Field, Record


class Rule(NamedTuple):
    """One rule in the words of ``check``, the safety report and the fault: all three are made from it.

    ``number`` is its number in the reference of the limits (empty: none), ``limit`` where it begins to act, ``trip``
    where it stops, ``absolute`` what is never passed, ``source`` who has set it.  Empty: there is none.
    """

    number: str
    quantity: str
    limit: str = ""
    trip: str = ""
    absolute: str = ""
    source: str = "the default"


@dataclass(frozen=True, slots=True)
class Watched:
    """A device as a monitor sees it when the scene is compiled.

    ``limits`` are the limits in force (name -> SI) and ``sources`` who has set each; ``surface`` tells whether
    something carries it to a finger or it is such a carrier, so that a finger can be off it.
    """

    name: str
    plugin: str
    params: Any
    reads: tuple[Channel, ...]
    commands: tuple[Channel, ...]
    limits: Mapping[str, Any] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    twin: bool = True

    def readings(self, role: Role) -> tuple[Channel, ...]:
        """Return the readings of a role."""
        return tuple(channel for channel in self.reads if channel.role is role)

    def reading(self, role: Role) -> Channel | None:
        """Return the first reading of a role, or None."""
        return next(iter(self.readings(role)), None)

    def obeys(self, *roles: Role) -> tuple[Channel, ...]:
        """Return the commands of these roles."""
        return tuple(channel for channel in self.commands if channel.role in roles)

    def command(self, role: Role) -> Channel | None:
        """Return the first command of a role, or None."""
        return next(iter(self.obeys(role)), None)

    def source(self, name: str) -> str:
        """Return who has set a limit."""
        return self.sources.get(name, "the default")


@dataclass(slots=True)
class Moment:
    """When and where a check takes place; the same object is used again for the next one.

    Attributes
    ----------
    now, time
        Session time of the check, and that at which the newest reading was measured [s].
    seconds
        Measured time since this monitor's last check [s]; 0 at the first one after a pause.
    age
        Of the newest reading [s].
    fresh
        Whether a reading has come since the last check.
    touched
        Whether a finger touches the device, as far as is known; without a rig that knows, a touch is assumed.
    force
        Felt force between finger and device [N]; NaN: not measured.
    gap
        Distance [m] between finger pad and surface as tracked, negative while they press; NaN: not known.
    finger
        Place of the finger in the device's frame [m]; NaN: not known.
    speed
        Of the finger [m/s]; 0 where it is not known.
    strayed
        Distance [m] of a surface from its command; NaN: not known.
    calibrated
        Whether the height of the surface is known by touch-off.
    """

    now: float = 0.0
    time: float = 0.0
    seconds: float = 0.0
    age: float = 0.0
    fresh: bool = True
    touched: bool = True
    force: float = math.nan
    gap: float = math.nan
    finger: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    speed: float = 0.0
    strayed: float = math.nan
    calibrated: bool = False


class Monitor(ABC):
    """Watches one device.  A monitor can only tighten: the smallest share and the first trip count.

    It keeps nothing that changes in attributes: its memory are its ``fields``, which are part of State as
    ``DEVICE.NAME.field``.  ``check`` must not write anything else, and is called with every new reading, and at least
    every 10 ms while the device is open, also without news.  What it raises stops the device.
    """

    #: Letters, digits and "_": the prefix of its fields.
    name: str
    #: Code (1, 2, ...) -> name of each trip, such as ``{1: "charge-dose"}``.
    trips: ClassVar[Mapping[int, str]] = {}
    #: True: checked in each tick, when the finger's place of that tick is known.
    placed: ClassVar[bool] = False
    #: Its fields that hold moments of session time [s] (of a table: in its first column): in no stored session is one
    #: of them later than the session is.
    moments: ClassVar[tuple[str, ...]] = ()

    def __init__(self, device: Watched) -> None:
        self.device = device

    @classmethod
    @abstractmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Return the monitors of this kind that a device needs: none if it has nothing of its kind."""

    @property
    def watches(self) -> tuple[str, ...]:
        """Names of the commands whose effect on a person it sees."""
        return ()

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return ()

    def reset(self, state: Record) -> None:
        """Set its fields, which are zero, to their start; called once a session."""
        self.forget(state)

    def forget(self, state: Record) -> None:  # noqa: B027
        """Drop what was measured, because the device was away; budgets stay."""

    @abstractmethod
    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Look at the newest reading and at the command sent last.

        Parameters
        ----------
        state
            Its own fields.
        reading, sent
            Of the device, taken before any other plugin could write them.
        moment
            Times, and what is known of the finger.

        Returns
        -------
        float
            0 to 1: the part of force, current or speed that is let through; or minus the code of a trip.
        """

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Say what the device did, as after "device 'x'", when ``check`` has returned minus this code."""
        return f"was stopped by {self.trips.get(code, f'code {code}')}"

    def rule(self, code: int, reading: Record) -> str:
        """Return the number (or the quantity) of the rule that a code belongs to; empty: none."""
        return ""

    def spent(self, state: Record) -> str:
        """Say which budget is used up, as after "device 'x'": it may not be enabled any more.  Empty: none."""
        return ""

    def rules(self) -> tuple[Rule, ...]:
        """Return what it holds the device to."""
        return ()
