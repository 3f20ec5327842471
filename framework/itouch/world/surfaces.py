"""Friction and effects of each object's surface, made from the elements of its material."""

from __future__ import annotations

from typing import Any

from itouch.contact import Friction
from itouch.contact.effects import MAX_LAYERS
from itouch.contact.heightmap import MAX_BYTES, gentle, height_map
from itouch.contact.meshfile import MeshError
from itouch.contact.surface_effects import AXES, Effects, Texture
from itouch.scene import Scene, elements
from itouch.schema import Problem
from itouch.world.scene_files import SceneFiles


def contact_of(scene: Scene, element: Any, problems: list[Problem]) -> elements.ContactMaterial:
    """Return the contact properties of an object's material; a material without any becomes a problem."""
    material = material_of(scene, element)
    if material is not None and material.contact is not None:
        return material.contact
    if material is not None:
        sentence = f"object '{element.name}' can be touched, but its material '{material.name}' has no <contact>"
        advice = 'give the material <contact stiffness="1 N/mm"/>'
        problems.append(Problem("missing-element", sentence, scene.places.of(element, "material"), advice))
    return elements.ContactMaterial(stiffness=1.0)


def material_of(scene: Scene, element: Any) -> elements.Material | None:
    """Return an object's material; None if there is none of that name, which the loader has reported."""
    return next((material for material in scene.materials if material.name == element.material), None)


def build_friction(scene: Scene, problems: list[Problem]) -> list[Friction]:
    """Return friction and shading of each object."""
    contacts = [contact_of(scene, element, problems) for element in scene.objects]
    return [Friction(c.static_friction, c.dynamic_friction, shading=c.shading) for c in contacts]


def build_effects(scene: Scene, reader: SceneFiles, problems: list[Problem], notices: list[str]) -> tuple[Effects, ...]:
    """Return the effects of each object's surface; objects of the same material share them."""
    built: dict[str, Effects] = {}
    for element in scene.objects:
        material = material_of(scene, element)
        if material is not None and material.name not in built:
            built[material.name] = _effects(scene, material, reader, problems, notices)
    return tuple(built.get(element.material, Effects()) for element in scene.objects)


def read_textures(scene: Scene, reader: SceneFiles, problems: list[Problem]) -> None:
    """Read the height maps of all materials that are used, for what is wrong with them."""
    used = {material.name: material for element in scene.objects if (material := material_of(scene, element))}
    for material in used.values():
        _texture(scene, material, reader, problems, [])


def check_effects(scene: Scene, problems: list[Problem]) -> None:
    """Check the effects of all materials that are used, be it by an element with a problem, without making them."""
    used = {element.material for element in scene.objects} | {name for _, name in scene.uncertain.wanted}
    for material in scene.materials:
        if material.name in used:
            _check(scene, material, problems)


def _effects(
    scene: Scene, material: elements.Material, reader: SceneFiles, problems: list[Problem], notices: list[str]
) -> Effects:
    slip, magnet, buzz = material.stick_slip, material.magnetic, material.vibration
    _check(scene, material, problems)
    return Effects(
        texture=_texture(scene, material, reader, problems, notices) if material.texture else None,
        layers=tuple((layer.thickness, layer.stiffness) for layer in material.softness.layers)
        if material.softness
        else (),
        stick_slip=(slip.stiffness, slip.force) if slip else (0.0, 0.0),
        viscosity=material.viscosity.damping if material.viscosity else 0.0,
        magnet=(magnet.force, magnet.range) if magnet else (0.0, 0.0),
        vibration=(buzz.amplitude, buzz.frequency) if buzz else (0.0, 0.0),
        tap=(buzz.tap, buzz.tap_frequency, buzz.tap_decay) if buzz else (0.0, 0.0, 0.0),
    )


def _texture(
    scene: Scene, material: elements.Material, reader: SceneFiles, problems: list[Problem], notices: list[str]
) -> Texture | None:
    """Read a height map; the flanks of a steep one are smoothed, with a notice."""
    texture = material.texture
    if texture is None:
        return None
    try:
        heights = height_map(reader.read(texture.file, MAX_BYTES))
    except MeshError as error:
        problem = Problem(error.code, error.sentence, scene.places.of(texture, "file"), error.advice)
        if error.code == "mesh-too-large":
            problem = Problem("texture", f"'{texture.file}' is larger than {MAX_BYTES >> 20} MiB", problem.place)
        problems.append(problem)
        return None
    except ValueError as error:
        sentence, advice = (
            f"'{texture.file}' is not a height map: {error}",
            "give a PNG, PGM or .npy file of values 0 to 1",
        )
        problems.append(Problem("texture", sentence, scene.places.of(texture, "file"), advice))
        return None
    pitch = texture.width / heights.shape[1]
    smooth, passes = gentle(heights, texture.depth, pitch)
    if passes:
        notices.append(
            f"the texture of material '{material.name}' is steeper than 45 degrees with a depth of "
            f"{texture.depth * 1e3:g} mm: "
            f"smoothed by {passes} passes to {(smooth.max() - smooth.min()) * texture.depth * 1e3:.3g} mm"
        )
    return Texture(smooth, texture.depth, pitch, AXES[texture.projection])


def _check(scene: Scene, material: elements.Material, problems: list[Problem]) -> None:
    """Find vibrations too fast for the loop, magnets that reach beyond a probe's ``near``, and too many layers."""
    buzz, magnet = material.vibration, material.magnetic
    # of a material with a problem there may be layers that could not be read
    fewest = 0 if ("material", material.name) in scene.uncertain.unsound else 1
    if material.softness is not None and not fewest <= len(material.softness.layers) <= MAX_LAYERS:
        sentence = f"<softness> has {len(material.softness.layers)} layers; 1 to {MAX_LAYERS} are possible"
        problems.append(Problem("out-of-range", sentence, scene.places.of(material.softness)))
    if buzz is not None:
        for name, used in (("frequency", buzz.amplitude), ("tap_frequency", buzz.tap)):
            frequency = getattr(buzz, name)
            if used > 0.0 and frequency > scene.rates.servo / 4:
                sentence = f"{frequency:g} Hz is above a quarter of the servo rate of {scene.rates.servo:g} Hz"
                place = scene.places.of(buzz, name)
                problems.append(Problem("out-of-range", sentence, place, "lower it, or raise <rates servo>"))
    if magnet is not None:
        for probe in scene.probes:
            if magnet.range > probe.near:
                reach, near = (f"{length * 1e3:g} mm" for length in (magnet.range, probe.near))
                sentence = (
                    f"the magnet of material '{material.name}' reaches {reach} far, and probe '{probe.name}' looks for "
                    f"objects only up to {near}"
                )
                advice = f'write near="{reach}" in <probe name="{probe.name}">, or a range of {near} at most'
                problems.append(Problem("out-of-range", sentence, scene.places.of(magnet, "range"), advice))
