"""Scene -> Model: everything that the loop needs and that never changes; impossible combinations are found here."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.contact import Geometry, Plane, Shape, layout
from itouch.contact.surface_effects import Effects
from itouch.plugin import Role, WorldSurface, poses
from itouch.plugin.bases import keeping_anyhow
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.scene.elements import Operator, Probe
from itouch.scene.loader import in_file_order
from itouch.scene.uncertain_parts import Named
from itouch.schema import Place, Problem, SceneError
from itouch.world.bindings import blind, check_bindings, check_fingers, check_reach, check_writers
from itouch.world.independent_parts import doubtful_of, independent_parts, new
from itouch.world.limits import check_safety
from itouch.world.modalities import ModalityModel, build_modalities, notices_of, ordered
from itouch.world.motion_tables import NO_MOTIONS, Motions, build_motions
from itouch.world.object_shapes import build_shapes
from itouch.world.overlap import overlaps
from itouch.world.presented_surfaces import surfaces_of, touched_device_of
from itouch.world.recorded_motion import RecordedMotion, recorded_motion
from itouch.world.replaced_limits import differences, fitted
from itouch.world.rig import DeviceModel, build_devices, carriers_of, orientation
from itouch.world.scene_files import SceneFile, SceneFiles
from itouch.world.skin_source import waits_without_skin_reading
from itouch.world.surfaces import build_effects, build_friction, check_effects, contact_of, read_textures
from itouch.world.virtual_coupling import Coupling, couplings, on_bodies, relied, stable_effects

Vector = tuple[float, float, float]
#: Input sources with which a person leads a hand.
PERSON = ("mouse", "keyboard", "gamepad")

#: A length above this [m], large for a scene for a finger, gives a warning if it has no unit.
LARGE = 1.5
#: Attributes of an object that are lengths.
_LENGTHS = ("size", "radius", "length", "pos")


@dataclass(frozen=True, slots=True)
class ProbeModel:
    """A probe with its bindings; ``coupling`` has an entry per object; a hand without a motion begins at ``start`` [m].

    ``touched_device``: the device that the finger touches on its table; ``relied``: damping of hand and arm [N s/m]
    that the coupling relies on behind a wire, None: there is no wire.
    """

    name: str
    index: int
    scene: Probe
    operator: Operator | None
    coupling: tuple[Coupling, ...]
    touched_device: str
    effects: tuple[Effects, ...] = ()
    recorded: RecordedMotion | None = None
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    relied: float | None = None


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
    effects: tuple[Effects, ...] = ()
    motions: Motions = NO_MOTIONS
    #: The surface that is brought to each probe, for probes that are met by one.
    surfaces: Mapping[str, WorldSurface] = field(default_factory=dict)
    #: Cache of `place_of`: the elements of devices and modalities by name.
    _parts: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    #: Cache of `itouch.world.state.declared`.
    declared: list[Any] = field(default_factory=list, init=False, repr=False, compare=False)

    def carrier_to(self, probe: str) -> ModalityModel | None:
        """Return the modality that brings a surface to a probe, or None."""
        return next((one for one in self.modalities if one.surface_fields and one.surface_fields.probe == probe), None)

    def contact_of(self, probe: str) -> ModalityModel | None:
        """Return the modality that computes the contact of a probe, or None: the framework's own proxy does."""
        return next((one for one in self.modalities if one.contact_fields and one.contact_fields.probe == probe), None)

    @property
    def framed(self) -> frozenset[str]:
        """The devices whose frame in the world is in State: those that track, push or meet a finger."""
        bound = ((one.scene.pose_from, one.scene.force_to, one.scene.surface_to) for one in self.probes)
        return frozenset(name for names in bound for name in names if name in self.devices)

    @property
    def moving(self) -> bool:
        """Whether any object moves."""
        return bool(self.motions)

    def beside(self, probe: ProbeModel) -> int:
        """Return how many other probes, without an operator of their own, are on the finger of this one."""
        same = (other for other in self.probes if other.scene.pose_from == probe.scene.pose_from)
        return sum(other.operator is None for other in same if other.name != probe.name)

    def worn(self, probe: ProbeModel) -> tuple[DeviceModel, ...]:
        """Return the twins worn on the operator's finger of a probe: those mounted, directly or not, on its tracker.

        Devices that a probe follows or acts by are not worn; where probes share a tracker, only the first one with an
        operator wears them.
        """
        same = (one for one in self.probes if one.scene.pose_from == probe.scene.pose_from and one.operator is not None)
        if next(same, None) is not probe or not self.devices[probe.scene.pose_from].twin:
            return ()
        return worn_on(self.scene, self.devices, probe.scene.pose_from)

    def place_of(self, name: str) -> Place | None:
        """Return where in the scene's files a device or a modality stands."""
        if not self._parts:
            parts: tuple[Any, ...] = (*self.scene.devices, *self.scene.modalities)
            probes = {probe.name: probe for probe in self.scene.probes}
            self._parts.update({one.name: probes[one.default_of] for one in self.modalities if one.default_of})
            self._parts.update({part.name: part for part in reversed(parts)})
        return self.scene.places.of(self._parts[name]) if name in self._parts else None

    @classmethod
    def of(cls, scene: Scene, catalog: Catalog) -> Model:
        """Compile a scene.

        Raises
        ------
        SceneError
            With everything that can't work together, in file order.
        """
        return accepted(survey(scene, catalog))


