"""Hardened reading of an XML file into nodes that know where every element and attribute was written.

libxml2 knows the line where a start tag *ends*, and no places of attributes; expat knows the byte where a tag starts.
So both read the file: first expat, which also refuses what a scene may not contain, then lxml, which builds the tree.
"""

from __future__ import annotations

import bisect
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from lxml import etree

from itouch.platforms import reading_advice
from itouch.schema.diagnostics import Place, Problem
from itouch.schema.fields import PLUGIN_NAMESPACE
from itouch.schema.regular_files import kind_of, open_regular

#: Caps on a scene file: its size [bytes], the nesting of its elements, the attributes of one element, all elements.
MAX_BYTES = 8 << 20
MAX_DEPTH = 64
MAX_ATTRIBUTES = 128
MAX_ELEMENTS = 100_000

#: What to do about a file that is not there.
CHECK = "check the path"
_ATTRIBUTE = re.compile(rb"""([^\s=<>/]+)\s*=\s*("[^"]*"|'[^']*')""")
_TAG = re.compile(rb"<[^\s/>]+")


@dataclass(frozen=True, slots=True)
class Attribute:
    """An attribute as written: its value and its place."""

    value: str
    place: Place


@dataclass(slots=True)
class Node:
    """An element: namespace, local name, name as written, place, attributes by name, children, and stray text."""

    namespace: str
    tag: str
    written: str
    place: Place
    attributes: dict[str, Attribute] = field(default_factory=dict)
    children: list[Node] = field(default_factory=list)
    text: str = ""


