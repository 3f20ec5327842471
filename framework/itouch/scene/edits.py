"""Attributes of a scene that somebody else sets, as a study does: by path, before anything of the scene is checked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from itouch.scene.documents import Document
from itouch.scene.source import Attribute, Node
from itouch.schema.diagnostics import Problem, did_you_mean


@dataclass(frozen=True, slots=True)
class Edit:
    """One attribute and its new value.

    ``path`` is ``NAME.attribute`` or ``NAME/child.attribute``: NAME is that of an object, device, probe, material or
    modality (a modality without a name has that of its element), a section of the scene
    such as ``world``, or an element of the interaction without a name such as ``operator``.
    """

    path: str
    value: Attribute


def apply_edits(documents: Sequence[Document], edits: Iterable[Edit]) -> Iterator[Problem]:
    """Put the new values into the documents' nodes; yield a problem for each that has no place."""
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
        if child:
            inner = [node for node in found[0].children if child in (node.tag, node.written)]
            if not inner:
                tags = [node.tag for node in found[0].children]
                advice = did_you_mean(child, tags, "its elements are") or "write the element into the scene first"
                yield Problem("unknown-element", f"'{name}' has no element <{child}>", edit.value.place, advice)
                continue
            found = inner
        found[0].attributes[attribute] = edit.value


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
