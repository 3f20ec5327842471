"""Serve a simulated Falcon that any machine can use over USB/IP."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

from itouch_usb_arm.virtual.hand import Hand
from itouch_usb_arm.virtual.virtual_falcon import VirtualFalcon
from itouch_usb_arm.wire import Buttons


def main(argv: Sequence[str]) -> int:
    """Serve a virtual arm until Ctrl-C; returns 0, or 2 if the address cannot be used."""
    options = _parser().parse_args(argv)
    from itouch_usb_arm.virtual.usbip import BUS_ID, UsbipServer

    arm = VirtualFalcon(running=options.running, homed=options.homed, hand=Hand())
    arm.buttons = Buttons[options.hold.upper()]
    try:
        server = UsbipServer(arm, options.usbip)
    except OSError as error:
        host, port = options.usbip
        print(f"error: cannot listen on {host}:{port}: {error.strerror or error}", file=sys.stderr)
        return 2
    ended: list[int] = []
    before = {number: signal.signal(number, lambda n, _: ended.append(n)) for number in _SIGNALS}
    host, port = server.address
    print(f"a virtual Falcon is at {host}:{port}, bus id {BUS_ID.decode()}; Ctrl-C ends it", flush=True)
    try:
        server.serve(lambda: bool(ended))
    finally:
        server.close()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0


_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="itouch-py virtual-arm", description=__doc__)
    parser.add_argument("--usbip", type=_address, default=("127.0.0.1", 3240), metavar="HOST:PORT",
                        help="where to serve USB/IP (default 127.0.0.1:3240; port 0 takes a free one)")  # fmt: skip
    parser.add_argument("--running", action="store_true", help="the firmware already runs (default: just powered on)")
    parser.add_argument("--homed", action="store_true", help="all axes are homed already; with --running")
    parser.add_argument("--hold", choices=[b.lower() for b in Buttons.__members__], default="none",
                        help="a button that the simulated operator holds")  # fmt: skip
    return parser


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not an address; write for example 127.0.0.1:3240")
    return host, int(port)
