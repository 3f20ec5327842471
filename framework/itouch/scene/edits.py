"""Attributes of a scene that are set from outside, as a study does: by path, before the scene is checked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from itouch.scene.documents import Document
from itouch.scene.source import Attribute, Node
from itouch.schema.diagnostics import Place, Problem, did_you_mean


@dataclass(frozen=True, slots=True)
class Edit:
    """One attribute and its new value.

    ``path`` is ``NAME.attribute`` or ``NAME/child.attribute``, or deeper: ``NAME/child/child.attribute``; of several
    children with one tag, ``child[1]`` is the second.  NAME is the name of an object, device, probe, material or
    modality (a modality without a name has that of its element), a section of the scene such as ``world``, or an
    element of the interaction that has no name, such as ``operator``.
    """

    path: str
    value: Attribute


def apply_edits(documents: Sequence[Document], edits: Iterable[Edit]) -> Iterator[Problem]:
    """Write the new values into the documents' nodes; yield a problem for each whose path leads nowhere."""
    for edit in edits:
        owner, dot, attribute = edit.path.rpartition(".")
        name, _, child = owner.partition("/")
        if not dot or not name or not attribute:
            sentence = f"'{edit.path}' is not the path of an attribute"
            yield Problem("bad-value", sentence, edit.value.place, "write NAME.attribute, as in 'sample.material'")
            continue
        found = [node for document in documents for node in _named(document, name)]
        if not found:
            known = sorted({other for document in documents for other, _ in _all(document)})
            advice = did_you_mean(name, known, "the scene has")
            yield Problem("unknown-name", f"the scene has nothing named '{name}'", edit.value.place, advice)
            continue
        node, problem = _inner(name, found[0], child.split("/") if child else [], edit.value.place)
        if problem is not None:
            yield problem
            continue
        node.attributes[attribute] = edit.value


def _inner(name: str, node: Node, steps: list[str], place: Place) -> tuple[Node, Problem | None]:
    """Follow the steps of a path inwards from an element; return where they lead, and the problem if one is wrong."""
    for step in steps:
        tag, _, number = step.removesuffix("]").partition("[")
        inner = [one for one in node.children if tag in (one.tag, one.written)]
        index = int(number) if number.isdecimal() else 0
        if index >= len(inner) or (number and not number.isdecimal()):
            tags = [one.tag for one in node.children]
            advice = did_you_mean(tag, tags, "its elements are") or "write the element into the scene first"
            if inner:
                advice = f"it has {len(inner)} of <{tag}>: the first is {tag}[0]"
            return node, Problem("unknown-element", f"'{name}' has no element <{step}>", place, advice)
        node, name = inner[index], f"{name}/{step}"
    return node, None


def _all(document: Document) -> Iterator[tuple[str, Node]]:
    for tag, section in document.sections.items():
        yield tag, section
        for node in _below(section):
            given = node.attributes.get("name")
            if given is not None:
                yield document.prefix + given.value, node
            elif tag == "interaction":
                yield document.prefix + node.tag, node


def _below(node: Node) -> Iterator[Node]:
    for child in node.children:
        yield child
        yield from _below(child)


def _named(document: Document, name: str) -> Iterator[Node]:
    return (node for known, node in _all(document) if known == name)
