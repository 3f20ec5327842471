"""The modalities of a scene: compiled with what they may know of it, each after the modalities that it refers to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from typing import Any, TypeVar

import numpy as np

from itouch.contact import Geometry
from itouch.plugin import (
    ContactFields,
    Field,
    Modality,
    ParameterError,
    Role,
    SurfaceFields,
    World,
    WorldDevice,
    WorldObject,
    WorldSurface,
)
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.scene.elements import Operator, PluginPart, Probe
from itouch.scene.elements.rates import CLOSE
from itouch.schema import Place, Problem
from itouch.schema.diagnostics import did_you_mean
from itouch.schema.fields import default_of, specs, xml_name
from itouch.schema.plugin_errors import ReturnedError, failing, failure, gathering
from itouch.world.class_queries import texts_of
from itouch.world.presented_surfaces import check_alone, check_carried, check_touched
from itouch.world.rig import DeviceModel, skins_of
from itouch.world.scene_files import SceneFiles
from itouch.world.skin_source import Finger, devices_at
from itouch.world.state_fields import declared_by
from itouch.world.surfaces import contact_of

Declaration = TypeVar("Declaration", SurfaceFields, ContactFields)


@dataclass(frozen=True, slots=True)
class ModalityModel:
    """A modality with its read-only model; it is updated every ``every`` ticks, and may attend to those between."""

    name: str
    plugin: str
    instance: Modality
    model: Any
    every: int
    commands: tuple[str, ...]
    uses_intermediate_ticks: bool = False
    #: The surface that it brings to a finger, if it brings one.
    surface_fields: SurfaceFields | None = None
    #: The contact that it computes in place of the framework's own, if it computes one.
    contact_fields: ContactFields | None = None
    #: The fields of State that it declares, without its name in front.
    declared: tuple[Field, ...] = ()
    #: The probe whose surface it brings by default, because no modality of the scene does; it has no element itself.
    default_of: str = ""
    #: What it says must be known before a run.
    notices: tuple[str, ...] = ()
    #: The parameters that it was made with.
    params: Any = None

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of these fields."""
        return tuple(field.name for field in self.declared)


def build_modalities(
    scene: Scene,
    catalog: Catalog,
    devices: Mapping[str, DeviceModel],
    surfaces: Mapping[str, WorldSurface],
    geometry: Geometry,
    reader: SceneFiles,
    period: float,
    probes: Sequence[Finger],
    problems: list[Problem],
) -> list[ModalityModel]:
    """Return the modalities in the order of their updates; faulty ones are left out, with problems."""
    world = replace(_world(scene, devices, surfaces, reader, period, probes), geometry=geometry)
    rates = dict(scene.rates.modalities)
    found: list[ModalityModel] = []
    idle: set[str] = set()  # those left out because an optional device is missing
    for part in ordered(scene, problems):
        every = _every(scene, part, rates.get(part.name, scene.rates.servo), problems)
        cls = catalog.modality(part.plugin, part.local)
        if cls is None:  # reported while the scene was read
            continue
        known = len(problems)
        if not _has_devices(scene, part, devices, problems):
            idle.update([part.name] if len(problems) > known else [])
            continue
        declared = {one.name: one.declared for one in found}
        if _modalities_of(part) - declared.keys() - idle:  # one could not be made, or reads what this one writes
            continue
        own = replace(world, objects=_objects(scene, part.plugin), period=period * every, fields=declared)
        with gathering(problems):
            found += _compiled(scene, part, cls, own, every, devices, problems)
    problems += check_alone(scene, [(one.name, one.contact_fields) for one in found if one.contact_fields is not None])
    if len(found) + len(idle) == len(scene.modalities):  # else a faulty one may be what brings a surface
        found += _default_carriers(scene, catalog, devices, world, found, problems)
    return found


