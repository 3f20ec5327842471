"""The driver of a Novint Falcon: open it, home it, read positions, send forces, light its ring.  Usable on its own.

>>> with Falcon("firmware.bin") as arm:              # doctest: +SKIP
...     arm.home(timeout=60)                         # pull the grip out, then push it in
...     while True:
...         x, y, z = arm.read().position
...         arm.write((0.0, 0.0, -200.0 * (z - 0.12)))

The frame is that of `itouch_usb_arm.kinematics`; forces are those on the operator.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from types import TracebackType
from typing import Any, Self

import numpy as np

from itouch.plugin import Trace
from itouch_usb_arm import boot, kinematics, link, loader
from itouch_usb_arm.errors import (
    Disconnected,
    FalconError,
    FirmwareError,
    HomingTimeout,
    NotHomed,
    ProtocolError,
    Timeout,
)
from itouch_usb_arm.exchange import PATIENCE, Exchange
from itouch_usb_arm.link import Link
from itouch_usb_arm.reading import Reading, Timing
from itouch_usb_arm.wire import MOTOR_LIMIT, Buttons, Leds, Reply, command, decode

#: Motor counts per newton metre.  The true value is not published: the guess of libnifalcon's makers (10 000) is about
#: four times what recorded traffic of the vendor's own driver shows.  This is the lower, safe one; measure yours with
#: `itouch-py calibrate force-scale`.
FORCE_SCALE = 2200.0
#: How many attempts are made to send zero force after an error.
_INSIST = 8
#: If an arm's speed is not known, its legs move between two frames by less than this many counts, plus this many a
#: second (2 m/s).  A known speed is extrapolated for at most this long [s].
_JUMP, _JUMP_RATE, _COASTS = 60, 40_000.0, 0.02
#: If it is known, a leg is at most this many counts from its extrapolated place (a wrong letter other than the lowest
#: makes 16), plus half this many counts/s^2 (300 m/s2) times t^2, plus its speed times the sum of t and this time [s],
#: by which t is uncertain.
_NEAR, _FORCED, _VAGUE = 12, 6.5e6, 1e-3
#: The arm is given up after this many frames of which no two agree.
_ASKED = 4
#: A frame that took longer than the first [s] may show the arm as it was that long ago: this machine was held up.
#: Delays count up to the second [s]: a frame that is then too far away is asked for again.
_PROMPT, _LATEST = 5e-3, 0.05
_NO_FORCE = (0.0, 0.0, 0.0)

#: How many frames are sent to find out whether the firmware runs, and how long [s] to wait for each answer: for the
#: first half, and for the rest, which give a slow line time.
_PROBES, PROBE_WAIT, _LONG_WAIT = 10, 0.03, 0.1


class Falcon:
    """The driver of one arm; it must not be used from two threads at once.

    Parameters
    ----------
    firmware
        The firmware's file, or its bytes; needed only after the arm has been powered on.
    backend
        A pyusb backend object; None: the system's libusb.
    serial
        The arm's serial number, or "any": the first of the attached arms that can be opened.
    device
        A pyusb device to open, if it was found before.
    force_scale
        Motor counts per newton metre.
    resume
        Whether to keep the homing that an earlier program left.
    patience
        Factor on every waiting time for an answer.
    trace
        Where to log the bytes that go over the wire.
    clock
        The host's time [s].
    """

    def __init__(
        self,
        firmware: str | Path | bytes | None = None,
        backend: Any = None,
        *,
        serial: str = "any",
        device: Any = None,
        force_scale: float = FORCE_SCALE,
        resume: bool = False,
        patience: float = 1.0,
        trace: Trace | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not (math.isfinite(force_scale) and force_scale > 0.0):
            raise ValueError(f"force_scale = {force_scale!r} is out of range: more than 0 counts/(N m)")
        self._firmware, self._backend, self._serial, self._device = firmware, backend, serial, device
        self._scale, self._resume, self._trace, self._clock = force_scale, resume, trace, clock
        self._patience = patience
        #: Lights to show; None: red until the arm is homed, then green.
        self.leds: Leds | None = None
        self.timing = Timing()
        self._link: link.Link | None = None
        self._wire: Exchange | None = None
        self._forget()

    def _forget(self) -> None:
        self._force: tuple[float, float, float] = _NO_FORCE
        self._homing = self._resume
        self._last: Reply | None = None
        self._position: kinematics.Vector | None = None
        self._when = self._late = 0.0
        self._speed: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._speeds: list[tuple[float, ...]] = []

    def __enter__(self) -> Self:
        return self if self.is_open else self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_open(self) -> bool:
        """Whether the arm is open."""
        return self._link is not None

    @property
    def homed(self) -> bool:
        """Whether the last frame reported all axes as homed."""
        return self._last is not None and all(self._last.homed)

    def open(self) -> Self:
        """Find and claim the arm; load its firmware if it is not running.  An open arm stays open.

        Raises
        ------
        NotFound, PermissionDenied, Disconnected
            If it cannot be opened; the message says what to do.
        FirmwareError
            If the firmware is needed and missing, not valid, or could not be loaded.
        """
        if self.is_open:
            return self
        image = image_of(self._firmware)
        opened = self._claimed()
        try:
            self._start(opened, image)
        except BaseException:
            opened.close()
            self._link = self._wire = None
            raise
        atexit.register(self.close)
        return self

    def _claimed(self) -> link.Link:
        """Claim the first arm that can be claimed; if none can, raise the first one's error."""
        devices = link.find(self._backend, self._serial) if self._device is None else [self._device]
        refused: FalconError | None = None
        for device in devices:
            try:
                return link.Link(device, self._trace, patience=self._patience)
            except FalconError as error:
                refused = refused or error
        raise refused or Disconnected("the arm was unplugged while it was opened")

    def _start(self, opened: link.Link, image: boot.Image | None) -> None:
        self._forget()
        wire, first = started(opened, image, homing=self._homing, patience=self._patience, clock=self._clock)
        self._link, self._wire, self._last = opened, wire, first  # its position counts once a second frame agrees

    def close(self) -> None:
        """Send zero force and release the arm; may be called at any time, more than once."""
        opened, wire = self._link, self._wire
        self._link = self._wire = None
        self._force = _NO_FORCE
        atexit.unregister(self.close)
        if opened is None or wire is None:
            return
        try:
            with contextlib.suppress(FalconError):
                self._silence(wire)
        finally:
            opened.close()
            self._last = self._position = None

    def _silence(self, wire: Exchange) -> None:
        """Send zero motor commands, and once more if no answer shows that they arrived."""
        frame = command((0, 0, 0), homing=self._homing, leds=self._shown())
        if wire.owed:
            wire.post(frame)
        for _ in range(2):
            with contextlib.suppress(Timeout, ProtocolError):
                wire.run(frame, frame, PROBE_WAIT * self._patience)
                return

    def read(self) -> Reading:
        """Exchange one frame: send the last written force, return the arm's answer.

        A frame that lost a byte or has an invalid one is asked for again; no reading is made from it.  Frames have no
        checksum: one with unexpected contents (positions, buttons, homing) counts only if the next one agrees.

        Returns
        -------
        Reading
            Its position [m] is NaN until all axes are homed.

        Raises
        ------
        Timeout, ProtocolError, Disconnected
            If the arm does not answer, sends invalid frames, or is gone.  Force is then zero until the next `write`.
        """
        began = self._clock()
        reply = self._believed()
        self._note(reply)
        now = self._clock()
        self._late = min(_LATEST, max(0.0, now - began - _PROMPT))
        self.timing.add(now, now - began)
        position = np.array(self._position or (math.nan,) * 3)
        position.setflags(write=False)
        return Reading(reply.encoders, position, reply.buttons, reply.homed)

    def write(self, force: Sequence[float]) -> None:
        """Set the force on the operator [N], three numbers; the next `read` sends it.

        Raises
        ------
        NotHomed
            If not all axes are homed; zero force was sent instead.
        ValueError
            If it is not three finite numbers.
        """
        numbers = tuple(float(part) for part in force)
        if len(numbers) != 3 or not all(math.isfinite(part) for part in numbers):
            self._force = _NO_FORCE
            raise ValueError(f"force = {numbers} must be three finite numbers [N]")
        if not self.homed:
            self._force = _NO_FORCE
            self.read()
            if not self.homed:
                raise NotHomed("the arm is not homed: pull the grip fully out, then push it in; zero force was sent")
        self._force = numbers

    def home(self, timeout: float = 60.0) -> Reading:
        """Exchange frames without force until the operator has homed all axes: pull the grip out, then push it in.

        Parameters
        ----------
        timeout
            How long to wait [s].

        Raises
        ------
        HomingTimeout
            If it takes longer; also a NotHomed.
        FalconError
            If the exchange fails.
        """
        self._homing = True
        self._force = _NO_FORCE
        end = self._clock() + timeout
        while True:
            reading = self.read()
            if reading.valid:
                return reading
            if self._clock() >= end:
                missing = ", ".join(str(axis + 1) for axis, done in enumerate(reading.homed) if not done)
                raise HomingTimeout(f"axis {missing} of the arm was not homed within {timeout:g} s")

    def _believed(self) -> Reply:
        """Exchange until an answer is as expected, or agrees with an earlier one."""
        now = self._clock()
        seen = [(now, self._last)] if self._last is not None and self._position is None else []
        for _ in range(_ASKED):
            reply, now = self._guarded(self._motors()), self._clock()
            if self._expected(reply, now) or any(_agree(reply, other, now - when) for when, other in seen):
                return reply
            seen.append((now, reply))
        raise self._failed(ProtocolError(f"the arm's encoders jump: {_ASKED} frames disagree"))

    def _guarded(self, motors: tuple[int, int, int]) -> Reply:
        """Exchange one frame; after any failure the force is zero."""
        if self._wire is None:
            raise Disconnected("the arm is not open")
        leds = self._shown()
        idle = command((0, 0, 0), homing=self._homing, leds=leds)
        try:
            frame = command(motors, homing=self._homing, leds=leds)
            return self._wire.run(frame, idle, PATIENCE * self._patience, insist=True)
        except Disconnected:
            self._drop()
            raise
        except FalconError as error:
            raise self._failed(error) from error.__cause__
        except BaseException:
            self._force = _NO_FORCE
            raise

    def _failed(self, error: FalconError) -> FalconError:
        """Set the force to zero, on the wire too, and return the error to raise."""
        self._force, self._position = _NO_FORCE, None
        for _ in range(_INSIST):
            if self._wire is None:
                break
            try:
                self._wire.post(command((0, 0, 0), homing=self._homing, leds=Leds.RED))
                break
            except Disconnected:
                self._drop()
            except FalconError:  # a stall, for example; try again, as the force must end
                continue
        return error

    def _drop(self) -> None:
        """Release an arm that is gone."""
        opened, self._link, self._wire = self._link, None, None
        atexit.unregister(self.close)
        self._forget()
        if opened is not None:
            opened.close()

    def _motors(self) -> tuple[int, int, int]:
        """Return the motor commands for the force at the arm's position, scaled down together to keep its direction."""
        if self._force == _NO_FORCE or self._position is None or not self.homed:
            return (0, 0, 0)
        try:
            torques = kinematics.torques(self._position, self._force)
        except kinematics.UnreachableError:
            return (0, 0, 0)
        counts = [-self._scale * torque for torque in torques]
        shrink = min(1.0, MOTOR_LIMIT / max(map(abs, counts), default=1.0))
        one, two, three = (max(-MOTOR_LIMIT, min(MOTOR_LIMIT, round(count * shrink))) for count in counts)
        return one, two, three

    def _shown(self) -> Leds:
        return self.leds if self.leds is not None else Leds.GREEN if self.homed else Leds.RED

    def _expected(self, reply: Reply, now: float) -> bool:
        """Tell whether a frame is as expected: an arm cannot jump, but homing moves its zero."""
        last = self._last
        if last is None or reply[1:] != last[1:]:
            return False
        if self._position is None:
            return not all(reply.homed)
        since = now - self._when
        ahead = min(since, _COASTS)
        return all(
            abs(new - (old + ahead * speed)) <= self._room(since, abs(speed))
            for new, old, speed in zip(reply.encoders, last.encoders, self._speed, strict=True)
        )

    def _room(self, since: float, speed: float) -> float:
        """Return how far a leg can be from its expected place [counts], ``since`` seconds after the last frame."""
        widest = _JUMP + _JUMP_RATE * (since + self._late)
        if self._late or since >= _COASTS:
            return widest
        return min(widest, _NEAR + 0.5 * _FORCED * since * since + speed * (since + _VAGUE))

    def _note(self, reply: Reply) -> None:
        """Store a reply; its position only if all axes are homed."""
        if not all(reply.homed):
            self._last, self._position, self._force = reply, None, _NO_FORCE
            return
        start = self._position or kinematics.CENTRE
        try:
            self._position = kinematics.forward(kinematics.angles_of(reply.encoders), start=start)
        except kinematics.UnreachableError as error:
            raise self._failed(
                ProtocolError(f"encoders {reply.encoders} are not a position of the arm: {error}")
            ) from error
        now, before = self._clock(), self._last
        since = now - self._when
        if before is not None and before.homed == reply.homed and 0.0 < since < _COASTS and not self._late:
            speed = tuple((a - b) / since for a, b in zip(reply.encoders, before.encoders, strict=True))
            # an undetected wrong letter spoils two of these speeds, forth and back; the median is not affected,
            # so that the range accepted for the next frame is not widened
            self._speeds = [*self._speeds[-2:], speed]
            if len(self._speeds) == 3:
                speed = tuple(map(median, zip(*self._speeds, strict=True)))
            self._speed = speed if max(map(abs, speed)) < _JUMP_RATE else (0.0, 0.0, 0.0)
        else:
            self._speed, self._speeds = (0.0, 0.0, 0.0), []
        self._last, self._when = reply, now


