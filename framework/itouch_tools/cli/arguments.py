"""Arguments that several commands share: `--json`, `-o`, times, sizes of pictures."""

from __future__ import annotations

import argparse
import json
import os
import stat
import tempfile
from typing import Any

from itouch.schema.quantities import QuantityError, parse_quantity
from itouch_tools.cli.command_options import HELP


class Parser(argparse.ArgumentParser):
    """A parser whose help also lists the options that every command has."""

    def format_help(self) -> str:
        """Return the help."""
        return super().format_help() + "\n" + HELP


def parser_of(program: str, description: str | None) -> argparse.ArgumentParser:
    """Return a parser of this kind, for a command whose sub-commands are added by others."""
    return Parser(prog=program, description=description)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Declare ``--json``: the result as one JSON document on standard output, instead of words."""
    parser.add_argument("--json", action="store_true", help="the result as one JSON document")


def as_json(result: Any) -> str:
    """Return a result as the text of one JSON document."""
    return json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False, default=str)


def seconds(text: str) -> float:
    """Read a duration [s], written for example as ``30s``, ``2 min`` or ``0.5``."""
    try:
        (value,) = parse_quantity(text, "s")
    except QuantityError as error:
        raise argparse.ArgumentTypeError(f"{error}; write for example 30s") from None
    if value < 0:
        raise argparse.ArgumentTypeError(f"'{text}' is negative; write for example 30s")
    return value


def picture_size(text: str) -> tuple[int, int]:
    """Read the size of a picture such as ``1280x720``."""
    from itouch_tools.viewer.offscreen import size_of

    try:
        return size_of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def picture_file(text: str) -> str:
    """Check that a picture can be written where it is asked for, and that its name ends in .png."""
    if not text.lower().endswith(".png"):
        raise argparse.ArgumentTypeError(f"'{text}': a picture's name ends in .png")
    return output_file(text)


def output_folder(text: str) -> str:
    """Check, before anything runs, that a folder can be made or written into where it is asked for."""
    if os.path.exists(text) and not os.path.isdir(text):
        raise argparse.ArgumentTypeError(f"'{text}' is a file; name a folder")
    there = text
    while there and not os.path.isdir(there):
        there = os.path.dirname(there.rstrip(os.sep))
    try:
        with tempfile.TemporaryFile(dir=there or "."):
            return text
    except OSError as error:
        raise argparse.ArgumentTypeError(f"'{text}' cannot be written: {error.strerror or error}") from None


def output_file(text: str) -> str:
    """Check, before anything runs, that a file can be written where it is asked for."""
    folder = os.path.dirname(text) or "."
    if os.path.isdir(text):
        raise argparse.ArgumentTypeError(f"'{text}' is a folder; name a file")
    if not os.path.isdir(folder):
        raise argparse.ArgumentTypeError(f"there is no folder '{folder}'; make it first")
    if os.path.exists(text) and stat.S_ISFIFO(os.lstat(text).st_mode):  # a link to a pipe is a shell's: it has a reader
        raise argparse.ArgumentTypeError(f"'{text}' is a pipe, which may have no reader; name a file, or /dev/stdout")
    if not os.access(text if os.path.exists(text) else folder, os.W_OK):
        raise argparse.ArgumentTypeError(f"'{text}' cannot be written")
    if not os.path.exists(text):
        try:
            with tempfile.TemporaryFile(dir=folder):  # some folders say that they can be written, and can't
                return text
        except OSError as error:
            raise argparse.ArgumentTypeError(f"'{text}' cannot be written: {error.strerror or error}") from None
    return text