def _compiled(
    scene: Scene, part: PluginPart, cls: type[Modality], world: World, every: int, devices: Mapping[str, DeviceModel],
    problems: list[Problem], probe: Probe | None = None,
) -> Iterator[ModalityModel]:  # fmt: skip
    """Yield a modality, if it can be compiled; ``probe``: that of a default carrier, which has no element itself."""
    place = scene.places.of(part) if probe is None else scene.places.of(probe, "surface_to")
    who = f"modality '{part.name}'"
    with failing(who, "its making", place):
        instance = cls()
    try:
        model = instance.compile(part.name, part.params, world)
    except ValueError as error:
        field = error.field if isinstance(error, ParameterError) and probe is None else ""
        advice = error.advice if isinstance(error, ParameterError) else ""
        problems.append(Problem("modality", f"{who}: {error}", scene.places.of(part.params, field) or place, advice))
        return
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plugin that exits does not end the program
        problems.append(failure(who, "compile", error, place))
        return
    with failing(who, "commands", place):
        commands = _commands(instance, model)
        unknown = list(_unknown(scene, who, commands, devices, place))
        problems += unknown
    with failing(who, "uses_intermediate_ticks", place):
        intermediate = every > 1 and instance.uses_intermediate_ticks(model)
    with failing(who, "notices", place):
        wanted = "a tuple of sentences is wanted, () if there are none"
        notices = texts_of(instance.notices, instance.notices(model), wanted)
    carries = _declaration("surface_fields", instance.surface_fields, SurfaceFields, model, who, place)
    touches = _declaration("contact_fields", instance.contact_fields, ContactFields, model, who, place)
    if unknown:
        return
    with failing(who, "fields", place):
        declared = declared_by(instance.fields, model)
        fields = {field.name: (_kind(field), field.size) for field in declared}
        if carries is not None:
            problems += check_carried(scene, part, carries, fields, commands, devices, every, instance.probe_attributes)
        if touches is not None:
            problems += check_touched(scene, part, touches, fields, every, carries is not None)
        served = "" if probe is None else probe.name
        yield ModalityModel(
            part.name, part.plugin, instance, model, every, commands, intermediate, carries, touches, declared, served,
            notices, part.params,
        )  # fmt: skip


def _declaration(
    name: str, method: Callable[[Any], Any], kind: type[Declaration], model: Any, who: str, place: Place | None
) -> Declaration | None:
    """Return what a modality declares that it does for a probe, or None.

    Raises
    ------
    SceneError
        If it returns anything else, or something other than names in it.
    """
    with failing(who, name, place):
        told, kinds = method(model), [type(kind._field_defaults.get(field, "")) for field in kind._fields]
        if told is None or (isinstance(told, kind) and all(map(isinstance, told, kinds))):
            return told
        raise ReturnedError(method, f"it returned {told!r:.120}; {kind.__name__} of names is wanted, or None")


def _kind(field: Field) -> str:
    """Return the kind of a field's numbers, such as ``f8``; with the order of bytes if that is not this machine's."""
    kind = np.dtype(field.dtype)
    text: str = kind.str
    return text[1:] if kind.isnative else text


def _commands(instance: Modality, model: Any) -> tuple[str, ...]:
    """Return the command channels that a modality names.

    Raises
    ------
    ReturnedError
        If it returns anything else.
    """
    told: Any = instance.commands(model)
    if isinstance(told, tuple | list | set | frozenset) and all(isinstance(one, str) for one in told):
        return tuple(told)
    wanted = "a tuple of texts such as 'device.channel' is wanted, () if it commands nothing"
    raise ReturnedError(instance.commands, f"it returned {told!r:.40}; {wanted}")


def _unknown(
    scene: Scene, who: str, commands: Sequence[str], devices: Mapping[str, DeviceModel], place: Place | None
) -> Iterator[Problem]:
    """Find commands to channels that are not there: nobody would ever obey them."""
    named = {element.name for element in scene.devices}
    known = [f"{one.name}.{channel.name}" for one in devices.values() for channel in one.commands]
    for command in commands:
        device = command.partition(".")[0]
        if command not in known and (device in devices or device not in named):  # else it is missing itself: told there
            what = f"device '{device}' obeys no such channel" if device in devices else f"there is no device '{device}'"
            advice = did_you_mean(command, known, "obeyed here are")
            yield Problem("missing-channel", f"{who} commands '{command}', and {what}", place, advice)


