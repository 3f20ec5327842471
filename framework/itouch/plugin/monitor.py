"""The monitor contract: a monitor watches a device, finds its channels by role, reduces its drive, and stops it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

from itouch.moved import HasOldNames, with_old_fields
from itouch.plugin.channel import Channel
from itouch.plugin.quantity import Role
from itouch.plugin.record import Field, Record


class Rule(NamedTuple):
    """One rule in words: those of ``check``, of the safety report and of the fault are all made from it.

    ``number`` is its number in the reference of limits (empty: none), ``limit`` the value at which it begins to act,
    ``trip`` the value at which it stops the device, ``absolute`` the value that is never passed, ``source`` who has set
    it.  Empty: there is none.
    """

    number: str
    quantity: str
    limit: str = ""
    trip: str = ""
    absolute: str = ""
    source: str = "the default"


@with_old_fields(obeys="commands_with")
@dataclass(frozen=True, slots=True)
class Watched:
    """A device as a monitor sees it when the scene is compiled.

    ``limits`` are the limits in force (name -> SI) and ``sources`` who has set each; ``surface`` tells whether it is
    carried to a finger or is itself such a carrier, so that a finger need not be on it.
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
        """Return the readings with a role."""
        return tuple(channel for channel in self.reads if channel.role is role)

    def reading(self, role: Role) -> Channel | None:
        """Return the first reading with a role, or None."""
        return next(iter(self.readings(role)), None)

    def commands_with(self, *roles: Role) -> tuple[Channel, ...]:
        """Return the commands with one of these roles."""
        return tuple(channel for channel in self.commands if channel.role in roles)

    def command(self, role: Role) -> Channel | None:
        """Return the first command with a role, or None."""
        return next(iter(self.commands_with(role)), None)

    def source(self, name: str) -> str:
        """Return who has set a limit."""
        return self.sources.get(name, "the default")


@with_old_fields(strayed="tracking_error")
@dataclass(slots=True)
class Moment:
    """The circumstances of a check: times, and what is known of the finger; the object is reused for the next check.

    Attributes
    ----------
    now, time
        Session time of the check, and that at which the newest reading was measured [s].
    seconds
        Measured time since this monitor's last check [s]; 0 at the first one after a pause.
    age
        Age of the newest reading [s].
    fresh
        Whether a reading has arrived since the last check.
    touched
        Whether a finger touches the device, as far as is known; if the rig cannot tell, a touch is assumed.
    force
        Measured force between finger and device [N]; NaN: not measured.
    gap
        Distance [m] between finger pad and surface as tracked, negative while they press; NaN: not known.
    finger
        Position of the finger in the device's frame [m]; NaN: not known.
    speed
        Speed of the finger [m/s]; 0 if it is not known.
    tracking_error
        Distance [m] of a surface from its commanded position; NaN: not known.
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
    tracking_error: float = math.nan
    calibrated: bool = False


class Monitor(HasOldNames, ABC):
    """Watches one device.  A monitor can only tighten: the smallest share and the first trip count.

    Whatever changes is not in attributes but in its ``fields``, which are part of State as ``DEVICE.NAME.field``.
    ``check`` must not write anything else; it is called with every new reading, and at least every 10 ms while the
    device is open, even without a new reading.  An exception from it stops the device.
    """

    _OLD_NAMES = {
        "forget": "clear_history", "moments": "time_fields", "placed": "needs_finger_position",
        "spent": "exhausted_budget",
    }  # fmt: skip

    #: Letters, digits and "_": the prefix of its fields.
    name: str
    #: Code (1, 2, ...) -> name of each trip, such as ``{1: "charge-dose"}``.
    trips: ClassVar[Mapping[int, str]] = {}
    #: True: checked in each tick, once the finger's position in that tick is known.
    needs_finger_position: ClassVar[bool] = False
    #: Its fields that hold moments in session time [s] (of a table: in its first column): a stored session with one of
    #: them later than its own time is refused.
    time_fields: ClassVar[tuple[str, ...]] = ()

    def __init__(self, device: Watched) -> None:
        self.device = device

    @classmethod
    @abstractmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Return the monitors of this kind that a device needs: none if it has nothing for them to watch."""

    @property
    def watches(self) -> tuple[str, ...]:
        """Names of the commands whose effect on a person it sees."""
        return ()

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return ()

    def reset(self, state: Record) -> None:
        """Set its fields, which are zero, to their initial values; called once per session."""
        self.clear_history(state)

    def clear_history(self, state: Record) -> None:
        """Forget past measurements, because the device was away; budgets stay."""

    @abstractmethod
    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Check the newest reading and the command that was sent last.

        Parameters
        ----------
        state
            Its own fields.
        reading, sent
            Reading and command of the device, taken before any other plugin could write to them.
        moment
            Times, and what is known of the finger.

        Returns
        -------
        float
            0 to 1: the share of force, current or speed that is allowed; or minus the code of a trip.
        """

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Return what the device did, to follow "device 'x'", after ``check`` has returned minus this code."""
        return f"was stopped by {self.trips.get(code, f'code {code}')}"

    def rule(self, code: int, reading: Record) -> str:
        """Return the number (or the quantity) of the rule that a code belongs to; empty: none."""
        return ""

    def exhausted_budget(self, state: Record) -> str:
        """Return which budget is used up, to follow "device 'x'", which then may not be enabled again; empty: none."""
        return ""

    def rules(self) -> tuple[Rule, ...]:
        """Return the rules that it enforces on the device."""
        return ()
