"""Reads a scene file and everything that it includes, each as a document of its own."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

from itouch.scene import bundled_scenes
from itouch.scene.elements import VERSION
from itouch.scene.names import defined_names
from itouch.scene.source import CHECK, Attribute, Node, SourceError, how_run, parse, read_bytes
from itouch.schema.diagnostics import Place, Problem, did_you_mean, meant

#: How deeply includes may be nested, and how many files a scene may have.
MAX_INCLUDE_DEPTH = 16
MAX_DOCUMENTS = 256
SECTIONS = ("include", "defaults", "materials", "world", "devices", "interaction", "rates", "safety", "fault", "record")
#: Elements that are named much like the section which holds them.
HOLDS = {"material": "materials", "device": "devices"}


@dataclass(frozen=True, slots=True)
class Document:
    """One file: its root, its sections by tag, the prefix that its include gave it, and the defaults that hold in it.

    ``folder`` is its folder, relative to the scene's, and ``included`` are the documents that it includes itself, each
    with the prefix that it gives them.
    """

    shown: str
    root: Node
    prefix: str
    folder: str = ""
    sections: dict[str, Node] = field(default_factory=dict)
    defaults: dict[str, dict[str, Attribute]] = field(default_factory=dict)
    included: list[tuple[str, Document]] = field(default_factory=list)

    def names(self) -> set[str]:
        """Return the names that are known in it by itself: those that it defines, and those of what it includes."""
        found = defined_names(self.root)
        for prefix, document in self.included:
            found.update(prefix + name for name in document.names())
        return found


@dataclass(slots=True)
class DocumentReader:
    """Reads documents depth first: an included document comes before the one that includes it."""

    problems: list[Problem]
    root_folder: Path = field(default_factory=Path)
    documents: list[Document] = field(default_factory=list)
    #: Whether a file could not be read: names that it may define are then not reported as missing.
    incomplete: bool = False
    _top: str = ""
    _open: list[tuple[Path, Place | None]] = field(default_factory=list)
    _read: dict[tuple[Path, str], Place | None] = field(default_factory=dict)

    def read(self, path: str | os.PathLike[str], place: Place | None = None) -> list[Document]:
        """Read the file at ``path``, which ``place`` names if it is given, and its includes; faults become problems."""
        shown = os.fspath(path)
        self._top = os.path.dirname(shown) or "."
        self.root_folder = Path(os.path.realpath(self._top))
        self._document(Path(os.path.realpath(shown)), shown, "", place)
        return self.documents

    def read_text(self, data: bytes, shown: str) -> list[Document]:
        """Read a document from memory; its includes are relative to the working folder."""
        self._top = os.path.dirname(shown) or "."
        self.root_folder = Path(os.path.realpath("."))
        self._parse(data, shown, "")
        return self.documents

    def _document(self, path: Path, shown: str, prefix: str, place: Place | None) -> Document | None:
        if any(path == other for other, _ in self._open):
            self.problems.append(self._cycle(path, shown, place))
            return None
        if (path, prefix) in self._read:
            first = self._read[(path, prefix)]
            related = ((first, "first here"),) if first else ()
            advice = "remove one, or give it a prefix"
            self.problems.append(Problem("duplicate-include", f"'{shown}' is included twice", place, advice, related))
            return None
        if len(self._open) >= MAX_INCLUDE_DEPTH or len(self._read) >= MAX_DOCUMENTS:
            self.incomplete = True
            sentence = f"includes are nested more than {MAX_INCLUDE_DEPTH} deep, or more than {MAX_DOCUMENTS} in all"
            self.problems.append(Problem("too-many-includes", sentence, place))
            return None
        self._read[(path, prefix)] = place
        self._open.append((path, place))
        try:
            return self._parse(read_bytes(path, shown), shown, prefix)
        except SourceError as error:
            self.incomplete = True
            self.problems.append(self._at_include(error.problem, place))
            return None
        finally:
            self._open.pop()

    def _at_include(self, problem: Problem, place: Place | None) -> Problem:
        if place is not None and problem.code == "not-a-scene":
            return replace(problem, place=place)
        if place is None or problem.code != "no-such-file":
            return problem
        named = [
            name for name in bundled_scenes.names() if problem.sentence.endswith(f"{name}': No such file or directory")
        ]
        if problem.advice != CHECK and not named:
            return replace(problem, place=place)
        advice = "paths are relative to the file that names them"
        if named:
            advice += f'; the program brings one: file="{bundled_scenes.SCHEME}{named[-1]}"'
        return Problem(problem.code, problem.sentence, place, advice)

    def _cycle(self, path: Path, shown: str, place: Place | None) -> Problem:
        chain = [spot for other, spot in self._open if spot is not None]
        related = tuple((spot, "included from here") for spot in chain)
        return Problem("include-cycle", f"'{shown}' includes itself", place, "remove one of the includes", related)

    def _parse(self, data: bytes, shown: str, prefix: str) -> Document | None:
        try:
            root = parse(data, shown)
        except SourceError as error:
            self.incomplete = True
            self.problems.append(error.problem)
            return None
        if not self._check_root(root):
            self.incomplete = True
            return None
        folder = os.path.relpath(os.path.dirname(shown) or ".", self._top)
        document = Document(shown, root, prefix, folder)
        for child in root.children:
            self._section(document, child)
        for child in root.children:  # when the sections are known
            if not child.namespace and child.tag in HOLDS:
                self._misplaced(document, child)
        if root.text:
            self.problems.append(Problem("unexpected-text", "<itouch> may not hold text", root.place))
        _collect_defaults(document)
        self.documents.append(document)
        return document

    def _check_root(self, root: Node) -> bool:
        if root.tag != "itouch" or root.namespace:
            of = f" of the namespace '{root.namespace[:80]}'" if root.namespace else ""
            sentence = f"the outermost element is <{root.written}>{of}, not <itouch>"
            run = how_run("" if root.namespace else root.tag, root.place.file)
            advice = f'a scene begins with <itouch version="{VERSION}">{run}'
            self.problems.append(Problem("wrong-root", sentence, root.place, advice))
            return False
        for name, attribute in root.attributes.items():
            if name != "version":
                advice = did_you_mean(name, ["version"], "its attributes are")
                sentence = f"<itouch> has no attribute '{name}'"
                self.problems.append(Problem("unknown-attribute", sentence, attribute.place, advice))
        return self._check_version(root)

    def _check_version(self, root: Node) -> bool:
        version = root.attributes.get("version")
        if version is None:
            if not root.attributes:
                advice = f'write <itouch version="{VERSION}">'
                self.problems.append(
                    Problem("missing-attribute", "<itouch> needs the attribute 'version'", root.place, advice)
                )
            return True
        problem = _version_problem(version)
        if problem is not None:
            self.problems.append(problem)
        return problem is None

    def _section(self, document: Document, node: Node) -> None:
        if node.tag == "session" and not node.namespace:
            return  # the State of a whole session: only restoring reads it
        if not node.namespace and node.tag in HOLDS:
            return
        if node.namespace or node.tag not in SECTIONS:
            advice = did_you_mean(node.tag, SECTIONS, "its elements are")
            sentence = f"<itouch> has no element <{node.written}>"
            mend = meant(node.tag, SECTIONS) if not node.namespace else None
            self.problems.append(Problem("unknown-element", sentence, node.place, advice, mend=mend))
            if mend is not None:  # what is in it is checked as well
                self._section(document, replace(node, tag=mend[1]))
            elif node.children:
                self.incomplete = True
        elif node.tag == "include":
            self._include(document, node)
        elif node.tag == "fault":  # any number of them; collected as if in an element of their own
            faults = document.sections.setdefault("faults", replace(node, tag="faults", attributes={}, children=[]))
            faults.children.append(node)
        elif node.tag in document.sections:
            related = ((document.sections[node.tag].place, "first here"),)
            sentence = f"<{node.tag}> may appear only once in a file"
            self.problems.append(
                Problem("duplicate-element", sentence, node.place, "put their content into one", related)
            )
            document.sections[node.tag].children.extend(node.children)  # so that they are checked as well
        else:
            document.sections[node.tag] = node

    def _misplaced(self, document: Document, node: Node) -> None:
        """Tell of an element that stands outside its section, and check what is in it as if it stood there."""
        section = HOLDS[node.tag]
        sentence = f"<itouch> has no element <{node.written}>"
        self.problems.append(Problem("unknown-element", sentence, node.place, f"put it into <{section}>"))
        home = document.sections.setdefault(section, replace(node, tag=section, attributes={}, children=[]))
        home.children.append(node)

    def _include(self, document: Document, node: Node) -> None:
        known = ("file", "prefix")
        for name, attribute in node.attributes.items():
            if name not in known:
                sentence = f"<include> has no attribute '{name}'"
                advice = did_you_mean(name, known, "its attributes are")
                mend = meant(name, [each for each in known if each not in node.attributes])
                self.problems.append(Problem("unknown-attribute", sentence, attribute.place, advice, mend=mend))
        file = node.attributes.get("file")
        if file is None:
            self.incomplete = True
            if not any(name not in known for name in node.attributes):
                self.problems.append(Problem("missing-attribute", "<include> needs the attribute 'file'", node.place))
            return
        prefix = node.attributes["prefix"].value if "prefix" in node.attributes else ""
        if file.value.startswith(bundled_scenes.SCHEME) or document.shown.startswith(bundled_scenes.SCHEME):
            self._include_shipped(document, file, prefix)
            return
        shown = os.path.normpath(os.path.join(os.path.dirname(document.shown), file.value))
        target = Path(os.path.realpath(shown))
        if not target.is_relative_to(self.root_folder):
            self.incomplete = True
            sentence = f"'{file.value}' lies outside the scene's folder"
            advice = "copy it into the folder of the scene, or below it"
            self.problems.append(Problem("outside-folder", sentence, file.place, advice))
            return
        self._take_in(document, target, shown, prefix, file.place)

    def _include_shipped(self, document: Document, file: Attribute, prefix: str) -> None:
        """Include a file that comes with the program: ``itouch:rigs/twin.xml``, or a path relative to such a file."""
        named = file.value
        if not named.startswith(bundled_scenes.SCHEME):
            beside = os.path.dirname(document.shown.removeprefix(bundled_scenes.SCHEME))
            named = bundled_scenes.SCHEME + os.path.join(beside, named)
        inner, folder = os.path.normpath(named.removeprefix(bundled_scenes.SCHEME)), bundled_scenes.folder()
        known = bundled_scenes.names()
        if folder is None or inner.replace(os.sep, "/") not in known:
            self.incomplete = True
            sentence = f"'{named}' does not come with the program"
            self.problems.append(
                Problem(
                    "no-such-file",
                    sentence,
                    file.place,
                    did_you_mean(named, [bundled_scenes.SCHEME + name for name in known], "there are"),
                )
            )
            return
        self._take_in(document, folder / inner, bundled_scenes.SCHEME + inner, prefix, file.place)

    def _take_in(self, document: Document, target: Path, shown: str, prefix: str, place: Place) -> None:
        included = self._document(target, shown, document.prefix + prefix, place)
        if included is not None:
            document.included.append((prefix, included))
            for tag, attributes in included.defaults.items():
                document.defaults.setdefault(tag, {}).update(attributes)


def contents(path: str | os.PathLike[str]) -> dict[str, bytes]:
    """Return the content of the scene at ``path`` and of all that it includes.

    The names are those that the scene's folder has for them, also where a name is a link; a file that comes with the
    program is ``itouch:NAME``.

    Raises
    ------
    OSError
        If a file can't be read any more.
    """
    home, shipped = os.path.dirname(os.fspath(path)) or ".", bundled_scenes.folder()
    found: dict[str, bytes] = {}
    for document in DocumentReader([]).read(path):
        if document.shown.startswith(bundled_scenes.SCHEME) and shipped is not None:
            name = document.shown.replace(os.sep, "/")
            found[name] = (shipped / name.removeprefix(bundled_scenes.SCHEME)).read_bytes()
        else:
            found[os.path.relpath(document.shown, home).replace(os.sep, "/")] = Path(document.shown).read_bytes()
    return found


def _version_problem(version: Attribute) -> Problem | None:
    parts = version.value.split(".")
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() and len(part) < 5 for part in parts):
        sentence = f"'{version.value[:40]}' is not a format version"
        return Problem("bad-version", sentence, version.place, f'write version="{VERSION}"')
    newest = tuple(int(part) for part in VERSION.split("."))
    if tuple(int(part) for part in parts) > newest:
        sentence = f"the file is written for format {version.value}, this program reads up to {VERSION}"
        return Problem("newer-version", sentence, version.place, "install a newer itouch-py")
    if int(parts[0]) < 1:
        return Problem(
            "bad-version", f"there is no format {version.value}", version.place, f'write version="{VERSION}"'
        )
    return None


def _collect_defaults(document: Document) -> None:
    """Add the document's own ``<defaults>`` to those of its includes."""
    section = document.sections.get("defaults")
    for node in section.children if section else ():
        document.defaults.setdefault(node.written, {}).update(node.attributes)
