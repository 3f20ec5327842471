"""What holds for every device: a watchdog on the age of its reading (W1), ramp-in (K3), ceilings of its drives."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar

from itouch.monitors import default_limits as default
from itouch.monitors.trips import Trip
from itouch.plugin import HURTING, Channel, Field, Moment, Monitor, Record, Role, Rule, Watched

#: Roles of commands that can hurt and whose ceilings other monitors print.
_TOLD = (Role.FORCE_ON_OPERATOR, Role.SURFACE_POSE)


class Ordinary(Monitor):
    """The watchdog of one device."""

    name = "watchdog"
    trips: ClassVar[Mapping[int, str]] = {int(Trip.SILENT): Trip.SILENT.label}

    def __init__(self, device: Watched) -> None:
        super().__init__(device)
        self._patience = device.limits.get("watchdog") or default.WATCHDOG_OTHER

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Every device."""
        return (cls(device),)

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (Field("figure", unit="s", doc="the age that tripped"),)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Trip on a reading that is too old."""
        if moment.age <= self._patience + 1e-9:
            return 1.0
        state["figure"][...] = moment.age
        return -float(Trip.SILENT)

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Return for how long the device was silent."""
        return f"was silent for {state['figure'].item():.3f} s"

    def rule(self, code: int, reading: Record) -> str:
        """Return W1."""
        return "W1"

    def rules(self) -> tuple[Rule, ...]:
        """Return W1, the ramp of K3, and what no other rule tells about the commands."""
        device, ramp = self.device, self.device.limits.get("ramp") or 0.0
        begins = f"{ramp:g} s" if ramp else "none on this twin"
        found = [
            Rule("W1", "age of its reading", "", f"{self._patience * 1e3:g} ms", "", device.source("watchdog")),
            Rule("K3", "ramp-in", f"{begins}; {ramp or default.RAMP:g} s after re-arming", "", "",
                 device.source("ramp")),
        ]  # fmt: skip
        for channel in device.commands:
            if channel.harmless:
                found.append(Rule("", f"{_words(channel)} is not watched", channel.harmless, "", "", "its plugin"))
            if channel.role in HURTING and channel.role not in _TOLD and channel.high:
                found.append(self._ceiling(channel))
        return tuple(found)

    def _ceiling(self, channel: Channel) -> Rule:
        """Return the rule on the greatest value of a drive."""
        device, limits = self.device, self.device.limits
        if channel.role is Role.TEMPERATURE_TARGET and limits.get("temperature") is not None:
            low, high = (value - 273.15 for value in limits["temperature"])
            return Rule("", _words(channel), f"{low:.4g} to {high:.4g} °C", "", "", device.source("temperature"))
        if channel.role is Role.DRIVE and channel.unit == "A" and limits.get("current") is not None:
            return Rule("", _words(channel), f"{limits['current']:.3g} A", "", "", device.source("current"))
        return Rule(
            "", _words(channel), f"{max(channel.high):.3g} {channel.shown_unit}".rstrip(), "", "", default.CEILING
        )


def _words(channel: Channel) -> str:
    return channel.name.replace("_", " ")
