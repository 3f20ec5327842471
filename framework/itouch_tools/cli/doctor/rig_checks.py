"""The harmless half of a laboratory's checklist, on a rig in the air: sensors, watchdogs, cut-offs.

Devices are opened as for a session, and read and written at its rate, but never enabled: they get only their safe
commands, which for a surface is to retreat: it goes down from the first tick on.  At the end everything is stopped as
after a fault, and that is verified.  Each line names the rule that it is about.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import DeviceFaultError, Trip
from itouch.monitors import default_limits as default
from itouch.monitors.thresholds import TOUCH_FORCE
from itouch.plugin import DeviceError, Record, Role
from itouch.safety import HoldToRun, Status, connect
from itouch.schema import ItouchError
from itouch.session import Session
from itouch_tools.cli.doctor.diagnosis import Diagnosis

if TYPE_CHECKING:
    from itouch.loop.device_runner import Runner


#: What a delivered drive may still read when it is off, as a share of the drive's greatest value.
OFF = 0.02
#: If a reading does not change for this time [s], nobody knows whether its sensor is alive.
STILL = 1.0
#: The statuses of a line of the checklist.
PASS, FAIL, NOT = "pass", "fail", "not possible"


def examine_rig(session: Session, seconds: float) -> Iterator[Diagnosis]:
    """Yield the findings on a rig that nobody touches, watched for some seconds; the session is closed at the end."""
    try:
        yield from _examined(session, seconds)
    except BaseException:
        session.close()
        raise
    try:
        session.close()
    except ItouchError as error:  # what was found must still be summed up
        told = "; ".join([str(error), *getattr(error, "__notes__", ())])
        yield Diagnosis("W2 release", FAIL, told, "switch the supplies off by hand: nobody knows what it does now")


def _examined(session: Session, seconds: float) -> Iterator[Diagnosis]:
    watched = [Watched(runner, session.state) for runner in session.runners]
    failures = connect([one.lifecycle for one in session.runners], session.ticks)
    for name, why in failures.items():
        yield Diagnosis(
            f"W1 {name}", FAIL, f"does not answer: {why}", "check power, cable and address: itouch-py devices --probe"
        )
    there = [one for one in watched if one.model.name not in failures]
    for one in there:
        one.runner.gate.actuation.rest_at_measured()
    _watch(session, there, seconds)
    for one in there:
        yield from _sensors(one, seconds)
        yield _watchdog(one)
        yield from _drives(one)
    yield from _stop(session, there)
    yield _switch(session)


def _watch(session: Session, there: list[Watched], seconds: float) -> None:
    """Run the rig for some seconds as it is before anything is enabled."""
    period, real = session.model.period, session.clock.pace == "real"
    session.clock.start(period)
    for one in there:
        one.since = session.ticks
    for _ in range(max(1, round(seconds / period))):
        tick = session.ticks
        for one in there:
            one.look(tick, period)
        session.step_twins(False)
        for tap in session.taps:
            tap(tick)
        if real and session.clock.wait() > 0.1:
            session.clock.start(period)


def _sensors(one: Watched, seconds: float) -> Iterator[Diagnosis]:
    name, patience = one.model.name, one.model.limits.watchdog or default.WATCHDOG_OTHER
    if one.fault is not None:
        yield Diagnosis(
            f"T8 {name}",
            FAIL,
            one.fault.cause,
            "check its sensor and its cable: nothing may be enabled until its readings are true",
        )
        return
    if not one.model.reads:
        yield Diagnosis(f"W1 {name}", NOT, "it reads nothing", "watch by eye what it does")
        return
    if not one.count:
        yield from _silent(one, seconds)
        return
    rate = one.count / seconds
    late = f"{rate:.0f} readings/s, at most {one.gap * 1e3:.0f} ms apart; it stops after {patience * 1e3:.0f} ms"
    if one.gap > patience:
        yield Diagnosis(
            f"W1 {name}", FAIL, late, "a slow or disturbed line, or a busy machine: itouch-py doctor --measure 10s"
        )
    else:
        yield Diagnosis(f"W1 {name}", PASS, late)
    if one.still and seconds >= STILL:
        yield Diagnosis(f"T8 {name}", NOT, "its readings never change: a sensor that is stuck would look the same",
                      "warm it, press it or move it by hand, and watch the reading in the window")  # fmt: skip
    else:
        yield Diagnosis(f"T8 {name}", PASS, "every reading is a number, in its range, and no jump")
    yield from _nobody_there(one)


def _silent(one: Watched, seconds: float) -> Iterator[Diagnosis]:
    """Yield the findings on a device that answered when it was opened and never again: what can't be known then."""
    found = f"it answered when it was opened, and then nothing came in {seconds:g} s"
    yield Diagnosis(
        f"W1 {one.model.name}", FAIL, found, "check power and cable, and what its plugin does when it waits"
    )
    rules = {Role.CONTACT_FORCE: "K4", Role.TRACKED_POSE: "K6", Role.SKIN_CONTACT_TEMPERATURE: "T1",
             Role.DELIVERED_DRIVE: "T9"}  # fmt: skip
    roles = {channel.role for channel in one.model.reads}
    for rule in ("T8", *(rule for role, rule in rules.items() if role in roles)):
        yield Diagnosis(f"{rule} {one.model.name}", NOT, "no reading came that could tell", "see W1")