def _default_carriers(
    scene: Scene, catalog: Catalog, devices: Mapping[str, DeviceModel], world: World, known: Sequence[ModalityModel],
    problems: list[Problem],
) -> list[ModalityModel]:  # fmt: skip
    """Return a default modality for each probe that a surface is to meet and to which no modality brings one.

    It is called ``PROBE.surface``, or ``PROBE.carrier`` where the probe names its plugin: that plugin may be anybody's,
    and its fields may have the names of the framework's own fields of the surface.
    """
    served = {one.surface_fields.probe for one in known if one.surface_fields is not None}
    met = [probe for probe in scene.probes if probe.name in world.surfaces and probe.name not in served]
    # a device that can't bring a surface, or would bring it to itself, has been told of
    alone = [
        probe for probe in met
        if devices[probe.surface_to].command(Role.SURFACE_POSE) is not None and probe.surface_to != probe.pose_from
    ]  # fmt: skip
    found: list[ModalityModel] = []
    for probe in alone:
        plugin, cls = catalog.carrier(probe.carrier)
        place = scene.places.of(probe, "carrier" if probe.carrier else "surface_to")
        name = f"{probe.name}.carrier" if probe.carrier else f"{probe.name}.surface"
        if probe.carrier and probe.carrier not in catalog.carrier_names:
            sentence = f"probe '{probe.name}': nothing called '{probe.carrier}' is installed that brings a surface"
            advice = did_you_mean(probe.carrier, catalog.carrier_names, "the entry-point group 'itouch.carriers' has")
            problems.append(Problem("unknown-plugin", sentence, place, advice))
        elif cls is None:
            why = catalog.failures.get(plugin, "no modality is installed that does")
            sentence = f"nothing brings the surface of '{probe.surface_to}' to probe '{probe.name}': {why}"
            advice = "reinstall itouch-py, or a package that offers one in the entry-point group 'itouch.carriers'"
            problems.append(Problem("plugin-failed", sentence, place, advice))
        elif any(one.name == name for one in known):
            sentence = f"modality '{name}' has the name of what brings the surface of '{probe.surface_to}'"
            problems.append(Problem("modality", sentence, place, "give it another name"))
        elif wanting := _wanting(cls):
            sentence = f"'{plugin}' can't bring a surface to probe '{probe.name}' by the probe's name alone: {wanting}"
            advice = "write the modality's own element, which says it"
            problems.append(Problem("modality", sentence, place, advice))
        else:
            part = PluginPart(plugin, "", cls.Params(probe=probe.name), name)
            with gathering(problems):
                found += _compiled(scene, part, cls, world, 1, devices, problems, probe)
    for one in found:
        if one.surface_fields is None:
            place = scene.places.of(next(probe for probe in alone if probe.name == one.default_of), "carrier")
            sentence = f"modality '{one.name}' of '{one.plugin}' carries no surface"
            problems.append(Problem("modality", sentence, place, "its carries returns None"))
    return found


def _wanting(cls: type[Modality]) -> str:
    """Return what keeps a modality from being made from the name of its probe alone; empty: nothing does."""
    table = specs(cls.Params)
    if "probe" not in table or table["probe"].target != "probe":
        return "it has no attribute 'probe'"
    others = [xml_name(name) for name in table if name != "probe" and default_of(cls.Params, name) is MISSING]
    return f"it also needs '{others[0]}'" if others else ""


def _has_devices(scene: Scene, part: PluginPart, devices: Mapping[str, DeviceModel], problems: list[Problem]) -> bool:
    """Tell whether every device that a modality refers to could be built; only a missing optional one is told here."""
    for name, spec in specs(type(part.params)).items():
        wanted = getattr(part.params, name) if spec.kind == "ref" and spec.target == "device" else ""
        if not wanted or wanted in devices:
            continue
        if any(device.name == wanted and device.optional for device in scene.devices):
            sentence = f"modality '{part.name}' is left out: its device '{wanted}' is missing"
            place = scene.places.of(part.params, name)
            problems.append(Problem("modality", sentence, place, severity="warning"))
        return False
    return True


def _modalities_of(part: PluginPart) -> set[str]:
    """Return the modalities from which a modality takes input."""
    table = specs(type(part.params)).items()
    refs = (getattr(part.params, name) for name, spec in table if spec.kind == "ref" and spec.target == "modality")
    return {name for name in refs if name}


