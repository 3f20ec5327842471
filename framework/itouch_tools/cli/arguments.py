"""Arguments that several commands share: `--json`, numbers, times, sizes of pictures."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from typing import Any

from itouch.schema.quantities import LONGEST, QuantityError, parse_quantity
from itouch_tools.cli.command_options import HELP
from itouch_tools.cli.overwriting import refuse


class Parser(argparse.ArgumentParser):
    """A parser whose help also lists the options that every command has, and that refuses to overwrite an input."""

    def __init__(self, *words: Any, **named: Any) -> None:
        super().__init__(*words, **named)
        self.register("type", int, whole_number)  # argparse itself would say "invalid int value"
        self.register("type", float, number)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # -3s is a value, too, which its reader refuses

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Read a command line, also as part of another one's, and refuse outputs that would destroy a file."""
        found = super().parse_known_args(args, namespace)
        refuse(self._actions, found[0])
        return found

    def format_help(self) -> str:
        """Return the help."""
        return super().format_help() + "\n" + HELP

    def add_subparsers(self, **named: Any) -> Any:
        """Declare commands of this command, which refuse under their own names what they do not know."""
        return super().add_subparsers(**{"parser_class": CommandParser, **named})


class CommandParser(Parser):
    """A parser of a command of another command."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Read a command line whole: argparse would leave what is unknown to the outer command, and print its usage."""
        found = super().parse_known_args(args, namespace)
        if found[1]:
            self.error(f"unrecognized arguments: {' '.join(found[1])}")
        return found


def add_command(commands: Any, name: str, says: str) -> argparse.ArgumentParser:
    """Add a command of its own to a command, with what it does as help of both; return its parser."""
    parser: argparse.ArgumentParser = commands.add_parser(name, help=says, description=f"{says[0].upper()}{says[1:]}.")
    return parser


def parser_of(program: str, description: str | None) -> argparse.ArgumentParser:
    """Return a parser of this kind, for a command whose sub-commands are added by others."""
    return Parser(prog=program, description=description)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Declare ``--json``: the result as one JSON document on standard output, instead of words."""
    parser.add_argument("--json", action="store_true", help="the result as one JSON document")


def as_json(result: Any) -> str:
    """Return a result as the text of one JSON document."""
    return json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False, default=str)


def whole_number(text: str) -> int:
    """Read a whole number."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number; write for example 3") from None


def number(text: str) -> float:
    """Read a number."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number; write for example 2.5") from None


def seconds(text: str) -> float:
    """Read a duration [s], written for example as ``30s``, ``2 min`` or ``0.5``."""
    try:
        (value,) = parse_quantity(text, "s")
    except QuantityError as error:
        raise argparse.ArgumentTypeError(f"{error}; write for example 30s") from None
    if value < 0:
        raise argparse.ArgumentTypeError(f"'{text}' is negative; write for example 30s")
    if value > LONGEST:
        raise argparse.ArgumentTypeError(f"'{text}' is too long: at most {LONGEST:.0e} s, which is 31 years")
    return value


def picture_size(text: str) -> tuple[int, int]:
    """Read the size of a picture such as ``1280x720``."""
    from itouch_tools.viewer.offscreen import size_of

    try:
        return size_of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
