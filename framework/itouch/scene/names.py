"""Names and references: unique where they own State, and every reference has something to refer to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from itouch.scene.description import Scene
from itouch.scene.source import Node
from itouch.schema.diagnostics import Problem, did_you_mean
from itouch.schema.fields import specs, xml_name

_NAMED = ("material", "device", "probe", "box", "sphere", "plane", "capsule", "cylinder", "mesh")


def defined_names(root: Node) -> set[str]:
    """Return the names that a document defines, as written."""
    names = set()
    for section in root.children:
        for node in section.children:
            if "name" in node.attributes and node.tag in _NAMED:
                names.add(node.attributes["name"].value)
            elif section.tag == "interaction" and node.namespace:
                names.add(node.attributes["name"].value if "name" in node.attributes else node.tag)
    return names


def check_names(scene: Scene) -> Iterator[Problem]:
    """Find names that are given twice; materials have a name space of their own."""
    owners = [(o, "object") for o in scene.objects] + [(d, "device") for d in scene.devices]
    owners += [(p, "probe") for p in scene.probes] + [(m, "modality") for m in scene.modalities]
    yield from _duplicates(scene, owners)
    yield from _duplicates(scene, [(m, "material") for m in scene.materials])


def _duplicates(scene: Scene, owners: Iterable[tuple[Any, str]]) -> Iterator[Problem]:
    first: dict[str, tuple[Any, str]] = {}
    for owner, kind in owners:
        if owner.name not in first:
            first[owner.name] = (owner, kind)
            continue
        other, other_kind = first[owner.name]
        place = scene.places.of(other, "name")
        related = ((place, "first defined here"),) if place else ()
        what = f"{kind} '{owner.name}' is defined twice"
        if kind != other_kind:
            what = f"{kind} '{owner.name}' has the name of a {other_kind}"
        advice = "names are unique over objects, devices, probes and modalities" if kind != other_kind else ""
        yield Problem("duplicate-name", what, scene.places.of(owner, "name"), advice, related)


def _targets(scene: Scene) -> dict[str, set[str]]:
    return {
        "material": {m.name for m in scene.materials},
        "device": {d.name for d in scene.devices},
        "probe": {p.name for p in scene.probes},
        "object": {o.name for o in scene.objects},
        "modality": {m.name for m in scene.modalities},
    }


def _referrers(scene: Scene) -> Iterator[Any]:
    yield from scene.objects
    for device in scene.devices:
        yield device.mount
        yield from (part.params for part in device.parts)
    yield from scene.probes
    yield from scene.operators
    yield from (part.params for part in scene.modalities)


def check_references(scene: Scene, told: list[Problem]) -> list[Problem]:
    """Find references to names that do not exist; a target that could not be read is not told twice."""
    targets = _targets(scene)
    problems = []
    broken = any(problem.severity == "error" for problem in told)
    for referrer in _referrers(scene):
        for name, spec in specs(type(referrer)).items():
            value = getattr(referrer, name)
            if spec.kind != "ref" or not value or value in targets[spec.target]:
                continue
            if broken and _was_meant(scene, value, told):
                continue
            advice = did_you_mean(value, targets[spec.target], f"each {spec.target} that there is")
            sentence = f"there is no {spec.target} named '{value}'"
            place = scene.places.of(referrer, name)
            problems.append(Problem("unknown-name", sentence, place, advice or f"define a {spec.target}"))
    problems += _unknown_rates(scene, targets)
    problems += _carrier_cycles(scene)
    return problems


def _was_meant(scene: Scene, name: str, told: list[Problem]) -> bool:
    """Tell whether an element of this name exists but could not be read."""
    return any(problem.place is not None and f'name="{name}"' in problem.place.text for problem in told)


def _unknown_rates(scene: Scene, targets: dict[str, set[str]]) -> list[Problem]:
    problems = []
    for name, _ in scene.rates.modalities:
        if name not in targets["modality"]:
            known = {"servo", *targets["modality"]}
            sentence = f"<rates> has no attribute '{xml_name(name)}': there is no modality of that name"
            place = scene.places.of(scene.rates, name)
            problems.append(Problem("unknown-attribute", sentence, place, did_you_mean(name, known, "known rates are")))
    return problems


def _carrier_cycles(scene: Scene) -> list[Problem]:
    carriers = {device.name: device.mount.on for device in scene.devices}
    problems = []
    for device in scene.devices:
        seen, name = {device.name}, device.mount.on
        while name and name not in seen:
            seen.add(name)
            name = carriers.get(name, "")
        if name == device.name:
            sentence = f"device '{device.name}' is mounted on itself"
            problems.append(Problem("mount-cycle", sentence, scene.places.of(device.mount, "on")))
    return problems