def _nobody_there(one: Watched) -> Iterator[Diagnosis]:
    """Check what sensors must read while nobody touches the rig."""
    name = one.model.name
    if (force := one.at(Role.CONTACT_FORCE, one.mean)) is not None:
        size = math.hypot(*force[1][:3])
        found = f"{force[0]} reads {size:.3f} N in the air; from {TOUCH_FORCE:g} N on it counts as a touch"
        bad = not size <= TOUCH_FORCE
        yield Diagnosis(
            f"K4 {name}", FAIL if bad else PASS, found, "take off what lies on it, and tare the sensor" if bad else ""
        )
    place, target = one.at(Role.TRACKED_POSE, one.newest), one.model.command(Role.SURFACE_POSE)
    if place is not None and target is not None and target.low:
        inside = all(
            low - 1e-3 <= x <= high + 1e-3 for x, low, high in zip(place[1][:3], target.low, target.high, strict=False)
        )
        shown = " ".join(f"{x * 1e3:.1f}" for x in place[1][:3])
        found = f"it stands at {shown} mm, {'in' if inside else 'out of'} its travel"
        advice = "" if inside else "home it again, and check <hardware travel>"
        yield Diagnosis(f"K6 {name}", PASS if inside else FAIL, found, advice)
    plate = one.at(Role.SKIN_CONTACT_TEMPERATURE, one.mean)
    if plate is not None:
        apart = max(abs(x - one.model.ambient) for x in plate[1])
        room = one.model.ambient - 273.15
        found = f"{plate[0]} reads {plate[1][0] - 273.15:.1f} degC; the room of the scene has {room:.1f}"
        bad = apart > 5.0
        yield Diagnosis(
            f"T1 {name}",
            NOT if bad else PASS,
            found,
            "let it come to the room's temperature, and start again" if bad else "",
        )


def _watchdog(one: Watched) -> Diagnosis:
    name, own = one.model.name, one.model.cls.watchdog_for(one.model.params)
    if not one.model.commands:
        return Diagnosis(f"W2 {name}", NOT, "it obeys nothing: there is nothing to cut off")
    if one.model.twin:
        return Diagnosis(
            f"W2 {name}",
            NOT,
            "it is simulated: a twin proves no watchdog of a device",
            "run this on the device: --twin none",
        )
    if own is None:
        found = "it has no watchdog of its own that its plugin knows of: it runs with the guardian and hold-to-run only"
        advice = "pull its cable with the drive on, without a finger, and see by a meter what it does"
        return Diagnosis(f"W2 {name}", NOT, found, advice)
    found = f"its own watchdog of {own * 1e3:g} ms was armed and accepted when it was opened"
    advice = "only pulling its cable proves that it cuts off: do so with the drive on, without a finger"
    return Diagnosis(f"W2 {name}", PASS, found, advice)


def _drives(one: Watched) -> Iterator[Diagnosis]:
    """Check the delivered drive while nothing but safe commands are sent."""
    delivered = one.at(Role.DELIVERED_DRIVE, one.most)
    if delivered is None or one.fault is not None or not one.count:
        return
    drives = [c for c in one.model.commands if c.role is Role.DRIVE and c.high]
    most = OFF * max((max(c.high) for c in drives), default=1.0)
    worst = max(delivered[1])
    found = f"{delivered[0]} reads {worst:.3g} at most while nothing is asked for"
    bad = not worst <= most
    yield Diagnosis(
        f"T9 {one.model.name}",
        FAIL if bad else PASS,
        found,
        "switch its supply off: it drives by itself" if bad else "",
    )


