"""Attributes of an element that exclude one another, or need one another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from itouch.scene.source import Attribute, Node
from itouch.schema.diagnostics import Problem
from itouch.schema.fields import constraint, xml_name


def broken_constraints(node: Node, cls: type, attributes: Mapping[str, Attribute]) -> Iterator[Problem]:
    """Yield a problem for each rule that the attributes of an element break, of those that relate attributes."""

    def given(group: Sequence[str]) -> list[str]:
        return [xml_name(name) for name in group if xml_name(name) in attributes]

    for group in constraint(cls, "EXCLUSIVE"):
        found = given(group)
        if len(found) > 1:
            sentence = f"<{node.written}> takes only one of {_listed(found)}"
            last = max((attributes[name].place for name in found), key=lambda place: (place.line, place.column))
            yield Problem("exclusive", sentence, last, "remove the others")
    for group in constraint(cls, "TOGETHER"):
        found = given(group)
        if found and len(found) < len(group):
            missing = [xml_name(name) for name in group if xml_name(name) not in found]
            sentence = f"<{node.written}> with '{found[0]}' also needs {_listed(missing)}"
            yield Problem("together", sentence, attributes[found[0]].place)
    for group in constraint(cls, "ONE_OF"):
        if not given(group):
            names = [xml_name(name) for name in group]
            sentence = f"<{node.written}> needs one of {_listed(names)}"
            yield Problem("one-of", sentence, node.place)
    for name, other in constraint(cls, "REQUIRES"):
        if xml_name(name) in node.attributes and not given([other]):  # defaults reach elements without the other
            sentence = f"<{node.written}> with '{xml_name(name)}' also needs '{xml_name(other)}'"
            yield Problem("requires", sentence, attributes[xml_name(name)].place)


def _listed(names: Sequence[str]) -> str:
    quoted = [f"'{name}'" for name in names]
    return " and ".join(quoted) if len(quoted) < 3 else ", ".join(quoted[:-1]) + f" and {quoted[-1]}"