def accepted(found: Survey, more: Iterable[Problem] = ()) -> Model:
    """Return a compiled scene, which has its warnings as notices.

    Raises
    ------
    SceneError
        With everything that can't work together, and what ``more`` is wrong with it then, in file order.
    """
    if found.model is None:
        raise SceneError(in_file_order([*found.problems, *more]))
    warnings = (f"{problem.place}: {problem.sentence}" for problem in found.problems if problem.place is not None)
    return replace(found.model, notices=(*found.model.notices, *warnings))


def compile_scene(scene: Scene, catalog: Catalog) -> tuple[Model | None, list[Problem]]:
    """Compile a scene; the model is None if any of the problems is an error."""
    found = survey(scene, catalog)
    return found.model, list(found.problems)


@dataclass(frozen=True, slots=True)
class Survey:
    """What compiling a scene has found.

    Attributes
    ----------
    model
        The compiled scene; None if there is any error.
    problems
        What is wrong beyond what was known before.
    part
        The compiled part of the scene that stands by itself, for further checks; None if there is none.
    doubtful
        Kind and name of what is not in that part as it was meant.
    """

    model: Model | None
    problems: Sequence[Problem]
    part: Model | None
    doubtful: frozenset[Named]


def survey(scene: Scene, catalog: Catalog, known: Iterable[Problem] = ()) -> Survey:
    """Compile a scene as far as it can be: ``known`` is what has been found wrong with it already.

    All is told at once, but nothing twice: neither what is wrong only because something else is, nor, of a scene that
    has problems already, warnings.
    """
    errors = [problem for problem in known if problem.severity == "error"]
    rest = independent_parts(scene)
    whole = rest is scene and scene.uncertain.whole
    part: Model | None = None
    if whole and not errors:
        with keeping_anyhow():
            part, problems = _compile_scene(scene, catalog)
        sound = not any(problem.severity == "error" for problem in problems)
        return Survey(part if sound else None, problems, part, frozenset() if sound else _doubtful(scene, part))
    problems = _of_pieces(scene, catalog)
    with contextlib.suppress(Exception), keeping_anyhow():  # half a scene may not allow it
        part, more = _compile_scene(rest, catalog, whole=whole)
        problems += more
    doubtful = _doubtful(scene, part)
    return Survey(None, [problem for problem in problems if new(problem, errors, doubtful)], part, doubtful)


def _doubtful(scene: Scene, part: Model | None) -> frozenset[Named]:
    """Return kind and name of what is not in a compiled part as it was meant."""
    if part is None:
        return doubtful_of(scene, ())
    there = [("device", name) for name in part.devices] + [("object", name) for name in part.objects]
    there += [("modality", one.name) for one in part.modalities]
    there += [("probe", one.name) for one in part.probes if not one.scene.surface_to]  # its fields are a modality's
    found = doubtful_of(scene, there)
    if part.motions.bodies is None and any(one.dynamics is not None for one in scene.objects):
        return found | {("object", "objects")}  # State has no room for them
    return found


def _of_pieces(scene: Scene, catalog: Catalog) -> list[Problem]:
    """Return what is wrong with single devices, limits, materials, files and circles of a scene that has problems.

    Each depends on little else, so that those are checked, too, which do not stand by themselves.
    """
    problems: list[Problem] = []
    with contextlib.suppress(Exception):  # half a scene may not allow it
        problems += check_safety(scene)
        fit, reader = fitted(scene, catalog), SceneFiles(scene)
        devices = build_devices(fit, catalog, problems, reader)
        built = build_shapes(scene, reader, problems)
        read_textures(scene, reader, problems)
        sure = tuple(probe for probe in scene.probes if ("probe", probe.name) not in scene.uncertain.unsound)
        check_effects(replace(scene, probes=sure, materials=(*scene.materials, *scene.uncertain.remnants)), problems)
        build_motions(scene, _poses(scene, problems), built.shapes, devices, reader, problems, built.failed)
        ordered(scene, problems)
    return problems


