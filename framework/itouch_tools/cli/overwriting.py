"""What a command may overwrite: the one rule, which every parser of the command line applies before anything is done.

No output is a file that the command reads or that such a file names, nor another output, such as the recording that a
scene asks for; none replaces a scene, a study, a sweep, a saved session or a recording, except by one of its own kind.
A session may be saved to the snapshot from which it goes on: that is written beside it and moved there whole.
"""

from __future__ import annotations

import argparse
import contextlib
import html
import json
import os
import re
import stat
import sys
import unicodedata
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from itouch.schema import ItouchError
from itouch.schema.regular_files import is_document, open_regular, stored_kind
from itouch_tools.cli.output_files import Output, recording_file

#: How much of a document is searched for files that it names [bytes]: a scene is not larger, a larger one is a session,
#: which names none.  The JSON of a glTF may be as large as the meshes in it.
_MOST, _MOST_OF_A_GLTF = 8 << 20, 1 << 30
#: How many documents are searched: as many as a scene may have.
_DOCUMENTS = 256
_VALUE = re.compile(rb"""=\s*(?:"([^"<]{1,255})"|'([^'<]{1,255})')""")
_ROOT = re.compile(rb"<(itouch|study|sweep)[\s>/]")
#: A file that a glTF names: a buffer or an image; and how a scene asks for a recording.
_URI = re.compile(rb'"uri"\s*:\s*("(?!data:)(?:[^"\\]|\\.){1,1024}")')
_RECORD = re.compile(rb"""<record\s(?:[^<>]*?\s)?to\s*=\s*(?:"([^"<]{1,255})"|'([^'<]{1,255})')""")
_LOST = {"document": "a scene, a study or a sweep", "session": "a saved session", "recording": "a recording"}


@dataclass(frozen=True, slots=True)
class Written:
    """A file that a command is to write: the option that names it, its path, and what is written there."""

    option: str
    path: str
    output: Output


def refuse(actions: Iterable[argparse.Action], options: argparse.Namespace) -> None:
    """Refuse outputs that would destroy an input, one another, or a file of another kind.

    Parameters
    ----------
    actions
        What a parser takes: arguments whose type is an ``Output`` are outputs, all others may name inputs.
    options
        What it has read.

    Raises
    ------
    ItouchError
        For the first of them.
    """
    written: list[Written] = []
    read: list[str] = []
    for action in actions:
        for value in _texts(getattr(options, action.dest, None)):
            if isinstance(action.type, Output):
                option = max(action.option_strings, key=len, default=str(action.metavar or action.dest))
                written += [Written(option, path, action.type) for path in action.type.writes(value)]
            elif os.path.isfile(value):
                read.append(value)
    if written and getattr(options, "records_as_asked", False):
        written += _asked_for(options.scene, options)
    for at, one in enumerate(written):
        for other in written[:at]:
            if _same(one.path, other.path):
                both = f"{other.option} and {one.option}" if one.option != other.option else f"{one.option} twice"
                raise ItouchError(f"'{one.path}' would be written by {both}; name two files")
    there = [one for one in written if _ordinary(one.path) and os.path.exists(one.path)]
    for one in there:  # only what is there already can be lost
        _refuse_inputs(one, read)
        kind = _kind(one.path)
        if kind and kind != one.output.kind_at(one.path):
            raise ItouchError(f"{one.option}: '{one.path}' is {_LOST[kind]}, which would be lost; name another file")


def _refuse_inputs(one: Written, read: Iterable[str]) -> None:
    for path in read:
        if _same(one.path, path) and not (one.output.in_place and stored_kind(path) == "session"):
            raise ItouchError(f"{one.option}: '{one.path}' is the file that is read; name another one")
        for named in _named_by(path):
            if _same(one.path, named):
                raise ItouchError(f"{one.option}: '{one.path}' belongs to '{path}', which is read; name another file")


def _asked_for(scene: str, options: argparse.Namespace) -> Iterator[Written]:
    """Yield the recording that a scene, or that of a session, asks for by ``<record>`` if no option says otherwise."""
    if getattr(options, "record", None) or getattr(options, "no_record", False):
        return
    from itouch.session.channel_selection import file_name

    data = [_start_of(path) for path in (scene, *(_named_by(scene) if os.path.isfile(scene) else ()))]
    for found in (one for text in data for one in _RECORD.finditer(text)):
        pattern = html.unescape((found[1] or found[2]).decode(errors="replace"))
        yield Written("the scene's <record>", file_name(pattern, scene, options.seed or 0), recording_file)


def _start_of(path: str) -> bytes:
    """Return the text of a document, or what holds the scene of a session or a recording."""
    with contextlib.suppress(OSError, KeyError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
        kind = stored_kind(path)
        if kind == "session":
            with zipfile.ZipFile(path) as archive, archive.open("scene.xml") as member:
                return member.read(_MOST)
        if kind == "recording":  # the scene is attached at its beginning, as it is
            with open_regular(path) as stream:
                return stream.read(_MOST)
    return _document(path, _MOST)


def _texts(value: object) -> list[str]:
    """Return the words of an argument's value, which may have been given several times."""
    if isinstance(value, list):
        return [text for each in value for text in _texts(each)]
    return [os.fspath(value)] if isinstance(value, str | os.PathLike) and value else []


def _ordinary(path: str) -> bool:
    """Tell whether a path is that of an ordinary file, or of none: what is written to a terminal replaces nothing."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except OSError:
        return True


def _same(path: str, other: str) -> bool:
    """Tell whether two paths are those of the same file, which need not be there yet."""
    if not (_ordinary(path) and _ordinary(other)):
        return False
    try:
        return os.path.samefile(path, other)
    except OSError:
        return _normal(path) == _normal(other)


def _normal(path: str) -> str:
    """Return an absolute path without links, with letters as the system compares them."""
    normal = os.path.normcase(os.path.realpath(path))
    return unicodedata.normalize("NFC", normal).casefold() if sys.platform == "darwin" else normal


def _kind(path: str) -> str:
    kind = stored_kind(path)
    return kind if kind else "document" if _ROOT.search(_document(path, 4096)) else ""


def _document(path: str, most: int) -> bytes:
    """Return the text of a document, at most so much; nothing of a file that is none."""
    try:
        with open_regular(path) as stream:
            data = stream.read(most)
    except OSError:
        return b""
    return data if is_document(data) else b""


def _named_by(path: str) -> Iterator[str]:
    """Yield the files that a scene, a study or a sweep names, directly or through others, and its calibration.

    Any value of an attribute that is the path of a file counts: plugins have elements of their own; and of a glTF its
    buffers and images.
    """
    rest, seen = [path], {os.path.realpath(path)}
    while rest and len(seen) < _DOCUMENTS:
        inner = rest.pop()
        folder = os.path.dirname(inner)
        for named in (os.path.join(folder, name) for name in _names_in(inner)):
            if "\0" not in named and os.path.isfile(named) and os.path.realpath(named) not in seen:
                seen.add(os.path.realpath(named))
                rest.append(named)
                yield named


def _names_in(path: str) -> set[str]:
    """Return what may be names of files, relative to its folder, in a document or a glTF."""
    if path.lower().endswith((".gltf", ".glb")):
        with contextlib.suppress(OSError, ValueError), open_regular(path) as stream:
            return {unquote(json.loads(uri)) for uri in _URI.findall(stream.read(_MOST_OF_A_GLTF))}
    text = _document(path, _MOST)
    found = {html.unescape((one or other).decode(errors="replace")) for one, other in _VALUE.findall(text)}
    return {Path(path).with_suffix(".calibration.json").name, *found} if text else set()
