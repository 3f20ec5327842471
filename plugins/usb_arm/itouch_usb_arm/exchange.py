"""One frame out, one frame in: waiting, passing over damaged bytes, and never taking an old answer for a new one."""

from __future__ import annotations

from collections.abc import Callable

from itouch_usb_arm.errors import ProtocolError, Timeout
from itouch_usb_arm.link import Link
from itouch_usb_arm.loader import purge
from itouch_usb_arm.wire import Reply, Scanner, reply_of

#: How long [s] an answer may take before it counts as lost, and how long an answer that is owed is waited for.
PATIENCE = 0.1
#: After damaged bytes: so long [s], and so many empty packets, and the rest will not come any more.
_QUIET, _EMPTIES = 0.005, 2
#: How often a frame whose answer was damaged is sent.
_TRIES = 3
#: After how long [s] a frame is sent again that nothing has answered, and how often: within an arm's watchdog of 20 ms.
_SOON, _AGAIN = 0.006, 3
#: After an answer that never came, so many exchanges are watched for it.
_WATCHED = 20


class _DamagedError(Exception):
    """Bytes came that make no frame."""


class _SilentError(Exception):
    """Nothing came."""


class Exchange:
    """Exchanges frames one for one; ``owed`` counts answers that did not come in their time."""

    def __init__(self, link: Link, clock: Callable[[], float]) -> None:
        self._link, self._clock = link, clock
        self._scanner = Scanner()
        self.owed = 0
        self._watched = 0
        #: Frames that were asked for again because their answer was damaged or lost.
        self.repeated = 0

    def run(self, frame: bytes, again: bytes, patience: float = PATIENCE, *, insist: bool = False) -> Reply:
        """Send a frame and return its answer; if that is damaged, ask with the frame ``again``, which is without force.

        ``insist``: also if nothing comes.  An answer that was only late may come beside that of the frame that was sent
        again: the last one counts.

        Raises
        ------
        Timeout
            If no answer comes within ``patience`` seconds.
        ProtocolError
            If it is damaged several times over.
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
        """Send a frame without waiting; its answer is owed."""
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
        """Wait for answers that are owed, and drop them: the next one must belong to the next frame."""
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
        """Return the last answer that waits: the one before it may be one that came far too late."""
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
