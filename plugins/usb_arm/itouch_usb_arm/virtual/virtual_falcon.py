"""The virtual arm without any transport: control requests, bytes in both directions, and injected faults.

It consists of a serial chip with a latency timer, a boot loader that echoes, a firmware that answers frames, and the
arm's mechanics.  Its clock is the `Time` it is given; nothing here waits.
"""

from __future__ import annotations

import random
from collections import deque

from itouch_usb_arm import link
from itouch_usb_arm.boot import KEY
from itouch_usb_arm.kinematics import Vector
from itouch_usb_arm.loader import AUTOBAUD, KNOCK, WELCOME
from itouch_usb_arm.virtual.faults import Faults
from itouch_usb_arm.virtual.hand import Hand
from itouch_usb_arm.virtual.mechanics import Mechanics
from itouch_usb_arm.virtual.times import HostTime, Time
from itouch_usb_arm.wire import Buttons, Leds, Numbers, Scanner, encode

#: The modem status bytes that begin each packet.
MODEM_STATUS = b"\x01\x60"
#: How long the firmware takes to answer [s].
_THINKING = 50e-6
#: A leg is homed once it has passed this count and come back by so many; the hand pulls the grip here for that [m].
_MARK, _BACK, _PULLED = 700, 100, (0.0, 0.0, 0.172)


class UnpluggedError(Exception):
    """The arm is not on the bus."""


class StalledError(Exception):
    """The endpoint or request is stalled."""


