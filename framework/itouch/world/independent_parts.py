"""The independent parts of a scene with problems: all that neither has one nor needs what has one."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any

from itouch.scene import Scene
from itouch.scene.uncertain_parts import Named
from itouch.schema import Problem
from itouch.schema.fields import specs

#: Where the servo's rate is told, and codes of what may be wrong only because of it.
RATES: Named = ("section", "rates")
_OF_RATES = ("rate", "out-of-range")


def independent_parts(scene: Scene) -> Scene:
    """Return the scene without what has a problem of its own, and without all that needs it, directly or not.

    What is found wrong in the rest is no consequence of what has been told.  A scene without any is returned whole.
    """
    wants = {id(one): _wanted(one) for _, one in _elements(scene)}
    lost = _lost(scene, wants)

    def kept(elements: tuple[Any, ...], kind: str = "") -> tuple[Any, ...]:
        return tuple(one for one in elements if not (wants[id(one)] | _own(kind, one)) & lost)

    if not lost:
        return scene
    world = replace(scene.world, objects=kept(scene.objects, "object"))
    scene.places.succeed(world, scene.world)
    return replace(
        scene, world=world, materials=kept(scene.materials, "material"), devices=kept(scene.devices, "device"),
        probes=kept(scene.probes, "probe"), operators=kept(scene.operators),
        modalities=kept(scene.modalities, "modality"), faults=kept(scene.faults),
    )  # fmt: skip


def _named(scene: Scene) -> set[Named]:
    """Return kind and name of each element that has a name."""
    return {own for kind, one in _elements(scene) for own in _own(kind, one)}


def new(problem: Problem, known: Sequence[Problem], doubtful: Collection[Named]) -> bool:
    """Tell whether a problem is an error, and no consequence of one that is ``known``.

    One in the same line may be. Where the servo's rate is in doubt, so is what depends on it.
    """
    place = problem.place
    if problem.severity != "error" or place is None or (RATES in doubtful and problem.code in _OF_RATES):
        return False
    return all(one.place is None or (one.place.file, one.place.line) != (place.file, place.line) for one in known)


def doubtful_of(scene: Scene, there: Collection[Named]) -> frozenset[Named]:
    """Return kind and name of what is not as it was meant where only what is ``there`` could be compiled."""
    found = {(kind, name) for kind, name in (*scene.uncertain.unsound, *_named(scene)) if kind != "material"}
    if not scene.uncertain.whole and scene.places.of(scene.rates) is None:
        found.add(RATES)
    return frozenset(found - (set(there) - scene.uncertain.unsound))


def _lost(scene: Scene, wants: dict[int, set[Named]]) -> set[Named]:
    """Return what is not there, or not to be counted on, with all that needs it."""
    needing: dict[Named, list[Named]] = {}
    for kind, one in _elements(scene):
        for wanted in wants[id(one)]:
            needing.setdefault(wanted, []).extend(_own(kind, one))
    ahead = [*scene.uncertain.unsound, *(needing.keys() - _named(scene))]
    lost = set(ahead)
    while ahead:
        more = [one for one in needing.get(ahead.pop(), ()) if one not in lost]
        lost.update(more)
        ahead += more
    return lost


def _elements(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Yield the elements of a scene with their kinds; those that have no name are of no kind."""
    kinds: tuple[tuple[str, Collection[Any]], ...] = (
        ("material", scene.materials), ("object", scene.objects), ("device", scene.devices), ("probe", scene.probes),
        ("modality", scene.modalities), ("", scene.operators), ("", scene.faults),
    )  # fmt: skip
    for kind, elements in kinds:
        yield from ((kind, one) for one in elements)


def _own(kind: str, element: Any) -> set[Named]:
    return {(kind, element.name)} if kind else set()


def _wanted(element: Any) -> set[Named]:
    """Return what an element refers to, in itself and in the elements within it."""
    found: set[Named] = set()
    for name, spec in specs(type(element)).items():
        value = getattr(element, name, None)
        if spec.kind == "ref" and value:
            found.add((spec.target, value))
        elif spec.kind in ("child", "children", "plugin") and value is not None:
            for one in value if isinstance(value, tuple) else (value,):
                found |= _wanted(one)
    if hasattr(element, "params"):  # a plugin's element
        found |= _wanted(element.params)
    return found
