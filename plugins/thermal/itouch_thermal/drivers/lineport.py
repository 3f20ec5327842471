"""The line protocol for self-built rigs: a command line, an answer line, each with a checksum.

Version 2 ends a line with a CRC-16 in four hexadecimal digits; a rig states its limits in its greeting, and answers
with the command's number and its own state:

    ``?``             ``N itouch-line 2 NAME amps=A plate=LOW:HIGH sink=HIGH silence=S reset=WHY cut=WHY``
    ``I NR AMPS``     ``R NR PLATE SINK FLUX SKIN AMPS STATE``
    ``C``             ``N ...``: releases a cut-off, if its cause is over

Version 1 has the exclusive or of the bytes before ``*`` in two digits, ``I AMPS`` and ``R PLATE SINK FLUX SKIN AMPS``.
Temperatures are in degrees Celsius, fluxes in W/m2; ``nan`` stands for a missing sensor; ``E WORDS`` is a refusal.
Without an ``I`` for 0.2 s the rig sets its current to zero by itself.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from itouch.plugin import DeviceError, Timestamps, Trace
from itouch_thermal.drivers.answer_times import AnswerTimes
from itouch_thermal.drivers.driver_params import BELIEVED, LinePort
from itouch_thermal.drivers.flowing_current import FlowingCurrent
from itouch_thermal.drivers.serialport import SerialLine
from itouch_thermal.drivers.stated_limits import CAUSES, StatedLimits, unmet_limits

GREETING = "itouch-line 1"
GREETING_2 = "itouch-line 2"
#: The first word of a refusal; more may follow.
REFUSED = "E"
#: How long [s] an answer may take beyond its transit, for how many such times a line is repeated, and how often at
#: most; the rig's own watchdog [s].
PATIENCE, SILENT, TRIES, WATCHDOG = 0.06, 3, 8, 0.2
#: A numbered command is repeated after this time [s] at the earliest, and after this many usual answer times: lost ones
#: must not make a reading too old, nor may a slow rig be overrun.  After a damaged line, wait only this long [s] for
#: more.
QUICK, USUAL, BEHIND = 0.02, 2.0, 0.01
#: Weight of a new answer time in the usual one.
_NEWEST = 0.25
#: Bytes of the longest command and its answer.
_BYTES = 80
#: How long [s] a rig may take to start: opening its port resets many boards, and their boot loaders wait first.
START = 2.5
KELVIN = 273.15
_NUMBER = re.compile(r"[-+]?([0-9]{1,9}(\.[0-9]+)?|nan)", re.IGNORECASE | re.ASCII)
#: Number of values in an answer; in version 2 the state follows them.
_NUMBERS = 5


class LineReading(NamedTuple):
    """A rig's measurements: temperatures [K], flux [W/m2] and current [A]; NaN without a sensor."""

    plate: float
    sink: float
    flux: float
    skin: float
    current: float


def crc(text: bytes) -> int:
    """Return the CRC-16 of version 2: polynomial 0x1021, initial value 0xFFFF."""
    found = 0xFFFF
    for byte in text:
        found ^= byte << 8
        for _ in range(8):
            found = (found << 1 ^ 0x1021 if found & 0x8000 else found << 1) & 0xFFFF
    return found


def seal(text: str) -> bytes:
    """Return a line with the checksum of version 1 and its end."""
    check = 0
    for byte in text.encode():
        check ^= byte
    return f"{text}*{check:02X}\n".encode()


def seal_2(text: str) -> bytes:
    """Return a line with the checksum of version 2 and its end."""
    return f"{text}*{crc(text.encode()):04X}\n".encode()


def unseal(line: bytes) -> str | None:
    """Return a line's text, or None if its checksum of version 1 is wrong."""
    return _unseal(line, 2, seal)


def unseal_2(line: bytes) -> str | None:
    """Return a line's text, or None if its checksum of version 2 is wrong."""
    return _unseal(line, 4, seal_2)


def _unseal(line: bytes, digits: int, sealed: Callable[[str], bytes]) -> str | None:
    body, star, check = line.strip(b"\r\n").decode("ascii", "replace").rpartition("*")
    if not star or len(check) != digits or not body.isascii():
        return None
    return body if sealed(body)[-1 - digits : -1].decode() == check.upper() else None


def _says(text: str, words: str) -> bool:
    """Tell whether a text is, or begins with, these words."""
    return text == words or text.startswith(f"{words} ")


