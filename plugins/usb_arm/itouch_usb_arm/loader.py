"""From power-on to running firmware: reset into the boot loader, autobaud, upload with an echo of each byte."""

from __future__ import annotations

import time
from collections.abc import Callable

from itouch_usb_arm import link as ftdi
from itouch_usb_arm.boot import Image
from itouch_usb_arm.errors import FirmwareError
from itouch_usb_arm.link import PAYLOAD, Link

KNOCK, WELCOME, AUTOBAUD = b"\x0a\x43\x0d", b"\x0a\x44\x2c\x0d", b"A"
_KNOCKS = 100
#: How long [s] to wait for an answer to a knock, for the autobaud letter, and for the echo of a piece of the upload.
_KNOCK_WAIT, _LETTER_WAIT, _ECHO_WAIT = 0.04, 0.3, 0.5
#: After this long [s] without a byte, the line counts as quiet.
_QUIET = 0.02

Clock = Callable[[], float]


def normal_mode(link: Link) -> None:
    """Set the serial chip as running firmware expects it: 1 ms latency, 1.5 Mbaud, empty buffers."""
    link.control(ftdi.LATENCY, 1)
    link.control(ftdi.BAUD, ftdi.BAUD_RUN)
    purge(link)


def purge(link: Link) -> None:
    """Empty both buffers of the serial chip."""
    link.control(ftdi.RESET, ftdi.PURGE_RECEIVED)
    link.control(ftdi.RESET, ftdi.PURGE_SENT)


def upload(link: Link, image: Image, *, clock: Clock = time.monotonic) -> None:
    """Reset the arm and load its firmware.

    Raises
    ------
    FirmwareError
        If the boot loader does not answer, or an echo is wrong or missing.
    """
    _reset(link, clock)
    link.control(ftdi.MODEM, ftdi.DTR_LOW)
    link.control(ftdi.BAUD, ftdi.BAUD_142857)
    link.send(AUTOBAUD)
    if AUTOBAUD not in _until(link, clock, _LETTER_WAIT, lambda data: AUTOBAUD in data):
        raise FirmwareError("the arm's boot loader did not return the autobaud letter; switch the arm off and on")
    for at in range(0, len(image.data), PAYLOAD):
        _piece(link, image.data[at : at + PAYLOAD], at, clock)


def _reset(link: Link, clock: Clock) -> None:
    for request, value in (
        (ftdi.LATENCY, 16),
        (ftdi.BAUD, ftdi.BAUD_9600),
        (ftdi.DATA, 8),
        (ftdi.FLOW, 0),
        (ftdi.MODEM, ftdi.RTS_LOW),
        (ftdi.MODEM, ftdi.DTR_LOW),
        (ftdi.MODEM, ftdi.DTR_HIGH),
    ):
        link.control(request, value)
    heard = b""
    for _ in range(_KNOCKS):
        link.send(KNOCK)
        heard = _until(link, clock, _KNOCK_WAIT, lambda data: WELCOME in data, heard)
        if WELCOME in heard:
            _drain(link, clock)
            return
    raise FirmwareError(f"the arm's boot loader did not answer {_KNOCKS} times; is the arm powered?")


def _drain(link: Link, clock: Clock) -> None:
    """Drop answers to earlier knocks."""
    purge(link)
    quiet = clock() + _QUIET
    end = clock() + 10 * _QUIET
    while clock() < min(quiet, end):
        if link.receive(_QUIET / 4):
            quiet = clock() + _QUIET


def _piece(link: Link, piece: bytes, at: int, clock: Clock) -> None:
    link.send(piece)
    echo = _until(link, clock, _ECHO_WAIT, lambda data: len(data) >= len(piece) or not piece.startswith(data))
    if echo == piece:
        return
    wrong = next((i for i, (a, b) in enumerate(zip(piece, echo, strict=False)) if a != b), min(len(piece), len(echo)))
    got = f"0x{echo[wrong]:02x}" if wrong < len(echo) else "nothing"
    wanted = f"0x{piece[wrong]:02x}" if wrong < len(piece) else "nothing"
    raise FirmwareError(
        f"upload failed: byte {at + wrong} of the firmware came back as {got}, not {wanted}; "
        "try again, with a shorter cable or a powered hub if it happens often"
    )


def _until(link: Link, clock: Clock, wait: float, enough: Callable[[bytes], bool], data: bytes = b"") -> bytes:
    """Return ``data`` and the bytes that follow, until ``enough`` is satisfied or the time is over."""
    end = clock() + wait
    while not enough(data):
        left = end - clock()
        if left <= 0.0:
            break
        data += link.receive(left)
    return data
