"""Names and references: names that own State are unique, and every reference must refer to something.

Both are collected while elements are bound, so that an element with a fault of its own still counts as defined.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from itouch.scene.source import Attribute, Node
from itouch.scene.uncertain_parts import Named
from itouch.schema.diagnostics import Place, Problem, Suggestions, meant

_KINDS = {"material": "material", "device": "device", "probe": "probe"}
#: Names (before the dot) under which State and recordings have what belongs to no single element.
KEPT = frozenset({"objects", "events", "marks", "session"})
_HINT = "names are unique over objects, devices, probes and modalities"


@dataclass(frozen=True, slots=True)
class Entry:
    """A name or a reference: the kind of element that it is for, its place, and the section of the scene it is in."""

    kind: str
    name: str
    place: Place
    section: str


@dataclass(frozen=True, slots=True)
class Names:
    """The names defined and referred to in a set of documents."""

    defined: list[Entry] = field(default_factory=list)
    wanted: list[Entry] = field(default_factory=list)
    #: Kind and name of the elements that have a problem of their own: what they say may not be what was meant.
    unsound: set[Named] = field(default_factory=set)
    #: The elements whose names could not be read; these are empty here.
    nameless: list[Entry] = field(default_factory=list)
    #: Names of elements that are not known where they stand: each may be one that is referred to.
    stray: set[str] = field(default_factory=set)

    def define(self, tag: str, name: str, place: Place, section: str) -> None:
        """Record the name of an element with this tag; empty: it could not be read."""
        entry = Entry(_KINDS.get(tag, "object") if section != "modality" else section, name, place, section)
        (self.defined if name else self.nameless).append(entry)

    def refer(self, kind: str, name: str, place: Place, section: str) -> None:
        """Record a reference."""
        self.wanted.append(Entry(kind, name, place, section))

    def mark(self) -> tuple[int, int]:
        """Return how many names and references there are."""
        return len(self.defined), len(self.wanted)

    def doubt(self, mark: tuple[int, int]) -> set[Named]:
        """Take the names since a mark for those of elements with a problem of their own; return what these refer to."""
        self.unsound.update((entry.kind, entry.name) for entry in self.defined[mark[0] :])
        return {(entry.kind, entry.name) for entry in self.wanted[mark[1] :]}

    def of(self, kind: str) -> list[Entry]:
        """Return the names of one kind of element."""
        return [entry for entry in self.defined if entry.kind == kind]

    def only(self, section: str) -> Names:
        """Return the names and references of a section."""
        return self._those(lambda entry: entry.section == section)

    def without(self, section: str) -> Names:
        """Return the names and references without those of a section."""
        return self._those(lambda entry: entry.section != section)

    def _those(self, of: Callable[[Entry], bool]) -> Names:
        defined = [entry for entry in self.defined if of(entry)]
        kept = {(entry.kind, entry.name) for entry in defined}
        wanted, nameless = ([entry for entry in entries if of(entry)] for entries in (self.wanted, self.nameless))
        return Names(defined, wanted, self.unsound & kept, nameless, self.stray)

    def joined(self, other: Names) -> Names:
        """Return the names and references of both."""
        return Names(
            self.defined + other.defined,
            self.wanted + other.wanted,
            self.unsound | other.unsound,
            self.nameless + other.nameless,
            self.stray | other.stray,
        )

    def repeated(self) -> Iterator[Named]:
        """Yield kind and name of what is defined twice, or under the name of something else."""
        for same in (True, False):
            mine = [entry for entry in self.defined if (entry.kind == "material") is same]
            counts = Counter(entry.name for entry in mine)
            yield from ((entry.kind, entry.name) for entry in mine if counts[entry.name] > 1)

    def problems(self, *, whole: bool = True) -> Iterator[Problem]:
        """Find names given twice and, if all files could be read (``whole``), references to names that do not exist."""
        materials = [entry for entry in self.defined if entry.kind == "material"]
        yield from _duplicates(materials)
        owners = [entry for entry in self.defined if entry.kind != "material"]
        yield from _duplicates(owners)
        for entry in owners:
            if entry.name in KEPT:
                sentence = f"{entry.kind} '{entry.name}' has a name under which every session keeps State of its own"
                yield Problem("duplicate-name", sentence, entry.place, "give it another name")
        if not whole:
            return
        known: dict[str, dict[str, None]] = {}
        for entry in self.defined:
            known.setdefault(entry.kind, {})[entry.name] = None
        missing: dict[str, list[Entry]] = {}
        for entry in self.wanted:
            if entry.name not in known.get(entry.kind, {}) and entry.name not in self.stray:
                missing.setdefault(entry.kind, []).append(entry)
        for kind, entries in missing.items():
            suggestions = Suggestions(list(known.get(kind, {})), f"the scene's {kind} names are")
            strange = {entry.name for entry in entries if suggestions.mend(entry.name) is None}
            unread = sum(entry.kind == kind for entry in self.nameless)
            for entry in entries:
                if entry.name in strange and len(strange) <= unread:
                    continue  # it may be the name that could not be read
                advice = suggestions.advise(entry.name) or f"define a {kind}"
                if entry.section == "rates" and meant(
                    entry.name, ["servo"]
                ):  # there, what is no modality's is the loop's
                    advice = "did you mean 'servo'?"
                sentence = f"there is no {kind} named '{entry.name}'"
                # never mended by guessing: a person must say which device acts on whom, and which finger is meant
                mend = suggestions.mend(entry.name) if kind not in ("device", "probe") else None
                yield Problem("unknown-name", sentence, entry.place, advice, mend=mend)


def name_of(node: Node) -> Attribute | None:
    """Return the attribute that gives an element's name, even if ``name`` is misspelt; None: it has none."""
    misspelt = (attribute for key, attribute in node.attributes.items() if meant(key, ["name"]))
    return node.attributes.get("name") or next(misspelt, None)


def _duplicates(entries: list[Entry]) -> Iterator[Problem]:
    first: dict[str, Entry] = {}
    for entry in entries:
        other = first.setdefault(entry.name, entry)
        if other is entry:
            continue
        same = other.kind == entry.kind
        what = (
            "is defined twice" if same else f"has the name of a{'n' if other.kind[0] in 'aeiou' else ''} {other.kind}"
        )
        sentence = f"{entry.kind} '{entry.name}' {what}"
        advice = _HINT
        if same:  # a modality may do without a name, and then has that of its element
            advice = "give one of them a name of its own" if entry.kind == "modality" else "rename one of them"
        yield Problem("duplicate-name", sentence, entry.place, advice, ((other.place, "first defined here"),))


def defined_names(root: Node) -> set[str]:
    """Return the names that a document defines, as written."""
    names = set()
    for section in root.children:
        for node in section.children:
            if section.tag == "defaults":
                continue
            if section.tag == "interaction" and node.namespace:
                names.add(node.attributes["name"].value if "name" in node.attributes else node.tag)
            elif "name" in node.attributes:
                names.add(node.attributes["name"].value)
    return names
