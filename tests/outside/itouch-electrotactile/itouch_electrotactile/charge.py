"""Charge through the skin: its rate is bounded by a share, its sum over a session by a trip.

Figures of an example, not of a clinic: bring those of your electrode, and their source.
"""

import math

from itouch.plugin import Field, Monitor, Role, Rule

#: Mean charge a second [A]: where the pulses are cut down; twice as much trips.
RATE = 1e-4
#: Charge of a session [A s].
MOST = 0.05
#: Time [s] that the mean is taken over.
WINDOW = 1.0
FAST, SPENT, MORE = 1, 2, 3


class Charge(Monitor):
    """Watches every electrode drive whose amplitude is measured."""

    name = "charge"
    trips = {FAST: "charge-rate", SPENT: "charge-spent", MORE: "charge-unasked"}

    def __init__(self, device):
        super().__init__(device)
        self._asked = device.command(Role.ELECTRODE).name
        self._flows = device.reading(Role.DELIVERED_DRIVE).name
        self._width = getattr(device.params, "width", 1e-3)

    @classmethod
    def of(cls, device):
        """Return one for a device with an electrode whose current is read."""
        found = device.command(Role.ELECTRODE) is not None and device.reading(Role.DELIVERED_DRIVE) is not None
        return [cls(device)] if found else []

    @property
    def watches(self):
        """The electrode."""
        return (self._asked,)

    def fields(self):
        """Return the State that it needs: nothing is kept in attributes."""
        return (
            Field("given", low=0.0, unit="A*s", doc="charge of this session"),
            Field("mean", low=0.0, unit="A", doc="mean charge a second, over about a second"),
        )

    def clear_history(self, state):
        """Forget the mean; what the skin has got it keeps."""
        state["mean"] = 0.0

    def check(self, state, reading, sent, moment):
        """Count what flows, over the time that has really passed."""
        flows = abs(reading[self._flows].item())
        if flows > 1.2 * abs(sent[self._asked].item()) + 1e-3:
            return -float(MORE)
        now = flows * self._width * (sent["rate"].item() if "rate" in sent else 1.0)
        state["given"] += now * moment.seconds
        keep = math.exp(-moment.seconds / WINDOW)
        state["mean"] = mean = keep * state["mean"].item() + (1.0 - keep) * now
        if state["given"].item() > MOST:
            return -float(SPENT)
        if mean > 2.0 * RATE:
            return -float(FAST)
        return 1.0 if mean <= RATE else 2.0 - mean / RATE

    def sentence(self, code, state, reading, moment):
        """Say what it did."""
        if code == MORE:
            return f"gives {reading[self._flows].item() * 1e3:.1f} mA that nobody asked for"
        if code == SPENT:
            return f"has given {state['given'].item() * 1e3:.1f} mC in this session"
        return f"gives {state['mean'].item() * 1e6:.0f} µC a second"

    def rule(self, code, reading):
        """Return the rule by its quantity: it has no number in the reference."""
        return {FAST: "mean charge a second", SPENT: "charge of a session", MORE: "current not asked for"}[code]

    def exhausted_budget(self, state):
        """Say that no more may be given."""
        return "has given the whole charge of a session" if state["given"].item() > MOST else ""

    def rules(self):
        """Return what check, the safety report and the fault say."""
        return (
            Rule("", "mean charge a second", f"{RATE * 1e6:g} µC/s", f"{2 * RATE * 1e6:g} µC/s", "", "its plugin"),
            Rule("", "charge of a session", "", f"{MOST * 1e3:g} mC", f"{MOST * 1e3:g} mC", "its plugin"),
            Rule("", "current not asked for", "", "1.2 times what was sent, and 1 mA", "", "its plugin"),
        )
