"""A whole session as one XML document: the scene as usual, and in a ``<session>`` its State in readable numbers."""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.bases import Arrays
from itouch.plugin.discovery import Catalog
from itouch.scene import write
from itouch.scene.source import how_run
from itouch.session.arrays import load_bases, pack_bases
from itouch.session.manifest import digest
from itouch.session.session_error import ADVICE, SessionError, check_ledger, plainly
from itouch.session.snapshot import Snapshot, check_format, checked_files, read_scene

#: Greatest size of a document that is read, and of the State that it may describe [bytes].
MAX_DOCUMENT, MAX_STATE = 256 << 20, 64 << 20
_END = "</itouch>"
_WIDTH = 76

_QUIET = struct.pack("<d", math.nan)


def to_xml(snapshot: Snapshot) -> str:
    """Return the session as one XML document; ``from_xml`` reads the same session from it, byte for byte."""
    scene = write(snapshot.scene)
    body = scene[: scene.rindex(_END)]
    # the digest is that of the scene as it stands here: another version may have written the stored one otherwise
    manifest = {**snapshot.manifest, "scene": digest(scene.encode())}
    return "\n".join([body.rstrip("\n"), *_session(replace(snapshot, manifest=manifest)), _END, ""])


def _session(snapshot: Snapshot) -> Iterable[str]:
    yield f"  <session format={quoteattr(str(snapshot.manifest['format']))}>"
    yield f"    <manifest>{escape(json.dumps(snapshot.manifest))}</manifest>"
    yield f"    <ledger>{escape(json.dumps(snapshot.ledger))}</ledger>"
    yield f'    <state bytes="{snapshot.state.dtype.itemsize}">'
    record = snapshot.state[0]
    for name in snapshot.state.dtype.names or ():
        yield from _field(name, snapshot.state.dtype[name], np.asarray(record[name]))
    yield "    </state>"
    for key, arrays in snapshot.bases.items():
        packed, _ = pack_bases({key: arrays})
        shapes = ";".join(",".join(str(size) for size in array.shape) for array in arrays)
        yield f"    <basis key={quoteattr(key)} shapes={quoteattr(shapes)}>{base64.b64encode(packed).decode()}</basis>"
    for data in dict.fromkeys(snapshot.files.values()):
        yield f'    <file digest="{digest(data)}">{base64.b64encode(data).decode()}</file>'
    yield "  </session>"


def _field(name: str, kind: np.dtype[Any], value: NDArray[Any]) -> Iterable[str]:
    """Yield the lines of one field: its numbers, or the rows of a table that are not all zero."""
    shape = f' shape="{",".join(str(n) for n in kind.shape)}"' if kind.shape else ""
    head = f"      <field name={quoteattr(name)}"
    if kind.base.names is None:
        yield f"{head} type={quoteattr(kind.base.str[1:])}{shape}>{to_text(value)}</field>"
        return
    yield f"{head}{shape}>"
    for column in kind.base.names:
        part = kind.base[column]
        size = f' shape="{",".join(str(n) for n in part.shape)}"' if part.shape else ""
        yield f"        <column name={quoteattr(column)} type={quoteattr(part.base.str[1:])}{size}/>"
    for index, row in enumerate(value.reshape(-1)):
        if any(row.tobytes()):
            cells = "".join(f"<c>{to_text(np.asarray(row[column]))}</c>" for column in kind.base.names)
            yield f'        <row index="{index}">{cells}</row>'
    yield "      </field>"


@dataclass(frozen=True, slots=True)
class _Node:
    tag: str
    attributes: dict[str, str]
    children: list[_Node] = field(default_factory=list)
    text: list[str] = field(default_factory=list)

    def all(self, tag: str) -> list[_Node]:
        return [child for child in self.children if child.tag == tag]

    def only(self, tag: str) -> _Node:
        found = self.all(tag)
        if len(found) != 1:
            raise ValueError(f"<{self.tag}> has {len(found)} elements <{tag}>, it needs one")
        return found[0]

    @property
    def content(self) -> str:
        return "".join(self.text)


