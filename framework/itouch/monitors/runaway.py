"""Whether a plate's sensor and drive can be right: a frozen or drifting sensor (T8), a plate that runs away (T9)."""

from __future__ import annotations

import math
from collections.abc import Sequence

from itouch.monitors.trips import Trip
from itouch.plugin import Channel, Field, Moment, Record, Role, Rule

#: T8: how long [s] a driven plate may read exactly the same, what part of the drive counts as driven, and how many
#: seconds of full drive are enough by themselves.
FROZEN, DRIVEN, FROZEN_DRIVE = 1.0, 0.02, 0.15
#: T8: seconds of full drive, counted while it is strong, after which a plate cannot read exactly what it read before.
FROZEN_HELD = 0.5
#: T8: a plate that was moving under a steady drive above ``DRIFT_DRIVE`` cannot read exactly the same where it would
#: have gone so far [K], after the one and before the other time [s]; how long [s] its slope is smoothed.
STOPPED, STOPPED_TIME, STOPPED_WITHIN, SLOPE_TIME = 1.0, 0.5, 5.0, 0.3
#: T8: the same of a plate that was faster than this [K/s], after this time [s], however weakly driven: a driver that is
#: stuck at full strength brings it 30 K/s on, and nothing but the sensor tells.
FAST, FAST_TIME = 5.0, 0.2
#: T9: part of the drive in force, for how long [s], and what change of temperature [K] that must have, or must not; the
#: time [s] that drive and sensor may lag.
RUNAWAY_DRIVE, RUNAWAY_TIME, RUNAWAY_STILL, RUNAWAY_WRONG, LAG = 0.5, 2.0, 0.1, 2.0, 0.15
#: T8: a plate that is driven one way, by more than this part, for so long [s] and untouched, is not so far [K] on the
#: other side of its heat sink: its sensor has drifted.
DRIFT_DRIVE, DRIFT_TIME, DRIFT = 0.1, 10.0, 10.0
#: A drive that holds a temperature is at full strength so far [K] from its target.
FULL_STRENGTH = 10.0
#: A target below this [K] is none.
COLDEST_TARGET = 200.0
#: The extremes of the last two seconds are kept by parts of so many seconds.
PART, PARTS = 0.1, 24


def drive_of(channel: Channel, sent: float, temperature: float, ceiling: float) -> float:
    """Return how strongly a command drives its plate: -1 (heats) to 1 (cools).

    A drive that goes both ways cools when it is positive; one that goes one way only is a heater.
    """
    if channel.role is Role.TEMPERATURE_TARGET:
        known = sent >= COLDEST_TARGET  # else none was asked for yet
        return max(-1.0, min(1.0, (temperature - sent) / FULL_STRENGTH)) if known else 0.0
    heater = bool(channel.low) and max(channel.low) >= 0.0
    return -sent / ceiling if heater else sent / ceiling