class LineDriver:
    """An open rig, of either protocol version.

    Parameters
    ----------
    params
        The port and its settings.
    trace
        Where to log the lines that go over the wire.
    patience
        Factor on every waiting time for an answer.
    limits
        The limits in force for the device, by name, in SI: the limits that the rig states must satisfy them.
    release
        Whether to release a cut-off first.

    Raises
    ------
    DeviceError
        If it does not answer, does not speak the protocol, has cut itself off, or promises too little.
    """

    def __init__(
        self,
        params: LinePort,
        trace: Trace | None = None,
        *,
        patience: float = 1.0,
        limits: Mapping[str, Any] | None = None,
        release: bool = False,
    ) -> None:
        self._patience, self._way = patience, 0.0 if "://" in params.port else _BYTES * 10.0 / params.baud
        self._line = SerialLine(params.port, params.baud, end=b"\n", trace=trace, patience=max(1.0, patience))
        self._number, self._version = 0, 1
        #: Whether answers to a repeated line of version 1 may be on their way; to how many greetings they may.
        self._owes, self._greetings = False, 0
        #: Usual time that answers take [s], from the latest ones.
        self._usual = 0.0
        #: Transit time of the last answer on the wire [s]; unknown, 0, behind a socket.
        self._wire = 0.0
        #: Age of its readings when it sends them [s]; how long before its arrival the newest answer counts as given
        #: [s], and which answers are prompt.
        self._age, self._ago, self._times = params.age, 0.0, AnswerTimes()
        self._byte = 0.0 if "://" in params.port else 10.0 / params.baud
        #: The limits that a rig of version 2 states; None: it speaks version 1.
        self.stated: StatedLimits | None = None
        self._flowing = FlowingCurrent(f"the rig on {params.port}", less=True)
        try:
            self.identity = self._greet()
            if self._version == 2:
                if release:
                    self.identity = self._ask("C", "N")
                self.stated = StatedLimits.read(self.identity)
                self._check(self.stated, limits or {})
            elif params.firmware == "reference":
                raise DeviceError(f"on {params.port} answers '{self.identity}', not the reference display's program")
        except BaseException:
            self._line.close()
            raise

    def _greet(self) -> str:
        """Send the greeting until the rig has started; both versions understand version 1's greeting."""
        limit = time.monotonic() + START
        while True:
            try:
                found = self._ask("?", "N")
                break
            except _SilentError:
                if time.monotonic() >= limit:
                    raise
        if _says(found, GREETING_2):
            self._version = 2  # whichever checksum it has: the limits that it states must be checked
        elif not _says(found, GREETING):
            raise DeviceError(f"on {self._line.port} answers '{found}', not '{GREETING}' or '{GREETING_2}'")
        return found

    def _check(self, stated: StatedLimits, limits: Mapping[str, Any]) -> None:
        problems = unmet_limits(stated, limits)
        if stated.cut != "none":
            problems.insert(0, self._cut(stated.cut, "; find out why, then: itouch-py thermal display PORT --release"))
        if problems:
            raise DeviceError("; ".join(f"the rig on {self._line.port} {problem}" for problem in problems))

    @staticmethod
    def _cut(cause: str, then: str = "") -> str:
        return f"has cut itself off: {CAUSES.get(cause, cause)}{then}"

    def _body(self, answer: bytes) -> str | None:
        """Return the text of an intact answer; a greeting may have either checksum."""
        answer = answer.lstrip(b"\r\n\0")  # opening a port may produce zeros
        if self._version == 2:
            return unseal_2(answer)
        body = unseal(answer)
        if body is None and (greeting := unseal_2(answer)) is not None and _says(greeting, "N"):
            return greeting
        return body

    def _ask(self, text: str, wanted: str) -> str:
        """Send a line until its answer comes, and return the part of the answer after ``wanted``.

        Raises
        ------
        DeviceError
            If no answer comes, or the rig refuses.
        """
        line = seal_2(text) if self._version == 2 else seal(text)
        longest = self._patience * (self._way + PATIENCE)
        quick = min(self._patience * max(self._way + QUICK, USUAL * self._usual), longest)
        if self._owes and wanted == "R":
            self._hear_out(line, quick)
        begin = time.monotonic()
        for turn in range(TRIES):
            wait = quick if self._version == 2 else longest
            self._line.clear()
            self._line.send(line)
            self._greetings += wanted == "N"
            body = self._answer(wanted, wait)
            took = time.monotonic() - begin
            self._owes = self._owes or (wanted == "R" and (turn > 0 or body is None))
            if body is None and took < SILENT * longest:
                continue
            if body is None:
                break
            self._usual += _NEWEST * (took / self._patience - self._usual)
            if wanted != "N":
                self._ago = self._before(begin, len(line), again=turn > 0)
            if not _says(body, wanted):
                raise DeviceError(f"the rig on {self._line.port} refuses '{text}': {body[1:].strip()}")
            return body[len(wanted) :].strip()
        driven = ", and that its program answers '?' at any time" if self._owes and wanted == "N" else ""
        raise _SilentError(
            f"the rig on {self._line.port} did not answer '{text}', sent again and again; check its power and its "
            f"cable{driven}"
        )

    def _before(self, begin: float, size: int, *, again: bool) -> float:
        """Return how long ago the answer that has just come was given [s], to ``size`` bytes sent since ``begin`` [s].

        One that is late, or to a line sent ``again``, may have been given as soon as the rig was asked.
        """
        took = time.monotonic() - begin
        prompt = self._times.prompt(took - size * self._byte - self._wire)
        if again or not prompt:
            return took
        return self._wire if self._age else 0.5 * took

    def _hear_out(self, line: bytes, quiet: float) -> None:
        """Let late answers to a repeated line of version 1 pass: without numbers, they would be taken for the next's.

        Answers come in order: when the one to a greeting has come, those to all lines before it have.  Those to earlier
        greetings are heard out, too; if none comes for ``quiet`` seconds, they are lost.  The current that is to be set
        does not wait for that: its ``line`` is sent first, and its answer passes with the others.
        """
        self._line.send(line)
        self._ask("?", "N")
        end = time.monotonic() + quiet
        while self._greetings and (rest := end - time.monotonic()) > 0.0:
            answer = self._line.receive(rest)
            if answer is not None and self._greeted(self._body(answer)):
                end = time.monotonic() + quiet
        self._owes, self._greetings = False, 0

    def _greeted(self, body: str | None) -> bool:
        """Tell whether this answers a greeting, and count it."""
        found = body is not None and _says(body, "N")
        self._greetings = max(0, self._greetings - found)
        return found

    def _answer(self, wanted: str, wait: float) -> str | None:
        """Return the answer, or a refusal, that comes within ``wait`` seconds, or None.

        Everything else is skipped: an adaptor's echo, a talkative program's words, an answer to an earlier command.
        After a damaged line, which may have been the answer, the wait is cut short; not so after words without a
        checksum, which a program may print while it is still measuring.
        """
        limit = time.monotonic() + wait
        while True:
            answer = self._line.receive(max(0.0, limit - time.monotonic()))
            if answer is None:
                return None
            body = self._body(answer)
            self._greeted(body)
            if body is None:
                if b"*" in answer or answer.lstrip(b"\r\n\0").startswith(wanted[:1].encode()):
                    limit = min(limit, time.monotonic() + self._patience * (BEHIND + self._way))
            elif _says(body, wanted) or _says(body, REFUSED):
                self._wire = (len(answer) + 1) * self._byte  # including its end
                return body

    def exchange(self, current: float, stamps: Timestamps | None = None) -> LineReading:
        """Set the current [A], and read the measurements, which are never said to be newer than they may be.

        Raises
        ------
        DeviceError
            If the rig does not answer, refuses, answers nonsense, has lost a sensor, has cut itself off, or gives more
            current than commanded.
        """
        self._flowing.ask(current)
        said = self._order(f"{current:.5f}")
        if stamps is not None:
            stamps.measured(ago=self._ago, inside=self._age)
        words, state = said[:_NUMBERS], said[_NUMBERS:]
        fits = len(words) == _NUMBERS and len(state) == self._version - 1
        if not fits or not all(_NUMBER.fullmatch(word) for word in words):
            what = "five numbers" + (" and its state" if self._version == 2 else "")
            raise DeviceError(
                f"the rig on {self._line.port} answered '{' '.join(said)}', not {what}: digits with a sign and a "
                "point, or nan"
            )
        if state and state[0] not in ("ok", "held-back"):
            raise DeviceError(f"the rig on {self._line.port} {self._cut(state[0])}")
        plate, sink, flux, skin, actual = (float(word) for word in words)
        low, high = BELIEVED
        if not low <= skin <= high:
            skin = math.nan  # open or short: no finger
        if not (low <= plate <= high and low <= sink <= high and math.isfinite(actual)):
            raise DeviceError(f"the rig on {self._line.port} has lost its plate's or sink's sensor")
        self._flowing.follows(actual)
        return LineReading(plate + KELVIN, sink + KELVIN, flux, skin + KELVIN, actual)

    def _order(self, amps: str) -> list[str]:
        """Send a current; return the words of the answer after its number."""
        if self._version == 1:
            return self._ask(f"I {amps}", "R").split()
        self._number = (self._number + 1) % 256
        return self._ask(f"I {self._number} {amps}", f"R {self._number}").split()

    def close(self) -> None:
        """Set the current to zero, then release the line."""
        owes, self._owes = self._owes, False  # setting zero waits for no late answers
        try:
            self._order("0")
            if owes:  # but one of these may have been taken for its own
                self._owes = True
                self._order("0")
        finally:
            self._line.close()


class _SilentError(DeviceError):
    """No answer came."""
