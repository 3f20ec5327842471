"""The types of arguments that name a file or a folder to be written: checked before anything runs."""

from __future__ import annotations

import argparse
import os
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path

from itouch.schema import ItouchError


def output_folder(text: str) -> str:
    """Check, before anything runs, that a folder can be made or written into where it is asked for."""
    _named(text)
    return _folder(text)


def _folder(text: str) -> str:
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


def write_output(path: str, content: str | bytes) -> None:
    """Write a file that was asked for, whole: an earlier one stays as it was if the disk refuses, as when it is full.

    What cannot be replaced (a device, a pipe, a link, a file in a folder that cannot be written) is written into.

    Raises
    ------
    ItouchError
        If it can't be written.
    """
    from itouch.schema.durable import write_whole  # imported only here, so that help is instant

    data = content if isinstance(content, bytes) else content.encode()
    try:
        if may_be_replaced(path):
            write_whole(path, data)
            return
        with open(path, "wb") as stream:
            stream.write(data)
    except OSError as error:
        raise ItouchError(f"cannot write '{path}': {error.strerror or error}") from error


def may_be_replaced(path: str) -> bool:
    """Tell whether a file can be written under another name and moved here: it is no device, pipe or link."""
    regular = not os.path.lexists(path) or stat.S_ISREG(os.lstat(path).st_mode)
    folder = os.path.dirname(path) or "."
    return regular and (os.access(folder, os.W_OK) or not os.path.lexists(folder))  # one that was removed is made again


@dataclass(frozen=True, slots=True)
class Output:
    """The type of an argument that names a file to be written; ``overwriting`` tells what it may replace.

    Parameters
    ----------
    noun
        What is written, for messages.
    endings
        What its name must end in; nothing: in anything.
    kind
        ``document``, ``session`` or ``recording``, if it is one of these; ``ending``: the name's ending says it.
    beside
        Endings of further files that are written beside it under the same name.
    in_place
        Whether it may replace the session that the command goes on with.
    folder
        Whether any name without one of the endings is that of a folder for several files.
    """

    noun: str = ""
    endings: tuple[str, ...] = ()
    kind: str = ""
    beside: tuple[str, ...] = ()
    in_place: bool = False
    folder: bool = False

    def __call__(self, text: str) -> str:
        """Check, before anything runs, that a file can be written where it is asked for."""
        named = not self.endings or text.lower().endswith(self.endings)
        if self.folder and not named:
            return _folder(text)  # empty: the option stands without a name, which has a default
        _named(text)
        _writable(text)
        if not named and (os.path.isfile(text) or not os.path.exists(text)):  # a terminal or a pipe has any name
            raise argparse.ArgumentTypeError(f"'{text}': a {self.noun}'s name ends in {' or '.join(self.endings)}")
        return text

    def writes(self, path: str) -> list[str]:
        """Return the files that are written, given the path of the argument."""
        if self.folder and not path.lower().endswith(self.endings):
            return []
        return [path, *(str(Path(path).with_suffix(ending)) for ending in self.beside)]

    def kind_at(self, path: str) -> str:
        """Return what is written there: ``document``, ``session``, ``recording`` or nothing of these."""
        return _KINDS.get(Path(path).suffix.lower(), "") if self.kind == "ending" else self.kind


_KINDS = {".xml": "document", ".itouch": "session", ".mcap": "recording"}
#: Files of any name and kind, pictures, and what a session is kept in.
output_file = Output()
picture_file = Output("picture", (".png",))
session_file = Output("session", kind="session")
recording_file = Output("recording", (".mcap",), kind="recording")


def _named(text: str) -> None:
    """Refuse an empty name: a script's variable that is not set would be taken as that nothing is to be written."""
    if not text:
        raise argparse.ArgumentTypeError("the name is empty; name what is to be written")


def _writable(text: str) -> None:
    """Refuse a path where no file can be written."""
    folder = os.path.dirname(text) or "."
    if os.path.isdir(text):
        raise argparse.ArgumentTypeError(f"'{text}' is a folder; name a file")
    if not os.path.isdir(folder):
        raise argparse.ArgumentTypeError(f"there is no folder '{folder}'; make it first")
    if os.path.exists(text) and stat.S_ISFIFO(os.lstat(text).st_mode):  # a link to a pipe is a shell's: it has a reader
        raise argparse.ArgumentTypeError(f"'{text}' is a pipe, which may have no reader; name a file, or /dev/stdout")
    try:
        if not os.path.exists(text):
            with tempfile.TemporaryFile(dir=folder):  # some folders say that they can be written, and can't
                return
        if not os.access(text, os.W_OK):
            os.close(os.open(text, os.O_WRONLY))  # says why not
    except OSError as error:
        raise argparse.ArgumentTypeError(f"'{text}' cannot be written: {error.strerror or error}") from None
