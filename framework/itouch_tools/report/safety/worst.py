"""The worst that a scene's script does to the operator's twin: the true values of the plant, not sensor readings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from itouch.monitors.thresholds import DOSE_FROM, DOSE_UNIT
from itouch.plugin import Record, Role
from itouch.session import Session
from itouch.world import truth

#: What is followed of a twin, by the roles of its fields, and how it is named in the report.
_SKIN = "skin temperature [K]"
_TRUE = {
    Role.SKIN_CONTACT_TEMPERATURE: "plate temperature [K]",
    Role.SKIN_TEMPERATURE: _SKIN,
    Role.HEAT_FLUX: "flux [W/m²]",
}
Value = Callable[[], float]


@dataclass(slots=True)
class Worst:
    """Follows a session tick by tick and keeps the extremes."""

    session: Session
    low: dict[str, float] = field(default_factory=dict)
    high: dict[str, float] = field(default_factory=dict)
    dose: float = 0.0
    longest: float = 0.0
    _touched: float = 0.0
    _values: dict[str, Value] = field(init=False)
    _skin: Value | None = field(init=False)
    _press: Any = field(init=False)

    def __post_init__(self) -> None:
        self._values = _values(self.session)
        self._skin = next((value for name, value in self._values.items() if name.endswith(_SKIN)), None)
        probe = self.session.model.probes[0].name if self.session.model.probes else ""
        self._press = self.session.state[f"{probe}.plate_force"] if probe else None

    def note(self, tick: int) -> None:
        """Look at the plant after a tick."""
        for name, value in self._values.items():
            now = value()
            if not self.low.get(name, math.inf) <= now:
                self.low[name] = now
            if not self.high.get(name, -math.inf) >= now:
                self.high[name] = now
        period = self.session.model.period
        if self._skin is not None and (skin := self._skin()) >= DOSE_FROM:
            self.dose += period * (0.5 if skin >= DOSE_UNIT else 0.25) ** (DOSE_UNIT - skin)
        pressed = self._press is not None and self._press.item() > 0.0
        self._touched = self._touched + period if pressed else 0.0
        self.longest = max(self.longest, self._touched)


def _values(session: Session) -> dict[str, Value]:
    """Return the functions that read what is followed, by its name with the unit at the end."""
    state, found = session.state, dict[str, Value]()
    for name, device in session.model.devices.items():
        if given := device.field(Role.FORCE_ON_OPERATOR, "sent"):
            found[f"{name}: force [N]"] = _length(state, given)
            if device.limits.torque is not None:
                found[f"{name}: torque [N m]"] = _length(state, given, 3)
        for role, what in _TRUE.items():
            if field_name := truth(session.model, name, role):
                found[f"{name}: {what}"] = state[field_name].item
        if sink := device.field(Role.HEAT_SINK_TEMPERATURE):
            found[f"{name}: sink temperature [K]"] = state[sink].item
    for probe in session.model.probes:
        found[f"{probe.name}: plate force [N]"] = state[f"{probe.name}.plate_force"].item
        found[f"{probe.name}: force in all [N]"] = state[f"{probe.name}.total_force"].item
        found[f"{probe.name}: speed [m/s]"] = _length(state, f"{probe.name}.velocity")
    return found


def _length(state: Record, name: str, first: int = 0) -> Value:
    """Return a function that reads the length of three numbers of a field, from the place ``first`` on."""
    view = state[name]
    return lambda: math.hypot(*view[first : first + 3].tolist())


def run(session: Session, *, longest: float = 120.0) -> tuple[Worst, str]:
    """Run the scene's script on its twins and follow it; return the extremes, and the fault that ended it ("": none).

    Parameters
    ----------
    session
        A session that has not run yet.
    longest
        How long [s] it runs where there is no script, 5 s at most.
    """
    from itouch.loop import DeviceFaultError

    worst, fault = Worst(session), ""
    session.taps.append(worst.note)
    try:
        session.run(None if session.scripted else min(longest, 5.0))
    except DeviceFaultError as error:
        fault = str(error)
    finally:
        session.taps.remove(worst.note)
    return worst, fault