class _Splitter:
    """Finds ``<session>`` in a document: its tree, and where its bytes begin and end."""

    def __init__(self) -> None:
        self.depth, self.root, self.tree, self.begin, self.end = 0, "", None, -1, -1
        self._open: list[_Node] = []
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._stop
        self.parser.CharacterDataHandler = self._say
        self.parser.StartDoctypeDeclHandler = self._refuse
        self.parser.buffer_text = True

    tree: _Node | None

    def _refuse(self, *_: object) -> None:
        raise ValueError("a document type is not allowed")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self.depth += 1
        if self.depth > 64:
            raise ValueError("elements are nested too deep")
        if self.depth == 1:
            self.root = tag
        if self._open:
            node = _Node(tag, attributes)
            self._open[-1].children.append(node)
            self._open.append(node)
        elif self.depth == 2 and tag == "session":
            if self.tree is not None:
                raise ValueError("<session> may appear only once")
            self.tree = _Node(tag, attributes)
            self.begin = self.parser.CurrentByteIndex
            self._open.append(self.tree)

    def _stop(self, tag: str) -> None:
        self.depth -= 1
        if self._open:
            self._open.pop()
            if not self._open:
                self.end = self.parser.CurrentByteIndex + len(b"</session>")

    def _say(self, text: str) -> None:
        if self._open:
            self._open[-1].text.append(text)


def from_xml(name: str, data: bytes, catalog: Catalog) -> Snapshot:
    """Read a session from its XML document.

    Raises
    ------
    SessionError
        If it is not whole, altered, of a newer format, or does not load here.
    """
    try:
        splitter = _Splitter()
        splitter.parser.Parse(data, True)
        if splitter.tree is None and splitter.root == "itouch":
            raise SessionError(
                f"'{name}' is a scene, not a stored session: `itouch-py {name}` runs it, and "
                f"itouch.build({name!r}) makes a session of it"
            )
        if splitter.tree is None:
            how = how_run(splitter.root, name) or "; name a file that a session was saved to"
            raise SessionError(f"'{name}' is not a stored session: its outermost element is <{splitter.root}>{how}")
        manifest, ledger, state, bases = _read(name, splitter.tree)
        stored = {node.attributes["digest"]: _decoded(node) for node in splitter.tree.all("file")}
        files = checked_files(name, manifest, stored)
    except SessionError:
        raise
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise SessionError(f"'{name}' is not a whole session: {plainly(error)}; {ADVICE}") from error
    except expat.ExpatError as error:
        raise SessionError(f"'{name}' is not a whole session: {error}") from error
    if digest(state.tobytes()) != manifest.get("state"):
        raise SessionError(f"'{name}' was altered: the digest of its state does not match")
    xml = data[: splitter.begin].rstrip(b" \t") + data[splitter.end :].lstrip(b" \t\r\n")
    scene = read_scene(name, xml, manifest, files, catalog)
    # compared as text, since another version may write the scene otherwise, and as a scene, since blanks may change
    edited = manifest.get("scene") not in (digest(xml), digest(write(scene).encode()))
    return Snapshot(scene, state, manifest, ledger, bases, files, edited)


def _decoded(node: _Node) -> bytes:
    return base64.b64decode(node.content, validate=True)


def _read(name: str, tree: _Node) -> tuple[dict[str, Any], dict[str, Any], NDArray[Any], dict[str, Arrays]]:
    manifest, ledger = json.loads(tree.only("manifest").content), json.loads(tree.only("ledger").content)
    check_format(name, manifest)
    check_ledger(ledger)
    stated = tree.attributes.get("format", "")
    if stated != manifest["format"]:
        here = f'<session format="{stated[:40]}">'
        raise SessionError(
            f"'{name}': {here} and the format of its manifest, {manifest['format']}, differ: it was altered; export it "
            f"again"
        )
    bases: dict[str, Arrays] = {}
    for node in tree.all("basis"):
        shapes = [[int(n) for n in part.split(",") if n] for part in node.attributes["shapes"].split(";")]
        bases |= load_bases(_decoded(node), {node.attributes["key"]: shapes})
    return manifest, ledger, _state(tree.only("state")), _ordered(bases, manifest)


def _ordered(bases: Mapping[str, Arrays], manifest: Mapping[str, Any]) -> dict[str, Arrays]:
    """Return the bases in the order of the manifest, which must name them all."""
    stated = manifest.get("bases", {}).get("shapes", {})
    if set(stated) != set(bases):
        raise ValueError("its bases are not those that its manifest names")
    found = {key: bases[key] for key in stated}
    if found and digest(pack_bases(found)[0]) != manifest["bases"]["digest"]:
        raise ValueError("the digest of its bases does not match")
    return found


