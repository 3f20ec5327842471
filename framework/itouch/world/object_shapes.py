"""The shapes of a world's objects, as the contact engine takes them, made from the scene's elements."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from itouch.contact import Box, Capsule, Cylinder, Mesh, Plane, Shape, Sphere
from itouch.contact.bvh import MAX_TRIANGLES
from itouch.contact.meshfile.faults import MeshError
from itouch.scene import Scene, elements
from itouch.schema import Problem
from itouch.world.scene_files import SceneFile, SceneFiles

if TYPE_CHECKING:
    from itouch.contact.meshfile import LoadedMesh

Corners = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class Shapes:
    """The shapes of all objects, in order.

    Attributes
    ----------
    shapes
        One for each object; a plane in place of one that could not be made, which is a problem.
    boxes
        For meshes, object's name -> lower and upper corner of its bounding box, in its own frame [m].
    files
        Every file that was read.
    notices
        What was repaired in meshes.
    failed
        The objects, by index, whose shape could not be made.
    """

    shapes: list[Shape] = field(default_factory=list)
    boxes: dict[str, Corners] = field(default_factory=dict)
    files: tuple[SceneFile, ...] = ()
    notices: list[str] = field(default_factory=list)
    failed: set[int] = field(default_factory=set)


def build_shapes(scene: Scene, reader: SceneFiles, problems: list[Problem]) -> Shapes:
    """Make the shapes of a scene; what is wrong with its meshes becomes problems at their ``file``."""
    built = Shapes()
    loaded: dict[tuple[str, float, str | None], LoadedMesh] = {}
    for element in scene.objects:
        if not isinstance(element, elements.Mesh):
            built.shapes.append(_primitive(element))
            continue
        mesh = _mesh(scene, element, reader, loaded, problems)
        if mesh is None:
            built.failed.add(len(built.shapes))
            built.shapes.append(Plane())
            continue
        built.shapes.append(Mesh(mesh.surface))
        built.boxes[element.name] = (mesh.facts.low, mesh.facts.high)
        built.notices.extend(_told(scene, element, mesh, problems))
    return built


def _primitive(element: Any) -> Shape:
    if isinstance(element, elements.Box):
        x, y, z = element.size
        return Box((x / 2, y / 2, z / 2))
    if isinstance(element, elements.Sphere):
        return Sphere(element.radius)
    if isinstance(element, elements.Capsule):
        return Capsule(element.radius, element.length / 2)
    if isinstance(element, elements.Cylinder):
        return Cylinder(element.radius, element.length / 2)
    return Plane()


def _mesh(
    scene: Scene,
    element: elements.Mesh,
    reader: SceneFiles,
    loaded: dict[tuple[str, float, str | None], LoadedMesh],
    problems: list[Problem],
) -> LoadedMesh | None:
    """Load an object's mesh; objects with the same file, scale and sides share one; None: it became a problem."""
    scaled = scene.places.given(element, "scale") or element.scale != 1.0
    sides = element.sides if scene.places.given(element, "sides") or element.sides == "two" else None
    key = (element.file, element.scale, sides)
    if key in loaded:
        return loaded[key]
    from itouch.contact.meshfile.load import load_source

    try:
        source = reader.mesh(element.file)
        mesh = load_source(source, scale=element.scale, sides=sides, scaled=scaled)
        total = sum(other.surface.face_count for other in loaded.values()) + mesh.surface.face_count
        if total > MAX_TRIANGLES:
            sentence = f"the scene's meshes have {total} triangles together; the limit is {MAX_TRIANGLES}"
            raise MeshError("mesh-too-large", sentence, "simplify them")
        loaded[key] = mesh
    except MeshError as error:
        place = scene.places.of(element, "file")
        problems.append(Problem(error.code, error.sentence, place, error.advice))
        return None
    return loaded[key]


def _told(scene: Scene, element: elements.Mesh, mesh: LoadedMesh, problems: list[Problem]) -> list[str]:
    """Report what was found in a mesh: doubtful things become warnings with their place, repairs are returned."""
    notices = []
    for finding in mesh.findings:
        if finding.severity == "warning":
            place = scene.places.of(element, "file")
            problems.append(Problem(finding.code, finding.sentence, place, finding.advice, severity="warning"))
        else:
            advice = f"; {finding.advice}" if finding.advice else ""
            notices.append(f"object '{element.name}': {finding.sentence}{advice}")
    return notices