class VirtualFalcon:
    """The emulated device.

    Parameters
    ----------
    running
        Whether the firmware is already running; after power-on it is not.
    homed
        Whether all axes are already homed.
    hand
        The hand on the grip; by default one that rests, and homes the arm when asked to.
    mechanics
        The moving parts; by default a grip in that hand.
    """

    def __init__(
        self,
        *,
        running: bool = False,
        homed: bool = False,
        hand: Hand | None = None,
        mechanics: Mechanics | None = None,
        time: Time | None = None,
        seed: int = 0,
    ) -> None:
        self.time: Time = time or HostTime()
        self.hand = hand or Hand()
        self.mechanics = mechanics or Mechanics(hand=self.hand)
        self.faults = Faults()
        self.buttons, self.leds = Buttons.NONE, Leds.OFF
        self.attached = True
        self.configuration = 0
        #: Frames that the firmware has received, newest last: motor commands and info bits.
        self.commands: deque[Numbers] = deque(maxlen=10_000)
        self._random = random.Random(seed)
        self._power_on(running)
        if homed:
            self._homed = [True] * 3
            self._offsets = [0] * 3

    def _power_on(self, running: bool) -> None:
        self.state = "running" if running else "off"
        self._homing = False
        self._homed, self._passed = [False] * 3, [False] * 3
        self._offsets = [self._random.randint(-3000, 3000) for _ in range(3)]
        self._baud, self._latency, self._dtr = 0, 16, True
        self._scanner, self._heard, self._uploaded = Scanner(), b"", bytearray()
        self._line: deque[tuple[float, int]] = deque()
        self._free = self._tick = 0.0
        self.mechanics.motors = (0, 0, 0)

    @property
    def homed(self) -> tuple[bool, bool, bool]:
        """Which axes are homed."""
        one, two, three = self._homed
        return one, two, three

    @property
    def position(self) -> Vector:
        """The grip's true position now [m]."""
        self.mechanics.advance(self.time.now())
        return self.mechanics.position

    def encoders(self) -> tuple[int, int, int]:
        """Return the encoder counts; an axis that is not homed has an arbitrary offset."""
        one, two, three = (c + o for c, o in zip(self.mechanics.counts(), self._offsets, strict=True))
        return one, two, three

    def unplug(self) -> None:
        """Pull the plug, which also cuts the power."""
        self.attached, self.configuration = False, 0
        self._power_on(False)

    def plug(self, *, running: bool = False) -> None:
        """Plug it in; with ``running``, only the USB plug had been pulled and the power stayed on."""
        self.attached = True
        self._power_on(running)

    # --- the three calls that a transport makes ------------------------------------------------------------------

    def control(self, request: int, value: int) -> None:
        """Handle a request to the serial chip."""
        self._present()
        if request == link.RESET:
            if value in (0, link.PURGE_RECEIVED):
                self._line.clear()
            if value in (0, link.PURGE_SENT):
                self._scanner.clear()
        elif request == link.BAUD:
            self._baud = value
        elif request == link.LATENCY:
            self._latency = value
        elif request == link.MODEM:
            self._modem(value)
        elif request not in (link.FLOW, link.DATA):
            raise StalledError(f"request {request}")

    def bulk_out(self, data: bytes) -> None:
        """Take bytes from the host."""
        self._present()
        if self._refuses():
            raise StalledError("OUT")
        if self.state == "running":
            if self._baud == link.BAUD_RUN:
                for numbers in self._scanner.feed(data):
                    self._run(numbers)
        elif self.state == "boot":
            self._knock(data)
        elif self.state == "autobaud":
            if self._baud == link.BAUD_142857 and data == AUTOBAUD:
                self._answer(AUTOBAUD)
                self.state = "upload"
        elif self.state == "upload":
            self._upload(data)

    def bulk_in(self) -> bytes | None:
        """Return the next packet, status and data; None as long as the chip has nothing to send."""
        self._present()
        if self._refuses():
            raise StalledError("IN")
        now = self.time.now()
        ready = sum(1 for when, _ in self._line if when <= now)
        if ready < link.PAYLOAD and now < self._tick:
            return None
        self._tick = now + self._latency * 1e-3
        data = bytes(self._line.popleft()[1] for _ in range(min(ready, link.PAYLOAD)))
        left = self.faults.unplug_after
        if left is not None and data:
            self.faults.unplug_after = left - len(data)
            if left <= len(data):
                self.faults.unplug_after = None
                self.unplug()
                raise UnpluggedError
        return MODEM_STATUS + data

    @property
    def next_packet(self) -> float:
        """When the latency timer next expires [s]."""
        return self._tick

    # --- inside ---------------------------------------------------------------------------------------------------

    def _present(self) -> None:
        if not self.attached:
            raise UnpluggedError

    def _refuses(self) -> bool:
        if self.faults.refuse > 0:
            self.faults.refuse -= 1
            return True
        return False

    def _modem(self, value: int) -> None:
        if value == link.DTR_LOW:
            self._dtr = False
            if self.state == "welcomed":
                self.state = "autobaud"
        elif value == link.DTR_HIGH:
            if not self._dtr and self._baud == link.BAUD_9600:  # the edge resets the processor into its boot loader
                self.state, self._heard = "boot", b""
                self._homed, self._homing = [False] * 3, False
                self.mechanics.motors = (0, 0, 0)
                self._uploaded.clear()
            self._dtr = True

    def _knock(self, data: bytes) -> None:
        if self._baud != link.BAUD_9600 or self.faults.deaf:
            return
        self._heard = (self._heard + data)[-8:]
        if self._heard.endswith(KNOCK):
            self._answer(b"\0" + WELCOME if self._random.random() < 0.5 else WELCOME)
            self.state = "welcomed"

    def _upload(self, data: bytes) -> None:
        at = len(self._uploaded)
        self._uploaded += data
        wrong = self.faults.boot_echo
        if wrong is not None and at <= wrong < at + len(data):
            self.faults.boot_echo = None
            data = data[: wrong - at] + bytes((data[wrong - at] ^ 0x10,)) + data[wrong - at + 1 :]
        self._answer(data)
        if _complete(self._uploaded):
            self.state = "running"
            self._scanner.clear()

    def _answer(self, data: bytes, delay: float = 0.0) -> None:
        """Put bytes on the serial line, at its baud rate."""
        per_byte = {link.BAUD_9600: 10 / 9600, link.BAUD_142857: 10 / 142_857}.get(self._baud, 10 / 1.5e6)
        now = self.time.now()
        when = max(self._free, now + delay)
        for byte in data:
            when += per_byte
            self._line.append((when, byte))
        self._free = when

    def _run(self, numbers: Numbers) -> None:
        """Execute a command frame: set the motors, home, and answer."""
        now = self.time.now()
        self.mechanics.advance(now)
        self.commands.append(numbers)
        self.mechanics.motors = numbers.values
        self.leds = Leds(numbers.info & 0x0E)
        self._home(bool(numbers.info & 1))
        homed = sum(bit << 4 + axis for axis, bit in enumerate(self._homed))
        self._reply(encode(self.encoders(), int(self.buttons) | homed))

    def _home(self, homing: bool) -> None:
        """Home the legs that were pulled out and have come back; without the homing bit, forget all homing."""
        if not homing:
            if any(self._homed):
                self._offsets = [self._random.randint(-3000, 3000) for _ in range(3)]
            self._homed, self._passed, self.hand.pull = [False] * 3, [False] * 3, None
            return
        if all(self._homed) or self.faults.unhomed:
            self.hand.pull = None
            return
        self.hand.pull = None if all(self._passed) else _PULLED
        for axis, count in enumerate(self.mechanics.counts()):
            if count > _MARK:
                self._passed[axis] = True
            elif self._passed[axis] and count < _MARK - _BACK:
                self._homed[axis], self._offsets[axis] = True, 0

    def _reply(self, frame: bytes) -> None:
        faults = self.faults
        if faults.mute > 0:
            faults.mute -= 1
            return
        if faults.drop > 0:
            faults.drop -= 1
            place = self._random.randrange(len(frame))
            frame = frame[:place] + frame[place + 1 :]
        if faults.bad > 0:
            faults.bad -= 1
            place = self._random.randrange(1, 13)
            frame = frame[:place] + b"\x7f" + frame[place + 1 :]
        if faults.wrong > 0:
            faults.wrong -= 1
            place = self._random.randrange(1, 13)
            letter = 0x41 + (frame[place] - 0x41 ^ self._random.randrange(1, 16))
            frame = frame[:place] + bytes((letter,)) + frame[place + 1 :]
        if faults.stray > 0:
            faults.stray -= 1
            frame = b"<A\x00" + frame
        delay, faults.late = faults.late, 0.0
        self._answer(frame, _THINKING + delay)


def _complete(data: bytearray) -> bool:
    """Tell whether a boot stream is complete."""
    if data[:2] != KEY:
        return False
    at = 22
    while at + 2 <= len(data):
        size = data[at] | data[at + 1] << 8
        if size == 0:
            return True
        at += 6 + 2 * size
    return False