def _state(tree: _Node) -> NDArray[Any]:
    fields = [(node.attributes["name"], *_type(node)) for node in tree.all("field")]
    total = 0
    for _, kind, shape in fields:
        total += np.dtype(kind).itemsize * int(np.prod(shape, dtype=object)) if shape else np.dtype(kind).itemsize
    if total > MAX_STATE:
        raise ValueError(f"a State of {total} bytes is too large")
    record = np.zeros(1, np.dtype([(name, kind, shape) if shape else (name, kind) for name, kind, shape in fields]))
    if tree.attributes.get("bytes", "") != str(record.dtype.itemsize):
        stated = tree.attributes.get("bytes", "")[:40]
        raise ValueError(f'<state bytes="{stated}"> and its fields, which have {record.dtype.itemsize} bytes, differ')
    for node in tree.all("field"):
        _fill(record[node.attributes["name"]][0:1], node)
    return record


def _shape(node: _Node) -> tuple[int, ...]:
    sizes = tuple(int(word) for word in node.attributes.get("shape", "").split(",") if word)
    if any(size < 0 for size in sizes):
        raise ValueError(f"'{node.attributes['name']}' has a negative size")
    return sizes


def _plain(node: _Node) -> np.dtype[Any]:
    kind = np.dtype(node.attributes["type"])
    if kind.hasobject or kind.names is not None or kind.shape or kind.kind not in "iufbS":
        raise ValueError(f"'{node.attributes['name']}' has a type that is not of numbers")
    return kind.newbyteorder("<") if kind.itemsize > 1 and kind.kind != "S" else kind


def _type(node: _Node) -> tuple[Any, tuple[int, ...]]:
    columns = node.all("column")
    if not columns:
        return _plain(node), _shape(node)
    return [(c.attributes["name"], _plain(c), _shape(c)) for c in columns], _shape(node)


def _fill(view: NDArray[Any], node: _Node) -> None:
    """Write the numbers of a field into its view of the record, shape (1, ...)."""
    columns = node.all("column")
    if not columns:
        view[...] = from_text(node.content, view.dtype, view.size).reshape(view.shape)
        return
    rows = view.reshape(-1)
    for row in node.all("row"):
        cells, target = row.all("c"), rows[int(row.attributes["index"])]
        for column, cell in zip(columns, cells, strict=True):
            part = np.asarray(target[column.attributes["name"]])
            target[column.attributes["name"]] = from_text(cell.content, part.dtype, part.size).reshape(part.shape)


def to_text(values: NDArray[Any]) -> str:
    """Return numbers, of any shape (n, ...) and unit, as text, separated by spaces.

    It is the shortest text that reads back to the same bits; values that are not numbers are written in hexadecimal.
    """
    if values.dtype.kind in "iub":
        return " ".join(str(int(value)) for value in values.ravel())
    if values.dtype.kind == "f":
        return " ".join(_float(value) for value in values.astype("f8").ravel().tolist())
    return np.ascontiguousarray(values).tobytes().hex()


def _float(value: float) -> str:
    if value == value:
        return repr(value)
    bits = struct.pack("<d", value)
    return "nan" if bits == _QUIET else "nan:" + bits[::-1].hex()


def from_text(text: str, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    """Return ``count`` numbers of a type from their text.

    Raises
    ------
    ValueError
        If the text holds something else, or another count.
    """
    if dtype.kind not in "iubf":
        data = bytes.fromhex(text)
        if len(data) != count * dtype.itemsize:
            raise ValueError(f"{len(data)} bytes, not {count * dtype.itemsize}")
        return np.frombuffer(data, dtype).copy()
    words = text.split()
    if len(words) != count:
        raise ValueError(f"{len(words)} numbers, not {count}")
    if dtype.kind == "f":
        return _floats(words).astype(dtype)
    return np.array([int(word) for word in words], dtype)


def _floats(words: Sequence[str]) -> NDArray[np.float64]:
    data = b"".join(
        bytes.fromhex(word[4:])[::-1] if word.startswith("nan:") and len(word) == 20 else struct.pack("<d", float(word))
        for word in words
    )
    return np.frombuffer(data, np.float64).copy()
