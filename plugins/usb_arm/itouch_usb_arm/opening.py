"""From a claimed arm to its first answer: find out whether the firmware runs, and load it if not."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

from itouch_usb_arm import boot, loader
from itouch_usb_arm.errors import FirmwareError, ProtocolError, Timeout
from itouch_usb_arm.exchange import Exchange
from itouch_usb_arm.link import Link
from itouch_usb_arm.wire import Buttons, Leds, Reply, command, decode

#: How many frames are sent to find out whether the firmware runs, and how long [s] to wait for each answer: for the
#: first half, and for the rest, which give a slow line time.
_PROBES, PROBE_WAIT, _LONG_WAIT = 10, 0.03, 0.1


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