def ordered(scene: Scene, problems: list[Problem]) -> list[PluginPart]:
    """Return the modalities in file order, but each after those from which it takes input."""
    parts = {part.name: part for part in scene.modalities}
    found: list[PluginPart] = []
    for part in scene.modalities:
        _visit(scene, part, parts, found, (), problems)
    return found


def _visit(
    scene: Scene,
    part: PluginPart,
    parts: Mapping[str, PluginPart],
    found: list[PluginPart],
    chain: tuple[str, ...],
    problems: list[Problem],
) -> None:
    if any(part is other for other in found):
        return
    for name, spec in specs(type(part.params)).items():
        wanted = getattr(part.params, name) if spec.kind == "ref" and spec.target == "modality" else ""
        if wanted == part.name or wanted in chain:
            sentence = f"modality '{part.name}' takes its input from '{wanted}', which takes its own from '{part.name}'"
            problems.append(Problem("modality-cycle", sentence, scene.places.of(part.params, name), "break the circle"))
        elif wanted in parts:
            _visit(scene, parts[wanted], parts, found, (*chain, part.name), problems)
    found.append(part)


def _world(
    scene: Scene, devices: Mapping[str, DeviceModel], surfaces: Mapping[str, WorldSurface], reader: SceneFiles,
    period: float, probes: Sequence[Finger],
) -> World:  # fmt: skip
    usual = Operator(probe="x").skin_temperature
    skin = next((operator.skin_temperature for operator in scene.operators), usual)
    return World(
        objects=(),
        devices={
            d.name: WorldDevice(
                d.name, d.plugin, d.params, d.reads, d.commands, d.limits.table(), d.twin, d.wire, d.twin_fields
            )
            for d in devices.values()
        },  # fmt: skip
        probes={probe.name: probe.radius for probe in scene.probes},
        modalities={part.name: part.params for part in scene.modalities},
        period=period,
        ambient=scene.world.temperature,
        skin_temperature=skin,
        servo_period=period,
        read=reader.read,
        surfaces=surfaces,
        near={probe.name: probe.near for probe in scene.probes},
        skins={name: usual if own is None else own for name, own in skins_of(scene).items()},
        at_finger={probe.name: tuple(one.name for one in devices_at(probe, probes, devices)) for probe in probes},
        fingers={part.name: tuple(_probes_of(part.params)) for part in scene.modalities},
    )


def _probes_of(params: Any) -> Iterator[str]:
    """Yield the probes to which parameters refer."""
    for name, spec in specs(type(params)).items():
        if spec.kind == "ref" and spec.target == "probe" and (probe := getattr(params, name)):
            yield probe


def _objects(scene: Scene, plugin: str) -> tuple[WorldObject, ...]:
    found = []
    for index, element in enumerate(scene.objects):
        material = next((m for m in scene.materials if m.name == element.material), None)
        part = next((p.params for p in material.parts if p.plugin == plugin), None) if material else None
        temperature = scene.world.temperature if element.temperature is None else element.temperature
        contact = contact_of(scene, element, [])
        friction = contact.static_friction, contact.dynamic_friction
        found.append(WorldObject(element.name, index, element.material, temperature, part, friction))
    return tuple(found)


def _every(scene: Scene, part: PluginPart, rate: float, problems: list[Problem]) -> int:
    servo = scene.rates.servo
    every = round(servo / rate) if rate <= servo else 0
    if every >= 1 and abs(every * rate - servo) < CLOSE * servo:
        return every
    divisors = [servo / n for n in range(1, 1001)]
    best = min(divisors, key=lambda divisor: abs(divisor - rate))
    sentence = f"the rate of '{part.name}', {rate:.9g} Hz, does not divide the servo rate of {servo:.9g} Hz"
    place = scene.places.of(scene.rates, part.name)
    problems.append(Problem("rate", sentence, place, f"the nearest that does is {best:.9g} Hz"))
    return 1


def notices_of(modalities: Sequence[ModalityModel]) -> list[str]:
    """Return the notices of the modalities before a run."""
    return [f"{m.name}: {notice}" for m in modalities for notice in m.notices]