def _switch(session: Session) -> Diagnosis:
    """Check after the stop that nothing can be enabled while nobody holds the dead-man's switch."""
    asked = session.model.scene.safety.hold_to_run
    hold = HoldToRun(session.state, [one.gate for one in session.runners], session.model.period, asked=asked)
    if not hold.required:
        return Diagnosis(
            "W3",
            NOT,
            "no device here could hurt anybody: no switch has to be held",
            "run this on the devices: --twin none",
        )
    if hold.held(session.ticks):
        return Diagnosis(
            "W3",
            FAIL,
            "the dead-man's switch reads as held, though nobody holds it",
            "let it go, or repair it if it is stuck; the operator of a virtual rig never lets go",
        )
    try:
        session.rearm()
    except DeviceError as error:
        said = str(error)
        if "dead-man's switch" in said:
            advice = "hold it and let go in a session without a finger: the drive must go off each time"
            return Diagnosis("W3", PASS, "nothing can be enabled while nobody holds the switch", advice)
        return Diagnosis("W3", NOT, f"nothing can be enabled: {said.splitlines()[0]}", "repair what is said first")
    return Diagnosis("W3", FAIL, "devices were enabled though nobody holds the switch", "do not use this rig")


def _stop(session: Session, there: list[Watched]) -> Iterator[Diagnosis]:
    """Stop everything as after a fault, and yield what was then seen of each device."""
    acting = [one for one in there if one.model.commands and one.runner.latch.status is not Status.CLOSED]
    if not acting:
        yield Diagnosis("W2", NOT, "there is nothing to cut off")
        return
    session.make_safe(
        DeviceFaultError(acting[0].model.name, session.ticks, Trip.RELEASED, "was stopped to see it stop")
    )
    # an optional device that is lost meanwhile has a fault of its own in the list, without "safe"
    outcome = next(fault["safe"] for fault in reversed(session.statistics.faults) if "safe" in fault)
    seen = outcome["devices"]
    told = "; ".join(f"{one.model.name}: {seen[one.model.name]}" for one in acting)
    found = f"after {outcome['after_s'] * 1e3:.0f} ms: {told}"
    advice = "" if outcome["reached"] else "do not use this rig before each of them is seen to be safe"
    yield Diagnosis("W2", PASS if outcome["reached"] else FAIL, found, advice)


class Watched:
    """One device of the rig, with statistics of its readings."""

    def __init__(self, runner: Runner, state: Record) -> None:
        self.runner, self.model = runner, runner.model
        self._sequence = state[f"{runner.model.name}.sequence"]
        #: How many readings came, the longest time [s] between two, and the tick of the newest.
        self.count, self.gap, self.since = 0, 0.0, 0
        self.fault: DeviceFaultError | None = None
        self._rows: set[bytes] = set()
        #: Mean, newest and greatest absolute value of each number that was read; meaningless until ``count`` > 0.
        self.mean, self.newest, self.most = (np.zeros(runner.reading.numbers.shape) for _ in range(3))

    def look(self, tick: int, period: float) -> None:
        """Read what has come, and write safe commands; the loss of an optional device counts as a fault, too."""
        if self.fault is not None or self.runner.latch.status is Status.CLOSED:
            return
        before = int(self._sequence)
        on_loss, self.runner.gate.on_loss = self.runner.gate.on_loss, None
        try:
            self.runner.gate.read(tick)
            self.runner.gate.write(tick)
        except DeviceFaultError as fault:
            self.fault = fault
            return
        finally:
            self.runner.gate.on_loss = on_loss
        if self.runner.latch.status is Status.FAULT:  # its readings are no longer checked then
            trip = self.runner.latch.trip
            self.fault = DeviceFaultError(self.model.name, tick, trip, f"was stopped before by {trip.label}")
            return
        if int(self._sequence) != before:
            self._keep(tick)
        self.gap = max(self.gap, (tick - self.since) * period)

    def _keep(self, tick: int) -> None:
        numbers = self.runner.reading.numbers
        self.count, self.since = self.count + 1, tick
        self.mean += (numbers - self.mean) / self.count
        self.newest[:] = numbers
        np.maximum(self.most, np.abs(numbers), out=self.most)
        if len(self._rows) < 2:
            self._rows.add(numbers.tobytes())

    def at(self, role: Role, numbers: NDArray[Any]) -> tuple[str, list[float]] | None:
        """Return the name of the reading with a role, and its part of ``mean``, ``newest`` or ``most``; None: none.

        ``numbers`` (n,) are those of all readings, one after the other, in their channels' units.
        """
        begin = 0
        for channel in self.model.reads:
            if channel.role is role:
                return channel.name, numbers[begin : begin + channel.size].tolist()
            begin += channel.size
        return None

    @property
    def still(self) -> bool:
        """Whether no number that was read has ever changed."""
        return len(self._rows) < 2