def _agree(one: Reply, other: Reply, apart: float) -> bool:
    """Tell whether two frames that came ``apart`` seconds after each other can be of the same arm in the same state."""
    limit = _JUMP + _JUMP_RATE * min(apart, _LATEST)
    near = all(abs(a - b) <= limit for a, b in zip(one.encoders, other.encoders, strict=True))
    return one[1:] == other[1:] and (near or not all(one.homed))


def image_of(firmware: str | Path | bytes | None) -> boot.Image | None:
    """Read and check the user's firmware file before anything is sent.

    Raises
    ------
    FirmwareError
        If it cannot be read or is not valid.
    """
    if firmware is None:
        return None
    try:
        return boot.load(firmware)
    except ValueError as error:
        raise FirmwareError(str(error)) from error


def started(
    opened: Link, image: boot.Image | None, *, homing: bool, patience: float, clock: Callable[[], float]
) -> tuple[Exchange, Reply]:
    """Return the exchange with the running firmware and its first answer, loading the firmware if needed.

    Raises
    ------
    FirmwareError
        If a firmware file is needed and missing, could not be loaded, or does not answer.
    """
    loader.purge(opened)
    loader.normal_mode(opened)
    wire = Exchange(opened, clock)
    first = _probe(wire, homing, patience)
    if first is None:
        if image is None:
            raise FirmwareError(
                "the arm's firmware does not run and no firmware file was given; "
                "name the file that came with the arm (it is not part of this program)"
            )
        loader.upload(opened, image, clock=clock)
        loader.normal_mode(opened)
        wire = Exchange(opened, clock)
        first = _probe(wire, homing, patience)
    if first is None:
        raise FirmwareError("the firmware was loaded but does not answer; is it the arm's own?")
    return wire, first


def _probe(wire: Exchange, homing: bool, patience: float) -> Reply | None:
    """Return the first answer to an idle frame, or None if no firmware runs.

    A boot loader that was left in the middle of an upload echoes every byte: an answer that equals the frame itself
    does not count.  The lights alternate, so that an arm whose true answer is the same is recognised at the next frame.
    """
    for attempt in range(_PROBES):
        leds = Leds.RED if attempt % 2 == 0 else Leds.RED | Leds.BLUE
        frame = command((0, 0, 0), homing=homing, leds=leds)
        with contextlib.suppress(Timeout, ProtocolError):
            reply = wire.run(frame, frame, (PROBE_WAIT if attempt < _PROBES // 2 else _LONG_WAIT) * patience)
            echo = Reply((0, 0, 0), Buttons(decode(frame).info), (False, False, False))
            if reply != echo:
                return reply
    return None