def _compile_scene(scene: Scene, catalog: Catalog, *, whole: bool = True) -> tuple[Model, list[Problem]]:
    """Compile a scene, of which what has an error is left out or idle; not ``whole``: it is a part of one."""
    problems: list[Problem] = []
    scene = fitted(scene, catalog)
    reader = SceneFiles(scene)
    devices = build_devices(scene, catalog, problems, reader)
    problems += check_safety(scene)
    problems += check_bindings(scene, devices)
    notices: list[str] = [*scene.notes, *differences(scene, devices, catalog)]
    forms: list[Problem] = []
    built = build_shapes(scene, reader, forms)
    notices += built.notices
    problems += check_reach(scene, devices, built.boxes)
    problems += large_lengths(scene)
    notices += overlaps(scene, built.boxes)
    notices += _worn_notices(scene, devices)
    shapes, surfaces = built.shapes, build_friction(scene, problems)
    effects = build_effects(scene, reader, problems, notices)
    poses = _poses(scene, forms)
    motions = build_motions(scene, poses, shapes, devices, reader, forms, built.failed)
    problems += forms
    ease = motions.bodies.ease if motions.bodies is not None else (1.0,) * len(shapes)
    probes = _probes(scene, devices, effects, ease, notices, reader, problems)
    period = 1.0 / scene.rates.servo
    presented = surfaces_of(scene, devices, {probe.name: probe.operator for probe in probes})
    formed = not any(problem.severity == "error" for problem in forms)
    geometry = Geometry.build(shapes, surfaces) if formed else Geometry.build([Plane()] * len(shapes))
    modalities = build_modalities(scene, catalog, devices, presented, geometry, reader, period, probes, problems)
    notices += notices_of(modalities)
    notices += [
        f"device '{name}' is only read, it can't be enabled: {why}" for name, why in blind(scene, devices).items()
    ]
    writers = _writers(scene, devices, modalities)
    problems += check_writers(scene, writers)
    if whole:  # else what is missing here may be what is wrong there
        problems += check_fingers(scene, devices, writers)
    poses.setflags(write=False)
    model = Model(
        scene, period, tuple(o.name for o in scene.objects), poses, tuple(shapes), geometry,
        devices, tuple(probes), tuple(modalities), tuple(notices), layout.MEMORY_POSES + 7 * len(shapes),
        layout.RESULT_SIZE, reader.all(), effects, motions, presented,
    )  # fmt: skip
    felt = all(one.name in devices for one in scene.devices) or not any(one.severity == "error" for one in problems)
    if whole and felt:
        problems += waits_without_skin_reading(model)
    return model, problems


def worn_on(scene: Scene, devices: Mapping[str, DeviceModel], tracker: str) -> tuple[DeviceModel, ...]:
    """Return the twins that are mounted on a finger's tracker, without those that a probe follows or acts by."""
    named = {name for one in scene.probes for name in (one.pose_from, one.force_to, one.surface_to)}
    return tuple(
        one for name, one in devices.items() if one.twin and name not in named and tracker in carriers_of(devices, one)
    )


def _worn_notices(scene: Scene, devices: Mapping[str, DeviceModel]) -> Iterator[str]:
    """Yield a notice for each device that is worn on a finger's twin."""
    fingers = {operator.probe for operator in scene.operators}
    for probe in scene.probes:
        tracker = devices.get(probe.pose_from)
        if probe.name in fingers and tracker is not None and tracker.twin:
            for one in worn_on(scene, devices, probe.pose_from):
                feels = "it feels what presses on that, and its heat reaches the skin"
                yield f"device '{one.name}' is worn on the finger '{probe.name}': {feels}"


def _poses(scene: Scene, problems: list[Problem]) -> NDArray[np.float64]:
    rows = [(*element.pos, *orientation(element, scene, problems)) for element in scene.objects]
    return np.array(rows, np.float64).reshape(len(rows), 7)


def _probes(
    scene: Scene, devices: Mapping[str, DeviceModel], effects: Sequence[Effects], ease: Sequence[float],
    notices: list[str], reader: SceneFiles, problems: list[Problem],
) -> list[ProbeModel]:  # fmt: skip
    found = []
    for index, probe in enumerate(scene.probes):
        operator, start = hand_of(scene, probe, devices, problems)
        arm = devices.get(probe.force_to)
        materials = [contact_of(scene, element, []) for element in scene.objects]
        names = [element.material for element in scene.objects]
        coupling = couplings(probe, arm, materials, names, 1.0 / scene.rates.servo, notices)
        coupling = on_bodies(coupling, scene.objects, ease, 1.0 / scene.rates.servo, notices)
        touched = touched_device_of(probe.surface_to, devices)
        own = stable_effects(probe, arm, effects, coupling, names, 1.0 / scene.rates.servo, notices)
        recorded = recorded_motion(scene, operator, reader, problems)
        late = relied(probe, devices.get(probe.pose_from), arm)
        found.append(ProbeModel(probe.name, index, probe, operator, coupling, touched, own, recorded, start, late))
    return found


