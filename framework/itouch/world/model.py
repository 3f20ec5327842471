"""Scene -> Model: everything that the loop needs and that never changes; illegal combinations are found here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.contact import Friction, Geometry, Shape, layout
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, elements
from itouch.scene.elements import Operator, Probe
from itouch.schema import Problem, SceneError
from itouch.world.bindings import check_bindings, check_reach, check_writers
from itouch.world.coupling import Coupling, couplings
from itouch.world.files import SceneFile, SceneFiles
from itouch.world.limits import check_safety
from itouch.world.modalities import ModalityModel, build_modalities, notices_of
from itouch.world.rig import DeviceModel, build_devices, orientation
from itouch.world.shapes import build_shapes


@dataclass(frozen=True, slots=True)
class ProbeModel:
    """A probe with its bindings; ``coupling`` has one row an object."""

    name: str
    index: int
    scene: Probe
    operator: Operator | None
    coupling: tuple[Coupling, ...]
    face: str


@dataclass(frozen=True, slots=True)
class Model:
    """The compiled scene."""

    scene: Scene
    period: float
    objects: tuple[str, ...]
    poses: NDArray[np.float64]
    shapes: tuple[Shape, ...]
    geometry: Geometry
    devices: Mapping[str, DeviceModel]
    probes: tuple[ProbeModel, ...]
    modalities: tuple[ModalityModel, ...]
    notices: tuple[str, ...]
    memory_size: int
    result_size: int
    files: tuple[SceneFile, ...] = ()

    @classmethod
    def of(cls, scene: Scene, catalog: Catalog) -> Model:
        """Compile a scene.

        Raises
        ------
        SceneError
            With everything that can't work together.
        """
        model, problems = compile_scene(scene, catalog)
        if model is None:
            raise SceneError(problems)
        warnings = (f"{problem.place}: {problem.sentence}" for problem in problems if problem.place is not None)
        return replace(model, notices=(*model.notices, *warnings))


def compile_scene(scene: Scene, catalog: Catalog) -> tuple[Model | None, list[Problem]]:
    """Compile a scene; the model is None if any of the problems is an error."""
    problems: list[Problem] = []
    devices = build_devices(scene, catalog, problems)
    problems += check_safety(scene)
    problems += check_bindings(scene, devices)
    notices: list[str] = []
    reader = SceneFiles(scene)
    built = build_shapes(scene, reader, problems)
    notices += built.notices
    problems += check_reach(scene, devices, built.boxes)
    shapes, surfaces = built.shapes, _surfaces(scene, problems)
    poses = _poses(scene, problems)
    probes = _probes(scene, devices, notices, problems)
    period = 1.0 / scene.rates.servo
    modalities = build_modalities(scene, catalog, devices, period, problems)
    notices += notices_of(modalities)
    problems += check_writers(scene, _writers(scene, modalities))
    if any(problem.severity == "error" for problem in problems):
        return None, problems
    poses.setflags(write=False)
    model = Model(
        scene, period, tuple(o.name for o in scene.objects), poses, tuple(shapes), Geometry.build(shapes, surfaces),
        devices, tuple(probes), tuple(modalities), tuple(notices), layout.MEMORY_POSES + 7 * len(shapes),
        layout.RESULT_SIZE, reader.all(),
    )  # fmt: skip
    return model, problems


def _surfaces(scene: Scene, problems: list[Problem]) -> list[Friction]:
    contacts = [_contact(scene, element, problems) for element in scene.objects]
    return [Friction(contact.static_friction, contact.dynamic_friction) for contact in contacts]


def _contact(scene: Scene, element: Any, problems: list[Problem]) -> elements.ContactMaterial:
    material = next((m for m in scene.materials if m.name == element.material), None)
    if material is not None and material.contact is not None:
        return material.contact
    if material is not None:
        sentence = f"object '{element.name}' can be touched, but its material '{material.name}' has no <contact>"
        advice = 'give the material <contact stiffness="1 N/mm"/>'
        problems.append(Problem("missing-element", sentence, scene.places.of(element, "material"), advice))
    return elements.ContactMaterial(stiffness=1.0)


def _poses(scene: Scene, problems: list[Problem]) -> NDArray[np.float64]:
    rows = [(*element.pos, *orientation(element, scene, problems)) for element in scene.objects]
    return np.array(rows, np.float64).reshape(len(rows), 7)


def _probes(
    scene: Scene, devices: Mapping[str, DeviceModel], notices: list[str], problems: list[Problem]
) -> list[ProbeModel]:
    found = []
    for index, probe in enumerate(scene.probes):
        operator = next((o for o in scene.operators if o.probe == probe.name), None)
        arm = devices.get(probe.force_to)
        materials = [_contact(scene, element, []) for element in scene.objects]
        names = [element.material for element in scene.objects]
        coupling = couplings(probe, arm, materials, names, 1.0 / scene.rates.servo, notices)
        face = next((d.name for d in devices.values() if d.carrier and d.carrier == probe.surface_to), probe.surface_to)
        found.append(ProbeModel(probe.name, index, probe, operator, coupling, face))
    return found


def _writers(scene: Scene, modalities: list[ModalityModel]) -> list[tuple[str, Any, str, str]]:
    writers: list[tuple[str, Any, str, str]] = []
    for probe in scene.probes:
        if probe.force_to:
            writers.append((f"{probe.force_to}.wrench", probe, "force_to", f"probe '{probe.name}'"))
        if probe.surface_to:
            writers.append((f"{probe.surface_to}.pose_target", probe, "surface_to", f"probe '{probe.name}'"))
    parts = {part.name: part for part in scene.modalities}
    for modality in modalities:
        for command in modality.commands:
            writers.append((command, parts[modality.name].params, "", f"modality '{modality.name}'"))
    return writers
