"""The options of ``run`` that keep a session: recording, periodic snapshots, Lab Streaming Layer, triggers."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from itouch.platforms import answering, signals
from itouch.schema import ItouchError
from itouch_tools.cli.arguments import seconds
from itouch_tools.cli.output_files import recording_file

if TYPE_CHECKING:
    from itouch.session import Session
    from itouch.session.outputs import Outputs


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    group = parser.add_argument_group("recording and saving")
    group.add_argument("--record", type=recording_file, metavar="FILE.mcap",
                       help="record the session; default: as the scene's <record> says")  # fmt: skip
    group.add_argument("--no-record", action="store_true", help="do not record, whatever the scene says")
    group.add_argument("--save-every", type=seconds, metavar="10s",
                       help="save to the file of --save again and again while it runs")  # fmt: skip
    group.add_argument("--lsl", action="store_true", help="Lab Streaming Layer: offer readings, give and take marks")
    group.add_argument("--trigger", type=_port, metavar="PORT",
                       help="put codes of marks and contacts on a serial trigger box or /dev/parport0")  # fmt: skip
    group.add_argument("--code", action="append", default=[], type=_code, metavar="NAME=N",
                       help="code 1 to 255 of marks of this name; a payload may bring its own 'code'")  # fmt: skip
    group.add_argument("--contact-code", action="append", default=[], type=_contact, metavar="KIND=N",
                       help="code of contacts: begin=N, end=N, or of one object begin:NAME=N")  # fmt: skip


def _port(text: str) -> str:
    """Refuse an empty name, with which no code would be sent."""
    if not text:
        raise argparse.ArgumentTypeError("the name is empty; name a serial port, or /dev/parport0")
    return text


def _contact(text: str) -> tuple[str, int]:
    """Read ``begin=N``, ``end=N``, or either with ``:OBJECT``."""
    name, number = _code(text)
    kind, colon, touched = name.partition(":")
    if kind not in ("begin", "end") or bool(colon) != bool(touched):
        raise argparse.ArgumentTypeError(f"'{text}' is not a code of contacts; write begin=10, end=11 or begin:wood=12")
    return name, number


def _code(text: str) -> tuple[str, int]:
    """Read ``NAME=N``."""
    name, _, number = text.rpartition("=")
    if not name or not number.isdecimal() or not 1 <= int(number) <= 255:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a code; write for example begin=1, with a number of 1 to 255"
        )
    return name, int(number)


def wanted(options: argparse.Namespace) -> Outputs:
    """Return what of a session is to be kept, according to the options.

    Raises
    ------
    ItouchError
        If options do not go together.
    """
    from itouch.session.outputs import Outputs

    if options.save_every is not None and not options.save:
        raise ItouchError("--save-every needs --save FILE.itouch")
    if options.save_every is not None and options.save_every < 0.1:
        raise ItouchError("--save-every must be at least 0.1 s")
    if options.record and options.no_record:
        raise ItouchError("--record and --no-record exclude one another")
    for named in ("code", "contact_code"):
        if getattr(options, named) and not options.trigger:
            option = named.replace("_", "-")
            raise ItouchError(f"--{option} says what --trigger PORT puts on the wire; name the port, too")
    return Outputs(
        options.record or "", not options.no_record, options.save or "", options.save_every or 0.0, options.lsl,
        options.trigger or "", dict(options.code), dict(options.contact_code),
    )  # fmt: skip


@contextlib.contextmanager
def opened(session: Session, options: argparse.Namespace) -> Iterator[None]:
    """Keep what is asked for while the session runs here; SIGUSR1 sets a mark named ``operator``."""
    from itouch.session.outputs import open_outputs

    marking = {number: lambda *_: session.post_mark("operator") for number in signals("SIGUSR1")}
    with open_outputs(session, wanted(options)), answering(marking):
        yield
