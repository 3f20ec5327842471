"""Whether a plate's sensor and drive can be right: a frozen or drifting sensor (T8), a plate that runs away (T9)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from itouch.monitors.thresholds import PARTS
from itouch.monitors.trips import Trip
from itouch.plugin import Channel, Field, Record, Role, Rule

if TYPE_CHECKING:
    from itouch.monitors import runaway_kernels


def drive_of(channel: Channel, sent: float, temperature: float, ceiling: float) -> float:
    """Return how strongly a command drives its plate: -1 (heating) to 1 (cooling).

    A bipolar drive cools when it is positive; a unipolar one is a heater.
    """
    from itouch.monitors import runaway_kernels  # here, so that the compiler is loaded only if a device runs

    target, most = channel.role is Role.TEMPERATURE_TARGET, signed(channel, ceiling)
    return runaway_kernels.drive_of(target, float(sent), float(temperature), most)


def signed(channel: Channel, ceiling: float) -> float:
    """Return the greatest drive of a command, negative for a unipolar one, which is a heater."""
    heater = bool(channel.low) and max(channel.low) >= 0.0
    return -float(ceiling) if heater else float(ceiling)


class Runaway:
    """Compares the readings of a plate with how it is driven; the arithmetic is in ``runaway_kernels``.

    ``follows``: a strong drive must have an effect; not so in a device that controls its temperature itself, whose
    drive is not known.  ``part``: the limit in force as a part of the hardware's greatest drive; with it, changes of
    the drive are judged by the hardware's scale, so that a tighter limit makes no drive less steady.
    """

    def __init__(self, *, follows: bool, part: float = 1.0) -> None:
        self._follows, self._part = follows, part

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (
            Field("frozen", unit="K", doc="the reading that has been exactly the same; NaN: none yet"),
            Field("frozen_at", unit="s", doc="when the newest reading was measured"),
            Field("frozen_for", low=0.0, unit="s", doc="for how long it has been the same"),
            Field("frozen_drive", low=0.0, unit="s", doc="how much the drive has changed meanwhile, times time"),
            Field("frozen_held", low=0.0, unit="s", doc="seconds of full drive meanwhile, while the drive was strong"),
            Field("frozen_slope", unit="K/s", doc="how fast it changed before, under a steady drive"),
            Field("frozen_from", unit="1", doc="drive when that began, as a part of the limit in force"),
            Field("driven_for", unit="s", doc="how long a strong drive has lasted; > 0 cools, < 0 heats"),
            Field(
                "parts",
                "f8",
                (PARTS, 3),
                unit="mixed",
                doc="time, least and greatest temperature of tenths of a second",
            ),
            Field("touched_at", unit="s", doc="when the plate was last touched"),
            Field("odd_for", low=0.0, unit="s", doc="for how long it has been on the wrong side of its heat sink"),
            Field("figure2", "f8", 2, unit="mixed", doc="the figures of the last trip of sensor or drive"),
        )

    def clear(self, state: Record) -> None:
        """Forget what was measured."""
        state["frozen"][...] = math.nan
        state["driven_for"][...] = state["odd_for"][...] = state["frozen_slope"][...] = 0.0
        state["parts"][:] = -math.inf
        state["touched_at"][...] = -math.inf

    @property
    def checks(self) -> runaway_kernels.SensorChecks:
        """What is known of the drive, for compiled code."""
        from itouch.monitors.runaway_kernels import SensorChecks

        trips = (int(trip) for trip in (Trip.SENSOR_FROZEN, Trip.SENSOR_DISAGREE, Trip.RUNAWAY))
        return SensorChecks(bool(self._follows), float(self._part), *trips)

    @staticmethod
    def memory(state: Record) -> runaway_kernels.Memory:
        """Return what is remembered, for compiled code."""
        from itouch.monitors.runaway_kernels import Memory

        return Memory(*(state[name].reshape(-1) if name != "parts" else state[name] for name in Memory._fields))

    @staticmethod
    def sentence(code: int, state: Record, plate: str) -> str:
        """Return what is impossible in the readings."""
        a, b = state["figure2"].tolist()
        if code == Trip.SENSOR_FROZEN:
            return f"reads the same {plate} for {a:.2f} s while driven"
        if code == Trip.SENSOR_DISAGREE:
            return f"reads {plate} {a:.1f} K on the wrong side of its heat sink for {b:.1f} s: a sensor must be wrong"
        what = f"went {a:.1f} K against its drive" if a else f"did not follow its drive for {b:.1f} s"
        return f"{what}: drive or sensor must be wrong"

    @staticmethod
    def rules(driven: Sequence[tuple[Channel, int]]) -> tuple[Rule, ...]:
        """Return T8 and T9 for a plate that is driven."""
        if not driven:
            return ()
        plausible = "step of 5 K in 50 ms, frozen for 1 s while the drive changes, for 0.5 s of full drive"
        plausible += ", where a moving plate would have gone 1 K on, or for 0.2 s after 5 K/s"
        plausible += ", 10 K on the wrong side of its heat sink"
        away = "2 K against a drive above 50 % of the limit in force, or none of its effect for 2 s"
        return (Rule("T8", "plausibility of its plate sensor", trip=plausible), Rule("T9", "runaway", trip=away))