class Runaway:
    """Compares what a plate reads with how it is driven.

    ``follows``: a strong drive must show; that of a device which controls its temperature itself is not known.
    ``part``: of the hardware's drive, what the limit in force leaves; a tighter one makes no drive less steady.
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
            Field("frozen_slope", unit="K/s", doc="how fast it went before, under a drive that was steady"),
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

    def forget(self, state: Record) -> None:
        """Begin anew."""
        state["frozen"][...] = math.nan
        state["driven_for"][...] = state["odd_for"][...] = state["frozen_slope"][...] = 0.0
        state["parts"][:] = -math.inf
        state["touched_at"][...] = -math.inf

    def check(
        self, state: Record, temperature: float, sink: float, drive: float, moment: Moment, news: bool
    ) -> float:  # fmt: skip
        """Return minus the code of a trip, or 0."""
        if moment.touched:
            state["touched_at"][...] = moment.now
        found = self._still(state, temperature, drive, moment) if news else 0.0
        return found or self._against(state, temperature, drive, moment) or self._odd(
            state, temperature, sink, drive, moment
        )  # fmt: skip

    def _still(self, state: Record, temperature: float, drive: float, moment: Moment) -> float:
        """Trip on a sensor that reads exactly the same while the drive changes, or the plate must go on (T8)."""
        passed, state["frozen_at"][...] = max(0.0, moment.time - state["frozen_at"].item()), moment.time
        before, change = state["frozen"].item(), abs(drive - state["frozen_from"].item())
        if temperature != before:
            elapsed, slope = state["frozen_for"].item() + passed, state["frozen_slope"].item()
            steady = change * self._part <= DRIVEN and elapsed > 0.0 and not math.isnan(before)
            newest = (temperature - before) / elapsed if steady else 0.0
            part = 1.0 - math.exp(-elapsed / SLOPE_TIME) if steady else 1.0
            state["frozen_slope"][...] = slope + part * (newest - slope)
            state["frozen"][...] = temperature
            state["frozen_for"][...] = state["frozen_drive"][...] = state["frozen_held"][...] = 0.0
            state["frozen_from"][...] = drive
            return 0.0
        strong = abs(drive) > RUNAWAY_DRIVE
        state["frozen_for"][...] = same = state["frozen_for"].item() + passed
        state["frozen_drive"][...] = driven = state["frozen_drive"].item() + change * passed
        state["frozen_held"][...] = held = state["frozen_held"].item() + abs(drive) * passed * strong
        changed = driven > FROZEN_DRIVE or (same > FROZEN and driven > DRIVEN * same)
        if changed or held > FROZEN_HELD or self._stopped(state, drive, same):
            state["figure2"][0] = same
            return -float(Trip.SENSOR_FROZEN)
        return 0.0

    def _stopped(self, state: Record, drive: float, same: float) -> bool:
        """Tell whether a plate that moved under a steady drive seems to have stopped from one reading to the next."""
        slope = abs(state["frozen_slope"].item())
        strong = abs(drive) > DRIFT_DRIVE
        driven = self._follows and strong and same > STOPPED_TIME
        # a device that controls its temperature itself stops where it was told to, however fast it came
        fast = (self._follows or strong) and slope > FAST and same > FAST_TIME
        return (driven or fast) and same <= STOPPED_WITHIN and slope * same > STOPPED

    def _against(self, state: Record, temperature: float, drive: float, moment: Moment) -> float:
        """Trip if the plate does not follow a strong drive, or goes the wrong way (T9)."""
        passed = state["driven_for"].item()
        if abs(drive) <= RUNAWAY_DRIVE or drive * passed < 0.0:
            state["driven_for"][...] = 0.0
            return 0.0
        state["driven_for"][...] = passed = passed + math.copysign(moment.seconds, drive)
        least, most = self._extremes(state, temperature, moment.now, moment.now - abs(passed) + LAG)
        against = (temperature - least) if drive > 0.0 else (most - temperature)
        if against > RUNAWAY_WRONG:
            state["figure2"][:] = (against, 0.0)
            return -float(Trip.RUNAWAY)
        alone = moment.now - state["touched_at"].item() >= RUNAWAY_TIME - 1e-9
        if abs(passed) >= RUNAWAY_TIME - 1e-9 and alone and self._follows and most - least < RUNAWAY_STILL:
            state["figure2"][:] = (0.0, abs(passed))
            return -float(Trip.RUNAWAY)
        return 0.0

    @staticmethod
    def _extremes(state: Record, temperature: float, now: float, begin: float) -> tuple[float, float]:
        """Note a temperature; return the extremes of the last two seconds, but not from before ``begin`` [s]."""
        if now < begin:
            return temperature, temperature
        parts = state["parts"]
        index = math.floor(now / PART)
        row = parts[index % PARTS]
        if row[0] != index * PART:
            row[:] = (index * PART, temperature, temperature)
        row[1], row[2] = min(row[1], temperature), max(row[2], temperature)
        known = parts[parts[:, 0] >= max(begin, now - RUNAWAY_TIME) - PART]
        return float(known[:, 1].min()), float(known[:, 2].max())

    @staticmethod
    def _odd(state: Record, temperature: float, sink: float, drive: float, moment: Moment) -> float:
        """Trip if a plate alone is long where its drive cannot have brought it: its sensor has drifted (T8)."""
        beyond = (temperature - sink) * math.copysign(1.0, drive)
        weak = not DRIFT_DRIVE < abs(drive) < RUNAWAY_DRIVE
        if moment.touched or weak or not beyond > DRIFT:
            state["odd_for"][...] = 0.0
            return 0.0
        state["odd_for"][...] = passed = state["odd_for"].item() + moment.seconds
        if passed <= DRIFT_TIME:
            return 0.0
        state["figure2"][:] = (beyond, passed)
        return -float(Trip.SENSOR_DISAGREE)

    @staticmethod
    def sentence(code: int, state: Record, plate: str) -> str:
        """Say what cannot be."""
        a, b = state["figure2"].tolist()
        if code == Trip.SENSOR_FROZEN:
            return f"reads the same {plate} for {a:.2f} s while driven"
        if code == Trip.SENSOR_DISAGREE:
            return f"reads {plate} {a:.1f} K on the wrong side of its heat sink for {b:.1f} s: a sensor must be wrong"
        what = f"went {a:.1f} K against its drive" if a else f"did not follow its drive for {b:.1f} s"
        return f"{what}: drive or sensor must be wrong"

    @staticmethod
    def rules(driven: Sequence[tuple[Channel, int]]) -> tuple[Rule, ...]:
        """Return T8 and T9 of a plate that is driven."""
        if not driven:
            return ()
        sane = "step of 5 K in 50 ms, frozen for 1 s while the drive changes, for 0.5 s of full drive"
        sane += ", where a moving plate would have gone 1 K on, or for 0.2 s after 5 K/s"
        sane += ", 10 K on the wrong side of its heat sink"
        away = "2 K against a drive above 50 % of the limit in force, or none of its effect for 2 s"
        return (Rule("T8", "sanity of its plate sensor", trip=sane), Rule("T9", "runaway", trip=away))