def _writers(
    scene: Scene, devices: Mapping[str, DeviceModel], modalities: list[ModalityModel]
) -> list[tuple[str, Any, str, str]]:
    writers: list[tuple[str, Any, str, str]] = []
    for probe in scene.probes:
        for bound, role in (("force_to", Role.FORCE_ON_OPERATOR), ("surface_to", Role.SURFACE_POSE)):
            device = devices.get(getattr(probe, bound))
            channel = device.command(role) if device is not None else None
            served = (
                m for m in modalities if m.surface_fields and m.surface_fields.probe == probe.name and not m.default_of
            )
            taken = role is Role.SURFACE_POSE and any(served)
            if device is not None and channel is not None and not taken:
                writers.append((f"{device.name}.{channel.name}", probe, bound, f"probe '{probe.name}'"))
    parts = {part.name: part for part in scene.modalities}
    for modality in modalities:
        for command in modality.commands if not modality.default_of else ():  # its probe counts as the writer
            writers.append((command, parts[modality.name].params, "", f"modality '{modality.name}'"))
    return writers


def led(model: Model) -> Iterator[tuple[ProbeModel, DeviceModel]]:
    """Yield the probes whose hand a person leads, each with its arm."""
    for probe in model.probes:
        arm = model.devices[probe.scene.pose_from]
        if arm.twin and arm.cls.input_source in PERSON and probe.operator is not None:
            yield probe, arm


def hand_of(
    scene: Scene, probe: Probe, devices: Mapping[str, DeviceModel], problems: list[Problem]
) -> tuple[Operator | None, Vector]:
    """Return the operator of a probe, and where its hand begins if it has no motion, in the world [m].

    An arm that a person leads needs a hand: if the scene has no operator, one with the defaults is made for the first
    probe on that arm; the other probes are on the same finger.
    """
    operator = next((o for o in scene.operators if o.probe == probe.name), None)
    arm = devices.get(probe.pose_from)
    if arm is None or arm.cls.input_source not in (*PERSON, "recording"):
        return operator, (0.0, 0.0, 0.0)
    if arm.cls.input_source == "recording":
        if operator is not None and (operator.motion.targets or operator.motion.file):
            sentence = f"probe '{probe.name}' follows the recording of '{arm.name}', and its operator has a motion too"
            problems.append(Problem("exclusive", sentence, scene.places.of(operator.motion), "remove one of them"))
        return None, (0.0, 0.0, 0.0)
    start = np.array(getattr(arm.params, "start", (0.0, 0.0, 0.0)), np.float64)
    mine = [other.name for other in scene.probes if other.pose_from == probe.pose_from]
    led = [o.probe for o in scene.operators if o.probe in mine] or mine
    if probe.name != led[0]:
        return operator, (0.0, 0.0, 0.0)
    x, y, z = poses.transform(np.array(arm.mount), start).tolist()
    return operator or Operator(probe=probe.name), (x, y, z)


def large_lengths(scene: Scene) -> Iterator[Problem]:
    """Warn of large lengths of objects without a unit, which are metres: ``size="60 60 20"`` is a box of 60 metres."""
    for element in scene.objects:
        for name in _LENGTHS:
            value = getattr(element, name, None)
            place = scene.places.of(element, name) if scene.places.given(element, name) else None
            if value is None or place is None or not _unitless(place):
                continue
            greatest = max(abs(part) for part in (value if isinstance(value, tuple) else (value,)))
            if greatest > LARGE:
                what = "is at" if name == "pos" else f"has a {name} of"
                sentence = f"object '{element.name}' {what} {greatest:g} m, as no unit is written; is it in mm?"
                advice = f'write {name}="{_written(place)} mm", or m'
                yield Problem("metres", sentence, place, advice, severity="warning")


def _unitless(place: Place) -> bool:
    """Tell whether the attribute at a place has numbers only."""
    text = _written(place)
    return bool(text) and not any(character.isalpha() for character in text.replace("e", "").replace("E", ""))


def _written(place: Place) -> str:
    """Return the text of the attribute's value at a place, or nothing."""
    text: Any = place.text[place.column - 1 : place.column - 1 + place.length]
    return str(text).partition("=")[2].strip().strip("\"'") if "=" in text else str(text).strip("\"'")
