"""From XML nodes to dataclasses: fields are the grammar, every fault becomes a problem, nothing is guessed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import MISSING, dataclass, field, replace
from typing import Any

from itouch.scene.elements import PluginPart
from itouch.scene.extensions import Extensions, missing_part
from itouch.scene.names import Names, name_of
from itouch.scene.places import Places
from itouch.scene.source import Attribute, Node
from itouch.scene.uncertain_parts import Named
from itouch.scene.values import ValueProblemError, parse_value
from itouch.schema.diagnostics import ItouchError, Place, Problem, did_you_mean, meant, nearest
from itouch.schema.fields import PLUGIN_NAMESPACE, ParameterError, Spec, constraint, default_of, specs, tag_of, xml_name
from itouch.schema.plugin_errors import failure

#: Value of a field that could not be read; its problem has been reported already.
BROKEN: Any = object()
#: Sections that hold elements, or more than one attribute: what is right in one is checked, whatever else is wrong.
SALVAGED = ("materials", "world", "devices", "interaction", "rates", "safety", "faults", "record")


@dataclass(slots=True)
class Binder:
    """Binds the nodes of one document.

    ``defaults`` maps a tag to the attributes that hold where an element does not give them; ``rename`` puts an
    include's prefix before the names that its document defines; ``folder`` is the document's folder, relative to the
    scene's folder ``root``.
    """

    extensions: Extensions
    problems: list[Problem]
    places: Places
    defaults: Mapping[str, Mapping[str, Attribute]] = field(default_factory=dict)
    rename: Callable[[str], str] = str
    names: Names = field(default_factory=Names)
    #: Attributes for which there are defaults of an element that is not known: one that lacks them is not told.
    astray: Set[str] = frozenset()
    section: str = ""
    folder: str = ""
    root: str = "."
    #: Identities of elements of which a child was wrong and is left out.
    _incomplete: set[int] = field(default_factory=set)
    #: Materials that are left out, as far as they could be read; what elements with a problem of their own refer to.
    remnants: list[Any] = field(default_factory=list)
    wanted: set[Named] = field(default_factory=set)

    def bind(self, node: Node, cls: type, *, extra: frozenset[str] = frozenset()) -> Any:
        """Return an instance of ``cls``, or None if a fault prevents it; the caller reads the ``extra`` attributes.

        In a section what could not be read has its default, so that what else is in it is checked.
        """
        table = specs(cls)
        attributes = self._with_defaults(node, cls)
        values: dict[str, Any] = {}
        spots: dict[str, Place] = {}
        unknown = self._unknown_attributes(node, attributes, table, extra, cls)
        for name, spec in table.items():
            attribute = attributes.get(xml_name(name))
            if spec.kind in ("child", "children", "plugin"):
                continue
            if attribute is None:
                self._default(node, cls, name, spec, unknown, values)
                continue
            spots[name] = attribute.place
            values[name] = self._value(node, name, spec, attribute)
        self.problems += broken_constraints(node, cls, attributes)
        if hasattr(cls, "OPEN"):
            values[cls.OPEN] = self._open(node, attributes, table, cls, spots)
        values.update(self._children(node, cls, table))
        return self._build(node, cls, values, spots)

    def _build(self, node: Node, cls: type, values: dict[str, Any], spots: dict[str, Place]) -> Any:
        if any(value is BROKEN for value in values.values()):
            return self._salvage(node, cls, values, spots)
        try:
            instance = cls(**values)
        except (ValueError, ItouchError) as error:  # a plugin's own check in __post_init__
            if id(node) in self._incomplete:  # it may only miss the element that is wrong
                return None
            place, advice = node.place, ""
            if isinstance(error, ParameterError):
                place, advice = spots.get(error.field, place), error.advice
            self.problems.append(Problem("bad-value", f"<{node.written}>: {error}", place, advice))
            return self._salvage(node, cls, values, spots)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self.problems.append(failure(f"<{node.written}>", "its parameters", error, node.place))
            return None
        self.places.put(instance, node.place, spots)
        return instance

    def _salvage(self, node: Node, cls: type, values: Mapping[str, Any], spots: Mapping[str, Place]) -> Any:
        """Return a section with defaults where it could not be read, else None; a material becomes a remnant."""
        if not self.section or node.tag not in ("material", *SALVAGED):
            return None
        stands_in = getattr(cls, "STANDS_IN", {})
        read = {name: value for name, value in values.items() if value is not BROKEN}
        try:
            found = cls(**{**read, **stands_in})
        except (TypeError, ValueError):  # it can't be without what is missing
            return None
        self.places.put(found, node.place, spots)
        if node.tag == "material":
            self.remnants.append(found)
            return None
        self.names.unsound.add(("section", node.tag))
        return found

    def _with_defaults(self, node: Node, cls: type) -> dict[str, Attribute]:
        merged = dict(node.attributes)
        shut = {
            xml_name(other)
            for group in constraint(cls, "EXCLUSIVE")
            for name in group
            if xml_name(name) in merged
            for other in group
        }
        for name, attribute in self.defaults.get(node.written, {}).items():
            if name not in shut:
                merged.setdefault(name, attribute)
        return merged

    def _unknown_attributes(
        self,
        node: Node,
        attributes: Mapping[str, Attribute],
        table: Mapping[str, Spec],
        extra: frozenset[str],
        cls: type,
    ) -> dict[str, Attribute]:
        """Tell of the attributes that are not known, and return them by the known ones that they resemble."""
        known = [xml_name(n) for n, spec in table.items() if spec.kind not in ("child", "children", "plugin")]
        known += sorted(extra)
        misspelt: dict[str, Attribute] = {}
        for name, attribute in attributes.items():
            if name in known or hasattr(cls, "OPEN"):
                continue
            close = nearest(name, [k for k in known if k not in attributes]) or nearest(name, known)
            misspelt[close] = attribute
            advice = f"did you mean '{close}'?" if close else did_you_mean(name, known, "its attributes are")
            sentence = f"<{node.written}> has no attribute '{name}'"
            mend = meant(name, [k for k in known if k not in attributes])
            self.problems.append(
                Problem("unknown-attribute", sentence, attribute.place, advice or "remove it", mend=mend)
            )
        return misspelt

    def _default(
        self, node: Node, cls: type, name: str, spec: Spec, misspelt: Mapping[str, Attribute], values: dict[str, Any]
    ) -> None:
        default = default_of(cls, name)
        if default is not MISSING:
            return
        values[name] = BROKEN
        if xml_name(name) in misspelt:  # a misspelt required attribute is one problem, reported already
            if spec.kind in ("name", "ref"):  # others refer to it, or it to others
                self._value(node, name, spec, misspelt[xml_name(name)])
            return
        if spec.kind == "name":
            self.names.define(node.tag, "", node.place, self.section)
        if xml_name(name) in self.astray:
            return
        what = spec.doc or spec.kind
        sentence = f"<{node.written}> needs the attribute '{xml_name(name)}'"
        self.problems.append(Problem("missing-attribute", sentence, node.place, f"{xml_name(name)}: {what}"))

    def _value(self, node: Node, name: str, spec: Spec, attribute: Attribute) -> Any:
        try:
            value = parse_value(spec, attribute.value)
        except ValueProblemError as fault:
            sentence = f'<{node.written} {xml_name(name)}="{_short(attribute.value)}">: {fault}'
            self.problems.append(Problem(fault.code, sentence, attribute.place, fault.advice, mend=fault.mend))
            if spec.kind == "name":
                self.names.define(node.tag, "", attribute.place, self.section)
            return BROKEN
        if spec.kind == "file":
            return self._file(value, attribute)
        if spec.kind not in ("name", "ref") or not value:
            return value
        renamed = self.rename(value)
        if spec.kind == "name":
            self.names.define(node.tag, renamed, attribute.place, self.section)
        else:
            self.names.refer(spec.target, renamed, attribute.place, self.section)
        return renamed

    def _file(self, value: str, attribute: Attribute) -> Any:
        """Return a path relative to the scene's folder; links are followed when the file is read."""
        path = os.path.normpath(os.path.join(self.folder, value))
        if os.path.isabs(path):
            path = os.path.relpath(os.path.realpath(path), os.path.realpath(self.root))
        problem = None
        if "://" in value:
            sentence = f"'{_short(value)}' is not the path of a file"
            problem = Problem("outside-folder", sentence, attribute.place, "files are read from disk only")
        elif path.split(os.sep)[0] == os.pardir:
            sentence = f"'{_short(value)}' lies outside the scene's folder"
            advice = "copy it into the folder of the scene, or below it"
            problem = Problem("outside-folder", sentence, attribute.place, advice)
        if problem is not None:
            self.problems.append(problem)
            return BROKEN
        return path.replace(os.sep, "/")

    def _open(
        self,
        node: Node,
        attributes: Mapping[str, Attribute],
        table: Mapping[str, Spec],
        cls: type,
        spots: dict[str, Place],
    ) -> tuple[tuple[str, float], ...]:
        """Bind attributes that are named after other elements (as the rate of each modality is)."""
        pattern: Spec = cls.OPEN_SPEC  # type: ignore[attr-defined]  # stands beside OPEN
        known = {xml_name(name) for name in table}
        entries = []
        for name, attribute in attributes.items():
            if name not in known:
                value = self._value(node, name, pattern, attribute)
                spots[self.rename(name)] = attribute.place
                self.names.refer("modality", self.rename(name), attribute.place, self.section)
                if value is not BROKEN:
                    entries.append((self.rename(name), value))
        return tuple(sorted(entries))

    def _children(self, node: Node, cls: type, table: Mapping[str, Spec]) -> dict[str, Any]:
        slots = {
            tag_of(element, spec): (name, spec, element)
            for name, spec in table.items()
            if spec.kind in ("child", "children")
            for element in spec.elements
        }
        plugin_slot = next((name for name, spec in table.items() if spec.kind == "plugin"), "")
        values: dict[str, Any] = {}
        listed: dict[str, list[Any]] = {name: [] for name, spec, _ in slots.values() if spec.kind == "children"}
        parts: dict[tuple[str, str, str], PluginPart] = {}
        first: dict[str, Node] = {}
        for child in node.children:
            problems, mark = len(self.problems), self.names.mark()
            if child.namespace.startswith(PLUGIN_NAMESPACE) and plugin_slot:
                self._part(node, child, parts)
            elif child.tag in slots and self._same_namespace(node, child):
                self._child(node, child, slots[child.tag], values, listed, first)
            elif meant_tag := self._unknown_element(node, child, list(slots), bool(plugin_slot)):
                inside = replace(child, tag=meant_tag)  # what is in it is checked as well
                self._child(node, inside, slots[meant_tag], values, listed, first)
            if any(problem.severity == "error" for problem in self.problems[problems:]):
                self.wanted.update(self.names.doubt(mark))
        if node.text:
            sentence = f"<{node.written}> may not hold the text '{_short(node.text)}'"
            self.problems.append(Problem("unexpected-text", sentence, node.place, "values are attributes"))
        if plugin_slot:
            values[plugin_slot] = tuple(parts.values())
        return values | {name: tuple(found) for name, found in listed.items()}

    @staticmethod
    def _same_namespace(node: Node, child: Node) -> bool:
        return child.namespace in ("", node.namespace)

    def _child(
        self, node: Node, child: Node, slot: tuple[str, Spec, type], values: dict[str, Any],
        listed: Mapping[str, list[Any]], first: dict[str, Node],
    ) -> None:  # fmt: skip
        name, spec, element = slot
        bound = self.bind(child, element)
        if spec.kind == "children":
            if bound is not None:
                listed[name].append(bound)
            else:
                self._incomplete.add(id(node))
            return
        if child.tag in first:
            sentence = f"<{child.written}> may appear only once here"
            related = ((first[child.tag].place, "first here"),)
            self.problems.append(Problem("duplicate-element", sentence, child.place, "remove one of them", related))
            return
        first[child.tag] = child
        values[name] = BROKEN if bound is None else bound

    def _part(self, host: Node, node: Node, parts: dict[tuple[str, str, str], PluginPart]) -> None:
        part = self.bind_part(host, node)
        if part is None:
            return
        twin = parts.setdefault((part.plugin, part.local, part.name), part)
        if twin is not part and host.tag != "interaction":  # of modalities, which have names, these are compared
            place = self.places.of(twin)
            related = ((place, "first here"),) if place else ()
            sentence = f"<{node.written}> may appear only once here"
            self.problems.append(Problem("duplicate-element", sentence, node.place, "remove one of them", related))

    def bind_part(self, host: Node, node: Node) -> PluginPart | None:
        """Bind an element of a plugin's namespace by the plugin's own dataclass."""
        plugin = node.namespace.removeprefix(PLUGIN_NAMESPACE)
        cls = self.extensions.element_class(plugin, host.tag, node.tag)
        if cls is None:
            problem = missing_part(self.extensions, host, node, plugin)
            optional = host.attributes.get("optional")
            if host.tag == "device" and optional is not None and optional.value in ("true", "yes", "1"):
                problem = replace(problem, severity="warning")
            if not (problem.code == "plugin-failed" and any(p.sentence == problem.sentence for p in self.problems)):
                self.problems.append(problem)
            if host.tag == "interaction":  # others may refer to it
                word = meant(node.tag, self.extensions.locals(plugin, host.tag))
                self._modality_name(node if word is None else replace(node, tag=word[1]))
            return None
        name = self._modality_name(node) if host.tag == "interaction" else ""
        params = self.bind(node, cls, extra=frozenset({"name"}) if name else frozenset())
        if params is None:
            return None
        part = PluginPart(plugin, node.tag, params, name)
        self.places.put(part, node.place, {key: value.place for key, value in node.attributes.items()})
        return part

    def _modality_name(self, node: Node) -> str:
        given = name_of(node)
        name = self.rename(given.value if given else node.tag)
        self.names.define(node.tag, name, given.place if given else node.place, "modality")
        return name

    def _unknown_element(self, node: Node, child: Node, known: list[str], parts: bool) -> str:
        """Tell of an element that is not known; return the tag that can only have been meant, or nothing."""
        sentence = f"<{node.written}> has no element <{child.written}>"
        advice = did_you_mean(child.tag, known, "its elements are")
        mend = meant(child.tag, known) if not child.namespace else None
        if child.namespace.startswith(PLUGIN_NAMESPACE):
            advice = "elements of plugins stand in <device>, <material> and <interaction>"
        elif child.namespace and not self._same_namespace(node, child):
            advice = f"the namespace '{child.namespace}' is not one of a plugin ({PLUGIN_NAMESPACE}NAME)"
        self.problems.append(Problem("unknown-element", sentence, child.place, advice or "remove it", mend=mend))
        if mend is None and (given := name_of(child)) is not None:
            self.names.stray.add(self.rename(given.value))
        return mend[1] if mend is not None else ""


def _short(text: str, width: int = 40) -> str:
    line = " ".join(text.split())
    return line if len(line) <= width else line[: width - 3] + "..."


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