class SourceError(Exception):
    """A file cannot be read as XML at all; ``problem`` says why."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.sentence)
        self.problem = problem


class _Text:
    """The bytes of a file, with the places of byte offsets in it."""

    def __init__(self, file: str, data: bytes) -> None:
        self.file, self.data = file, data
        self._starts = [0] + [match.end() for match in re.finditer(rb"\n", data)]
        self._line, self._text = -1, ""
        #: The last place asked for in that line: its byte offset in the file, and the characters before it in the line.
        self._before = 0, 0

    def place(self, offset: int, length: int = 1) -> Place:
        line = bisect.bisect_right(self._starts, offset)
        start = self._starts[line - 1]
        end = self._starts[line] - 1 if line < len(self._starts) else len(self.data)
        if line != self._line:  # else: a file may be a single line, asked for again and again
            self._line, self._text = line, self.data[start:end].decode("utf-8", "replace").rstrip("\r")
            self._before = start, 0
        last, letters = self._before if self._before[0] <= offset else (start, 0)
        letters += len(self.data[last:offset].decode("utf-8", "replace"))
        self._before = offset, letters
        span = len(self.data[offset : min(offset + length, end)].decode("utf-8", "replace").rstrip("\r"))
        return Place(self.file, line, letters + 1, max(1, span), self._text)

    def element(self, offset: int) -> Place:
        match = _TAG.match(self.data, offset)
        return self.place(offset, len(match.group()) if match else 1)

    def attributes(self, offset: int) -> Iterator[tuple[str, Place]]:
        match = _TAG.match(self.data, offset)
        at = match.end() if match else offset
        while found := _ATTRIBUTE.match(self.data, self._skip_space(at)):
            yield found.group(1).decode("utf-8", "replace"), self.place(found.start(), found.end() - found.start())
            at = found.end()

    def _skip_space(self, at: int) -> int:
        while at < len(self.data) and self.data[at] in b" \t\r\n":
            at += 1
        return at


def read_bytes(path: Path, shown: str) -> bytes:
    """Read a file of at most MAX_BYTES.

    Raises
    ------
    SourceError
        If it is missing, unreadable, not a file, a saved session or a recording, or too large.
    """
    try:
        if path.is_dir():
            inner = sorted(path.glob("*.xml"))
            advice = f"name a file in it, such as {os.path.join(shown, inner[0].name)}" if inner else "name a file"
            sentence = f"'{shown}' is a folder, not a scene file"
            raise SourceError(Problem("no-such-file", sentence, Place(shown, 1, 1), advice))
        with open_regular(path) as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        advice = reading_advice(error, CHECK)
        problem = Problem("no-such-file", f"cannot read '{shown}': {reason}", Place(shown, 1, 1), advice)
        raise SourceError(problem) from None
    if kind_of(data):
        raise SourceError(_stored(kind_of(data), shown))
    if len(data) > MAX_BYTES:
        sentence = f"'{shown}' is larger than {MAX_BYTES >> 20} MiB"
        raise SourceError(Problem("too-large", sentence, Place(shown, 1, 1), "keep numbers in meshes and recordings"))
    return data


def _stored(kind: str, shown: str) -> Problem:
    """Return the problem of a file that was not written as a document, but stored by the program itself."""
    if kind == "session":
        what = "a saved session"
        advice = (
            f"`itouch-py {shown}` or itouch.restore goes on with it, `itouch-py inspect {shown}` says what it holds; "
            f"`itouch-py export {shown} --xml FILE.xml` writes it as XML, which can be used as a scene"
        )
    else:
        what = "a recording"
        advice = f"`itouch-py replay {shown}` plays it, `itouch-py inspect {shown}` says what it holds"
    return Problem("not-a-scene", f"'{shown}' is {what}, not an XML document", Place(shown, 1, 1), advice)


def parse(data: bytes, shown: str) -> Node:
    """Parse a document into nodes with places.

    Raises
    ------
    SourceError
        If it is not UTF-8, not well-formed, has a DOCTYPE, or exceeds a cap on depth, attributes or elements.
    """
    text = _Text(shown, data)
    _check_encoding(text)
    offsets = _Positions(text).run()
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=False,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise SourceError(_syntax_problem(text, error)) from None
    return _build(root, iter(offsets), text)


def _check_encoding(text: _Text) -> None:
    try:
        text.data.decode("utf-8")
    except UnicodeDecodeError as error:
        problem = Problem(
            "not-utf-8", "the file is not UTF-8 text", text.place(error.start), "save it with encoding UTF-8"
        )
        raise SourceError(problem) from None
    if b"\0" in text.data:
        at = text.data.index(b"\0")
        raise SourceError(Problem("not-well-formed", "the file holds a NUL byte", text.place(at)))


class _Positions:
    """The pass by expat: finds the byte offset of every start tag, in document order; refuses what is not allowed."""

    def __init__(self, text: _Text) -> None:
        self._text = text
        self._offsets: list[int] = []
        self._depth = 0
        self._prefixes: list[frozenset[str]] = [frozenset({"xml"})]
        self._parser = expat.ParserCreate("utf-8")
        self._parser.ordered_attributes = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._doctype

    def run(self) -> list[int]:
        try:
            self._parser.Parse(self._text.data, True)
        except expat.ExpatError as error:
            at = min(max(0, self._parser.ErrorByteIndex), len(self._text.data))
            sentence = f"the XML is not well-formed: {expat.errors.messages[error.code]}"
            if self._depth == 0 and not self._text.data.strip():
                sentence = "the file is empty"
            problem = Problem(
                "not-well-formed", sentence, self._text.place(at), "close every tag and quote every value"
            )
            raise SourceError(problem) from None
        return self._offsets

    def _refuse(self, code: str, sentence: str, advice: str) -> None:
        raise SourceError(Problem(code, sentence, self._text.element(self._parser.CurrentByteIndex), advice))

    def _start(self, name: str, attributes: list[str]) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._refuse("too-deep", f"elements are nested more than {MAX_DEPTH} deep", "a scene is at most 6 deep")
        if len(attributes) > 2 * MAX_ATTRIBUTES:
            self._refuse(
                "too-many-attributes", f"<{name[:40]}> has more than {MAX_ATTRIBUTES} attributes", "remove some"
            )
        if len(self._offsets) >= MAX_ELEMENTS:
            self._refuse("too-many-elements", f"the file has more than {MAX_ELEMENTS} elements", "split the scene")
        self._offsets.append(self._parser.CurrentByteIndex)
        self._declare(name, attributes)

    def _declare(self, name: str, attributes: list[str]) -> None:
        """Keep track of the declared namespace prefixes, and refuse one that is not declared."""
        new = {key.removeprefix("xmlns:") for key in attributes[::2] if key.startswith("xmlns:")}
        known = self._prefixes[-1] | new if new else self._prefixes[-1]
        self._prefixes.append(known)
        prefix, colon, _ = name.partition(":")
        if colon and prefix not in known:
            advice = f'write xmlns:{prefix}="{PLUGIN_NAMESPACE}{prefix}" into <itouch>'
            self._refuse("unknown-prefix", f"<{name[:60]}>: the prefix '{prefix[:40]}' is not declared", advice)

    def _end(self, name: str) -> None:
        self._depth -= 1
        self._prefixes.pop()

    def _doctype(self, *args: object) -> None:
        at = max(0, self._text.data.find(b"<!DOCTYPE"))
        problem = Problem(
            "doctype", "a scene may not have a DOCTYPE", self._text.place(at, 9),
            "remove it; entities are not supported, use <include> and <defaults>",
        )  # fmt: skip
        raise SourceError(problem)


def _syntax_problem(text: _Text, error: etree.XMLSyntaxError) -> Problem:
    line, column = error.position if error.position else (1, 1)
    lines = text.data.decode("utf-8", "replace").split("\n")
    shown = lines[line - 1].rstrip("\r") if 0 < line <= len(lines) else ""
    sentence = f"the XML is not well-formed: {str(error.msg).split(', line')[0]}"
    return Problem("not-well-formed", sentence, Place(text.file, line, max(1, column), 1, shown))


def _build(element: etree._Element, offsets: Iterator[int], text: _Text) -> Node:
    """Pair the elements of the tree with their offsets; the depth cap bounds the recursion."""
    offset = next(offsets)
    name = etree.QName(element)
    prefix = f"{element.prefix}:" if element.prefix else ""
    node = Node(name.namespace or "", name.localname, prefix + name.localname, text.element(offset))
    places = dict(text.attributes(offset))
    for key, value in element.attrib.items():
        written = _written(key, element)
        node.attributes[written] = Attribute(value, places.get(written, node.place))
    node.text = "".join([element.text or "", *(child.tail or "" for child in element)]).strip()
    node.children = [_build(child, offsets, text) for child in element]
    return node


def _written(key: str, element: etree._Element) -> str:
    name = etree.QName(key)
    if not name.namespace:
        return key
    if name.namespace == "http://www.w3.org/XML/1998/namespace":
        return f"xml:{name.localname}"
    prefixes = [prefix for prefix, uri in element.nsmap.items() if uri == name.namespace and prefix]
    return f"{prefixes[0]}:{name.localname}" if prefixes else name.localname


#: Outermost elements of files that can be run -> the command that does.
_RUN_BY = {"itouch": "itouch-py", "study": "itouch-py study run", "sweep": "itouch-py sweep run"}


def how_run(tag: str, shown: str) -> str:
    """Return a clause, with its semicolon, on how a file with this outermost element is run; empty if it is not run."""
    return f"; `{_RUN_BY[tag]} {shown}` runs this one" if tag in _RUN_BY else ""


def read_root(shown: str, tag: str, begins: str) -> Node:
    """Read a file whose outermost element is ``tag``, not a scene's; ``begins`` shows how such a file begins.

    Raises
    ------
    SourceError
        If it cannot be read, is no XML, or has another outermost element.
    """
    root = parse(read_bytes(Path(shown), shown), shown)
    if root.tag != tag or root.namespace:
        sentence = f"the outermost element is <{root.written}>, not <{tag}>"
        run = how_run("" if root.namespace else root.tag, shown)
        advice = f"a {tag} begins with {begins}{run}"
        raise SourceError(Problem("wrong-root", sentence, root.place, advice))
    return root
