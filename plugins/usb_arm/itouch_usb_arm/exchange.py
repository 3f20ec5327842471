"""One frame out, one frame in: skip damaged bytes, and never take an old answer for a new one."""

from __future__ import annotations

from collections.abc import Callable

from itouch_usb_arm.errors import ProtocolError, Timeout
from itouch_usb_arm.link import Link
from itouch_usb_arm.loader import purge
from itouch_usb_arm.wire import Reply, Scanner, reply_of

#: How long [s] to wait for an answer before it counts as lost, and for an answer that is still owed.
PATIENCE = 0.1
#: After this much silence [s] and this many empty packets, the rest of a damaged answer will not come.
_QUIET, _EMPTIES = 0.005, 2
#: How many damaged answers to one frame are accepted before giving up.
_TRIES = 3
#: After this time [s] without an answer a frame is sent again, this many times at most: within an arm's watchdog of
#: 20 ms.
_SOON, _AGAIN = 0.006, 3
#: After a lost answer, the next so many exchanges check whether it still comes.
_WATCHED = 20


class _DamagedError(Exception):
    """Bytes came that do not form a frame."""


class _SilentError(Exception):
    """Nothing came."""


class Exchange:
    """Exchanges frames one for one; ``owed`` counts the answers that have not come yet."""

    def __init__(self, link: Link, clock: Callable[[], float]) -> None:
        self._link, self._clock = link, clock
        self._scanner = Scanner()
        self.owed = 0
        self._watched = 0
        #: Number of frames sent again because their answer was damaged or lost.
        self.repeated = 0

    def run(self, frame: bytes, again: bytes, patience: float = PATIENCE, *, insist: bool = False) -> Reply:
        """Send a frame and return its answer; if the answer is damaged, send ``again`` instead, a frame without force.

        With ``insist``, do so too if no answer comes.  An answer that was merely late may then arrive beside that to
        the repeated frame: the last one counts.

        Raises
        ------
        Timeout
            If no answer comes within ``patience`` seconds.
        ProtocolError
            If the answer is damaged several times.
        FalconError
            If the link fails.
        """
        if self.owed:
            self._settle(patience)
        begin, soon, damaged, lost = self._clock(), _SOON * patience / PATIENCE, 0, 0
        most = _AGAIN if insist else 0
        while damaged < _TRIES:
            self.owed += 1
            self._link.send(frame)
            rest = begin + patience - self._clock() if damaged == 0 else patience
            try:
                reply = self._answer(min(soon, rest) if lost < most else rest)
            except _DamagedError:
                damaged += 1
                self._clear()
            except _SilentError as error:
                lost += 1
                if lost > most:
                    raise Timeout(f"the arm did not answer within {patience * 1e3:.0f} ms") from error
                self._watched = _WATCHED
            else:
                self.owed = 0
                return self._newest(reply) if self._watched else reply
            self.repeated += 1
            frame = again
        raise ProtocolError(f"the arm answered nonsense {_TRIES} times; check its cable and power")

    def post(self, frame: bytes) -> None:
        """Send a frame without waiting for its answer, which is then owed."""
        self.owed += 1
        self._link.send(frame)

    def _answer(self, patience: float) -> Reply:
        self._scanner.clear()
        begin = heard = self._clock()
        empties = 0
        while True:
            data = self._link.receive(max(1e-3, begin + patience - self._clock()))
            now = self._clock()
            found = self._scanner.feed(data)
            if found:
                return reply_of(found[-1])
            if data:
                heard, empties = now, 0
                continue
            empties += 1
            damaged = self._scanner.skipped or self._scanner.pending
            if damaged and empties >= _EMPTIES and now - heard >= _QUIET:
                raise _DamagedError
            if now - begin >= patience:
                if damaged:
                    raise _DamagedError
                raise _SilentError

    def _settle(self, patience: float) -> None:
        """Wait for the answers that are owed and drop them: the next answer must belong to the next frame."""
        begin, missing, empties = self._clock(), self.owed, 0
        self._scanner.clear()
        while missing > 0 and self._clock() - begin < patience:
            data = self._link.receive(patience)
            missing -= len(self._scanner.feed(data))
            empties = 0 if data else empties + 1
        if missing > 0:
            self._watched = _WATCHED
        self._clear()

    def _newest(self, reply: Reply) -> Reply:
        """Return the last answer that has arrived: the one before it may answer an earlier frame, far too late."""
        self._watched -= 1
        while data := self._link.receive(_QUIET):
            found = self._scanner.feed(data)
            if found:
                reply, self._watched = reply_of(found[-1]), 0
        return reply

    def _clear(self) -> None:
        purge(self._link)
        self._scanner.clear()
        self.owed = 0
