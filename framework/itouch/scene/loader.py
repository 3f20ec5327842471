"""From files to a Scene: includes, defaults and bases resolved, references checked, all problems reported at once."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from itouch.scene import elements, rigs
from itouch.scene.binding import Binder
from itouch.scene.description import ReplacedRig, Scene
from itouch.scene.documents import Document, DocumentReader
from itouch.scene.edits import Edit, apply_edits
from itouch.scene.extensions import Extensions
from itouch.scene.names import Names, name_of
from itouch.scene.places import Places
from itouch.scene.source import Node
from itouch.scene.uncertain_parts import Named, UncertainParts
from itouch.schema.diagnostics import Place, Problem, SceneError, did_you_mean
from itouch.schema.fields import tag_of

_SECTION_CLASSES: dict[str, type] = {
    "materials": elements.Materials,
    "world": elements.WorldElement,
    "devices": elements.Devices,
    "interaction": elements.Interaction,
    "rates": elements.Rates,
    "safety": elements.Safety,
    "faults": elements.Faults,
    "record": elements.RecordElement,
}
#: Problems of an element as a whole: <defaults> give only some attributes, so that these do not apply there.
_OF_WHOLE_ELEMENTS = ("missing-attribute", "together", "one-of", "requires")
#: Elements that <defaults> may name.
DEFAULTABLE: dict[str, type] = {
    tag_of(cls): cls
    for cls in (
        *elements.OBJECTS, elements.ContactMaterial, elements.Visual, elements.Mount, elements.Probe, elements.To,
        elements.Operator, elements.Calibration,
    )
}  # fmt: skip


def load(path: str | os.PathLike[str], extensions: Extensions, *, rig: str | os.PathLike[str] | None = None) -> Scene:
    """Load a scene, or raise an error with everything that is wrong with it.

    Parameters
    ----------
    path
        The scene file.
    extensions
        The plugins, which check their own elements.
    rig
        A file whose devices replace those of the scene, name by name.

    Raises
    ------
    SceneError
        If there is any error, with all problems in file order.
    """
    scene, problems = read_scene(path, extensions, rig=rig)
    if any(problem.severity == "error" for problem in problems):
        raise SceneError(problems)
    return scene


def read_scene(
    path: str | os.PathLike[str],
    extensions: Extensions,
    *,
    rig: str | os.PathLike[str] | None = None,
    edits: Iterable[Edit] = (),
    place: Place | None = None,
) -> tuple[Scene, list[Problem]]:
    """Load as much of a scene as possible, with all problems found.

    ``edits`` are made before it is checked; ``place`` is where another file names it, if one does.
    """
    problems: list[Problem] = []
    reader = DocumentReader(problems)
    documents = reader.read(path, place)
    problems += apply_edits(documents, edits)
    assembly = _Assembly(extensions, problems, root=os.fspath(reader.root_folder), incomplete=reader.incomplete)
    assembly.add(documents)
    if rig is not None:
        assembly.replace_devices(rig)
    scene = replace(assembly.scene(os.fspath(path)), folder=os.fspath(reader.root_folder))
    return scene, in_file_order(problems)


def loads(
    data: bytes, extensions: Extensions, *, shown: str = "scene.xml", files: Mapping[str, bytes] | None = None
) -> Scene:
    """Load a scene from memory, with the same checks.

    Parameters
    ----------
    data
        The document.
    extensions
        The plugins, which check their own elements.
    shown
        What to call it in messages.
    files
        The content of the files that it names, by the names that it uses; default: they are read from the working
        folder and below.

    Raises
    ------
    SceneError
        If there is any error, with all problems in file order.
    """
    scene, problems = read_text(data, extensions, shown=shown, files=files)
    if any(problem.severity == "error" for problem in problems):
        raise SceneError(problems)
    return scene


def read_text(
    data: bytes, extensions: Extensions, *, shown: str = "scene.xml", files: Mapping[str, bytes] | None = None
) -> tuple[Scene, list[Problem]]:
    """Load as much of a scene from memory as possible, with all problems found; for the arguments, see ``loads``."""
    problems: list[Problem] = []
    reader = DocumentReader(problems)
    documents = reader.read_text(data, shown)
    scene = _Assembly(extensions, problems, incomplete=reader.incomplete).add(documents).scene(shown)
    return replace(scene, folder=os.fspath(reader.root_folder), files=files), in_file_order(problems)


def in_file_order(problems: Iterable[Problem]) -> list[Problem]:
    """Sort problems by file (in the order of first mention), line and column, and drop duplicates.

    What is wrong in a material is found again in each one that has it as its base: it is told once, as in the base.
    Of an element that is not known nothing else is told, but what is in it, as of the one that was meant.
    """
    told: dict[tuple[str, str, Place | None], Problem] = {}
    for problem in problems:
        told.setdefault((problem.code, problem.sentence, problem.place), problem)
    unknown = {problem.place for problem in told.values() if problem.code == "unknown-element"}
    unique = [one for one in told.values() if one.code == "unknown-element" or one.place not in unknown]
    files = list(dict.fromkeys(problem.place.file for problem in unique if problem.place))
    rank = {file: index for index, file in enumerate(files)}

    def key(problem: Problem) -> tuple[int, int, int]:
        place = problem.place
        return (rank[place.file], place.line, place.column) if place else (len(files), 0, 0)

    return sorted(unique, key=key)


@dataclass(slots=True)
class _Assembly:
    """Collects the sections of all documents into one scene."""

    extensions: Extensions
    problems: list[Problem]
    places: Places = field(default_factory=Places)
    materials: list[elements.Material] = field(default_factory=list)
    objects: list[Any] = field(default_factory=list)
    devices: list[elements.DeviceElement] = field(default_factory=list)
    swapped: ReplacedRig | None = None
    probes: list[elements.Probe] = field(default_factory=list)
    operators: list[elements.Operator] = field(default_factory=list)
    modalities: list[elements.PluginPart] = field(default_factory=list)
    faults: list[elements.Fault] = field(default_factory=list)
    single: dict[str, Any] = field(default_factory=dict)
    names: Names = field(default_factory=Names)
    remnants: list[elements.Material] = field(default_factory=list)
    wanted: set[Named] = field(default_factory=set)
    root: str = "."
    incomplete: bool = False

    def add(self, documents: list[Document]) -> _Assembly:
        bases = _Bases(documents, self.problems, self.names)
        for document in documents:
            binder = self._binder(document)
            self._check_defaults(document)
            for tag, node in document.sections.items():
                if tag == "materials":
                    node = bases.resolved(document, node)
                if tag != "defaults":
                    binder.section = tag
                    self._section(tag, binder.bind(node, _SECTION_CLASSES[tag]), node)
            self.remnants += binder.remnants
            self.wanted |= binder.wanted
        self.names.unsound.update(("material", name) for name in bases.unsettled(self.names.unsound))
        return self

    def _binder(self, document: Document) -> Binder:
        own = document.names() if document.prefix else set()

        def rename(name: str) -> str:
            return document.prefix + name if name in own else name

        astray = {name for tag, given in document.defaults.items() if tag not in DEFAULTABLE for name in given}
        return Binder(self.extensions, self.problems, self.places, document.defaults, rename, self.names, astray,
                      folder=document.folder, root=self.root)  # fmt: skip

    def _check_defaults(self, document: Document) -> None:
        """Bind the elements of <defaults> by themselves, so that a fault is reported once, where it was written."""
        section = document.sections.get("defaults")
        for node in section.children if section else ():
            cls = DEFAULTABLE.get(node.tag) if not node.namespace else None
            if cls is None:
                advice = did_you_mean(node.tag, DEFAULTABLE, "defaults are possible for")
                sentence = f"<defaults> has no element <{node.written}>"
                self.problems.append(Problem("unknown-element", sentence, node.place, advice))
                continue
            found: list[Problem] = []
            Binder(self.extensions, found, Places()).bind(node, cls)
            self.problems += [problem for problem in found if problem.code not in _OF_WHOLE_ELEMENTS]

    def _section(self, tag: str, bound: Any, node: Node) -> None:
        if bound is None:
            return
        if tag == "materials":
            self.materials += bound.materials
        elif tag == "devices":
            self.devices += [d for d in bound.devices if d is not None]
        elif tag == "interaction":
            self.probes += bound.probes
            self.operators += bound.operators
            self.modalities += bound.parts
        elif tag == "faults":
            self.faults += [fault for fault in bound.faults if fault is not None]
        elif tag == "world":
            self.objects += bound.objects
            if self.places.given(bound, "temperature") or tag not in self.single:
                self.single[tag] = bound
        elif tag in self.single:
            first = self.places.of(self.single[tag])
            related = ((first, "first here"),) if first else ()
            sentence = f"<{tag}> stands in two of the files"
            self.problems.append(Problem("duplicate-element", sentence, node.place, "keep one of them", related))
        else:
            self.single[tag] = bound

    def replace_devices(self, rig: str | os.PathLike[str]) -> None:
        """Put the devices of another rig under the scene; limits that the scene sets its own devices hold for them."""
        reader = DocumentReader(self.problems)
        documents = reader.read(rig)
        other = _Assembly(self.extensions, self.problems, self.places).add(documents)
        self.problems += rigs.without_effect(os.fspath(rig), documents, other.names)
        self.problems += rigs.unmatched(
            os.fspath(rig), self.names, other.names, whole=not self.incomplete, others_whole=not reader.incomplete
        )
        self.incomplete = self.incomplete or reader.incomplete
        own_safety = self.single.get("safety", elements.Safety())
        brought = other.single.get("safety", elements.Safety())
        self.swapped = ReplacedRig(tuple(self.devices), own_safety, os.fspath(rig) if other.devices else "", brought)
        if other.devices:
            own = {device.name: device for device in self.devices}
            for device in other.devices:
                if device.name in own:
                    who = f"device '{device.name}'"
                    self.problems += rigs.apart(own[device.name].limits, device.limits, who, self.places)
            self.devices = [rigs.limited(device, own.get(device.name), self.places) for device in other.devices]
            self.names = self.names.without("devices").joined(other.names.only("devices"))
        if "safety" in other.single:
            self.problems += rigs.looser(own_safety, other.single["safety"], self.places)
            self.problems += rigs.apart(own_safety, other.single["safety"], "<safety>", self.places)
            self.single["safety"] = rigs.tightened(own_safety, other.single["safety"], self.places)

    def scene(self, source: str) -> Scene:
        world = self.single.get("world", elements.WorldElement())
        complete = replace(world, objects=tuple(self.objects))
        self.places.succeed(complete, world)
        scene = Scene(
            world=complete,
            materials=tuple(self.materials),
            devices=tuple(self.devices),
            probes=tuple(self.probes),
            operators=tuple(self.operators),
            modalities=tuple(self.modalities),
            rates=self.single.get("rates", elements.Rates()),
            safety=self.single.get("safety", elements.Safety()),
            faults=tuple(self.faults),
            record=self.single.get("record"),
            source=source,
            swapped=self.swapped,
            places=self.places,
        )
        wrong = list(self.names.problems(whole=not self.incomplete))
        self.wanted |= {("material", one.mend[1]) for one in wrong if one.mend is not None}  # devices are never mended
        self.problems += wrong
        circles = _mount_cycles(scene)
        self.problems += circles.values()
        uncertain = UncertainParts(
            self._unsound(circles), not self.incomplete, tuple(self.remnants), frozenset(self.wanted)
        )
        return replace(scene, uncertain=uncertain)

    def _unsound(self, circles: Iterable[str]) -> frozenset[Named]:
        """Return kind and name of what other checks must not count on; ``circles``: devices mounted on themselves."""
        names, modalities = self.names, {entry.name for entry in self.names.of("modality")}
        found = {*names.unsound, *names.repeated(), *(("device", name) for name in circles)}
        found.update(("", name) for name in names.stray)  # of no kind
        found.update((entry.kind, entry.name) for entry in names.nameless)
        if any(one.section == "rates" and one.name not in modalities for one in names.wanted):
            found.add(("section", "rates"))  # perhaps it is the servo's rate that has been misspelt
        return frozenset(found)


@dataclass(frozen=True, slots=True)
class _Bases:
    """Resolves ``base=`` of materials, on the nodes: what a material does not give comes from its base."""

    documents: list[Document]
    problems: list[Problem]
    names: Names
    _nodes: dict[str, tuple[Node, Document]] = field(default_factory=dict)
    #: Materials completed from their bases, by the identity of their nodes.
    _done: dict[int, Node] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for document in self.documents:
            section = document.sections.get("materials")
            for node in section.children if section else ():
                if node.tag == "material" and (given := name_of(node)) is not None:
                    name = document.prefix + given.value
                    self._nodes.setdefault(name, (node, document))

    def resolved(self, document: Document, section: Node) -> Node:
        children = [self._material(document, node) for node in section.children]
        return replace(section, children=children)

    def unsettled(self, unsound: Collection[Named]) -> Iterator[str]:
        """Yield the materials whose bases do not exist, go in a circle, or have a problem of their own."""
        for name in self._nodes:
            seen, at = set[str](), name
            while at in self._nodes and at not in seen and ("material", at) not in unsound:
                seen.add(at)
                node, document = self._nodes[at]
                base = node.attributes.get("base")
                if base is None:
                    break
                own = document.prefix + base.value
                at = own if own in self._nodes else base.value
            else:
                yield name

    def _material(self, document: Document, node: Node) -> Node:
        """Follow the bases of a material to the last one, then go back and merge what each material adds."""
        derived: list[Node] = []
        while (base := node.attributes.get("base")) is not None and node.tag == "material":
            if id(node) in self._done:
                break
            self._done[id(node)] = _without_base(node)  # used if its bases lead back to it
            found = self._nodes.get(document.prefix + base.value) or self._nodes.get(base.value)
            if found is None:  # told, if it is not there, with all other names
                self.names.refer("material", base.value, base.place, "materials")
                break
            derived.append(node)
            node, document = found
        if any(one is node for one in derived):
            self._tell_cycle(derived[next(i for i, one in enumerate(derived) if one is node) :])
        whole = self._done.get(id(node), node)
        for node in reversed(derived):
            children = _merged(whole.children, node.children)
            self._done[id(node)] = whole = replace(_without_base(node), children=children)
        return whole

    def _tell_cycle(self, members: list[Node]) -> None:
        for node in members:
            base = node.attributes["base"]
            sentence = f"material '{base.value}' is its own base"
            self.problems.append(Problem("base-cycle", sentence, base.place, "remove one of the bases"))


def _without_base(node: Node) -> Node:
    return replace(node, attributes={key: value for key, value in node.attributes.items() if key != "base"})


def _mount_cycles(scene: Scene) -> dict[str, Problem]:
    """Return a problem for each device that is mounted on itself, directly or through others, by its name."""
    mounts = {device.name: device.mount for device in scene.devices}
    followed: set[str] = set()
    problems = {}
    for device in scene.devices:
        path: dict[str, int] = {}
        name = device.name
        while name in mounts and name not in followed and name not in path:
            path[name] = len(path)
            name = mounts[name].on
        for member in list(path)[path[name] :] if name in path else ():
            sentence = f"device '{member}' is mounted on itself"
            place = scene.places.of(mounts[member], "on")
            problems[member] = Problem("mount-cycle", sentence, place, "mount it elsewhere")
        followed.update(path)
    return problems


def _merged(inherited: list[Node], own: list[Node]) -> list[Node]:
    """Return ``inherited`` and ``own`` elements as one list; those of one tag are merged, and what is own wins.

    An element that is given twice stays so, for the reader to tell.
    """
    mine: dict[tuple[str, str], Node] = {}
    more = [node for node in own if mine.setdefault((node.namespace, node.tag), node) is not node]
    merged = []
    for node in inherited:
        over = mine.pop((node.namespace, node.tag), None)
        merged.append(node if over is None else _over(node, over))
    return [*merged, *mine.values(), *more]


def _over(node: Node, over: Node) -> Node:
    """Return an element over that of the base: attributes one by one, elements inside it all or none."""
    attributes = {**node.attributes, **over.attributes}
    return replace(over, attributes=attributes, children=over.children or node.children)
