"""Modalities that compute the contact of a probe themselves: whether what they declare of it can be."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from itouch.contact import layout
from itouch.plugin import Touches
from itouch.scene import Scene
from itouch.scene.elements import PluginPart
from itouch.schema import Problem
from itouch.schema.diagnostics import did_you_mean


def _fields_of(count: int) -> tuple[object, ...]:
    """Return the kinds and sizes of a field that holds so many numbers."""
    return ("f8", count), ("f8", (count,)), ("f8", 0 if count == 1 else count)


def check_touched(
    scene: Scene, part: PluginPart, touches: Touches, fields: Mapping[str, object], every: int, carries: bool
) -> Iterator[Problem]:
    """Find what keeps a modality from computing the contact that it says it computes.

    ``fields``: kinds and sizes; ``every``: in one of how many ticks it is updated; ``carries``: it also says that it
    brings a surface.
    """
    who, place = f"modality '{part.name}'", scene.places.of(part)
    names = [probe.name for probe in scene.probes]
    if touches.probe not in names:
        sentence = f"{who} computes the contact of probe '{touches.probe}', but there is no such probe"
        yield Problem("modality", sentence, place, did_you_mean(touches.probe, names, "the probes are"))
        return
    if not touches.found and not all(touches[1:5]):
        lacks = ", ".join(name for name, field in zip(touches._fields[1:5], touches[1:5], strict=True) if not field)
        sentence = f"{who} computes a contact and names no field for: {lacks}"
        yield Problem("modality", sentence, place, "its touches names those, or found")
    if touches.found and (also := [name for name in touches[1:6] if name]):
        sentence = f"{who} says what it touches twice: in field '{touches.found}', and in {', '.join(also)}"
        yield Problem("modality", sentence, place, "its touches names object, force, normal and point, or else found")
    sizes = {"object": 1, "found": layout.RESULT_SIZE}
    for kind, name in zip(touches._fields[1:7], touches[1:7], strict=True):
        if name and fields.get(name) not in _fields_of(count := sizes.get(kind, 3)):
            what = f"{count} number{'s' if count > 1 else ''} (f8)"
            sentence = f"{who} says what it touches in field '{name}', which it does not declare as {what}"
            yield Problem("modality", sentence, place, f"it declares {', '.join(fields) or 'none'}")
    if every != 1:
        sentence = f"{who} computes a contact, which changes in every tick, but is updated in one of {every}"
        yield Problem("modality", sentence, place, "leave its rate out of <rates>")
    if carries:
        sentence = f"{who} computes a contact and brings a surface, which happens at different times in a tick"
        yield Problem("modality", sentence, place, "its author makes it two modalities")


def check_alone(scene: Scene, known: Iterable[tuple[str, Touches]]) -> Iterator[Problem]:
    """Find probes whose contact two modalities compute; ``known``: modalities by name, with their declarations."""
    first: dict[str, str] = {}
    for name, touches in known:
        other = first.setdefault(touches.probe, name)
        if other != name:
            sentence = f"modalities '{other}' and '{name}' both compute the contact of probe '{touches.probe}'"
            part = next(part for part in scene.modalities if part.name == name)
            yield Problem("modality", sentence, scene.places.of(part), "remove one of them")
