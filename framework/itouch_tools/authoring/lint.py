"""Finds what is legal in a scene, but odd, with its line and what to do; ``check`` looks for it, ``run`` does not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Role
from itouch.scene.elements import Operator, Plane
from itouch.schema import Problem
from itouch.world.bindings import extent
from itouch.world.model import Model, ProbeModel
from itouch.world.overlap import overlapping
from itouch.world.surfaces import contact_of

Points = NDArray[np.float64]

#: Distance [m] between the points of a scripted path that are examined.
STEP = 2e-3
#: Heights that differ by less than this [m] count as equal.
FLAT = 5e-4
#: Longest tick [s] of a loop in which no change between arm and plate steps by more than 0.1 N (``bench surface``).
SLOWEST = 1.0001e-3
#: How near to its trip [K] a plate can't rest: its monitor extrapolates noisy readings, and trips at the limit itself.
AT_REST = 0.1


def odd(model: Model) -> Iterator[Problem]:
    """Yield a note for each oddity of a compiled scene."""
    boxes = _boxes(model)
    yield from _overlaps(model, boxes)
    yield from _clipped(model)
    yield from _outside_band(model)
    yield from _trips_at_rest(model)
    yield from _slow(model)
    if not model.moving:
        for probe in model.probes:
            yield from _touches(model, probe, boxes)


def _boxes(model: Model) -> dict[str, Any]:
    """Return the lower and upper corner (3,) [m] of each mesh's bounding box in its own frame, by object."""
    found = {}
    for name, shape in zip(model.objects, model.shapes, strict=True):
        surface = getattr(shape, "surface", None)
        if surface is not None:
            vertices = np.asarray(surface.vertices)
            found[name] = (vertices.min(0), vertices.max(0))
    return found


def _overlaps(model: Model, boxes: dict[str, Any]) -> Iterator[Problem]:
    places = model.scene.places
    for one, other, sentence in overlapping(model.scene, boxes):
        first = places.of(one)
        related = ((first, "the other"),) if first is not None else ()
        yield Problem("overlap", sentence, places.of(other), "move one of them, or make it smaller", related, "note")


def _clipped(model: Model) -> Iterator[Problem]:
    """Find materials that are rendered softer than they state."""
    told = set()
    for probe in model.probes:
        for element, coupling in zip(model.scene.objects, probe.coupling, strict=True):
            contact = contact_of(model.scene, element, [])
            if coupling.stiffness < contact.stiffness * (1.0 - 1e-9) and element.material not in told:
                told.add(element.material)
                arm = probe.scene.force_to
                sentence = (
                    f"material '{element.material}' has a stiffness of {contact.stiffness / 1e3:g} N/mm; "
                    f"'{probe.name}' feels {coupling.stiffness / 1e3:.3g} N/mm, the most that '{arm}' renders stably"
                )
                advice = f'write stiffness="{np.floor(coupling.stiffness / 10.0) / 100.0:g} N/mm", or lower the damping'
                yield Problem("clipped-stiffness", sentence, model.scene.places.of(contact, "stiffness"), advice,
                              severity="note")  # fmt: skip


def _slow(model: Model) -> Iterator[Problem]:
    """Find a loop in which more happens between two ticks than a change of hands between arm and plate bears."""
    probe = next((probe for probe in model.probes if probe.scene.surface_to), None)
    if probe is None or model.period <= SLOWEST:
        return
    sentence = (
        f"the loop of {1.0 / model.period:g} Hz is slow for the plate of '{probe.scene.surface_to}': where a contact "
        "passes between arm and plate, the force steps by more than 0.1 N in a tick"
    )
    place = model.scene.places.of(model.scene.rates, "servo")
    yield Problem("slow-servo", sentence, place, 'write servo="1 kHz" or more', severity="note")


def _outside_band(model: Model) -> Iterator[Problem]:
    """Find objects whose temperature is outside the limits of a plate under the fingers."""
    for device in model.devices.values():
        band = device.limits.temperature
        if device.reading(Role.SKIN_CONTACT_TEMPERATURE) is None or band is None:
            continue
        low, high = band
        for element in model.scene.objects:
            kelvin = model.scene.world.temperature if element.temperature is None else element.temperature
            if low - 1e-6 <= kelvin <= high + 1e-6:
                continue
            sentence = (
                f"object '{element.name}' is at {kelvin - 273.15:.4g} degC, but '{device.name}' stays within "
                f"{low - 273.15:.4g} to {high - 273.15:.4g} degC: the rest of the difference is not felt"
            )
            place = model.scene.places.of(element, "temperature")
            advice = "give it a temperature within this range, or take the difference into account"
            yield Problem("out-of-band", sentence, place, advice, severity="note")


def _trips_at_rest(model: Model) -> Iterator[Problem]:
    """Find plates that begin at a room temperature at or next to which they trip: such a scene stops as it begins."""
    room = model.scene.world.temperature
    for device in model.devices.values():
        if device.reading(Role.SKIN_CONTACT_TEMPERATURE) is None or device.limits.temperature is None:
            continue
        low, high = device.limits.temperature_trip
        if low + AT_REST <= room <= high - AT_REST:
            continue
        sentence = (
            f"the room is at {room - 273.15:.4g} degC, and '{device.name}', which begins at that temperature, trips "
            f"at {low - 273.15:.4g} and at {high - 273.15:.4g} degC: the session would stop at once, or by the least "
            "noise of its sensor"
        )
        place = model.scene.places.of(model.scene.world, "temperature") or device.place
        advice = "write a room temperature between these, or allow the plate the temperature of the room"
        yield Problem("out-of-band", sentence, place, advice, severity="warning")


def _touches(model: Model, probe: ProbeModel, boxes: dict[str, Any]) -> Iterator[Problem]:
    """Find an operator that never touches anything, and fingers that rest on two heights."""
    operator, radius = probe.operator, probe.scene.radius
    if operator is None or not operator.motion.targets or probe.recorded is not None or not model.objects:
        return
    if any(isinstance(element, Plane) for element in model.scene.objects):
        return
    path, ends = _path(operator)
    found = [(element, box) for element in model.scene.objects if (box := extent(element, boxes)) is not None]
    near = [(element, low, high, _distance(path, low, high)) for element, (low, high) in found]
    if near and all(distance.min() > radius for *_, distance in near):
        element, _, _, distance = min(near, key=lambda one: float(one[3].min()))
        gap = float(distance.min()) - radius
        sentence = (
            f"the operator of '{probe.name}' never touches anything: it comes within {gap * 1e3:.3g} mm of "
            f"'{element.name}'"
        )
        advice = "lower a <to> of its motion below the top of an object, plus the radius of the finger"
        yield Problem("untouched", sentence, model.scene.places.of(operator), advice, severity="note")
    if probe.scene.surface_to:
        yield from _two_heights(model, probe, near, ends)


def _two_heights(model: Model, probe: ProbeModel, near: list[Any], ends: Points) -> Iterator[Problem]:
    """Find places where the finger rests over the tops of two objects: the flat plate can have only one height."""
    operator, radius = probe.operator, probe.scene.radius
    for key, end in zip(operator.motion.targets if operator else (), ends, strict=True):
        tops = [(float(high[2]), element) for element, low, high, _ in near if _aside(end, low, high) < 0.5 * radius]
        tops.sort(key=lambda one: -one[0])
        if len(tops) < 2 or end[2] - radius > tops[0][0] or not FLAT < tops[0][0] - tops[1][0] < radius:
            continue
        (first, one), (second, other) = tops[:2]
        sentence = (
            f"'{probe.name}' rests over '{one.name}' and '{other.name}', whose tops are at {first * 1e3:.4g} and "
            f"{second * 1e3:.4g} mm: the plate under it has only one height"
        )
        place = model.scene.places.of(key, "pos")
        yield Problem("two-heights", sentence, place, "move it over one of them, or level them", severity="note")


def _path(operator: Operator) -> tuple[Points, Points]:
    """Return points (n, 3) along the straight lines between an operator's targets, and the targets (m, 3)."""
    ends = np.array([key.pos for key in operator.motion.targets], np.float64)
    pieces = [ends[:1]]
    for start, end in zip(ends[:-1], ends[1:], strict=True):
        count = min(2000, max(2, int(np.linalg.norm(end - start) / STEP) + 1))
        pieces.append(start + np.linspace(0.0, 1.0, count)[1:, None] * (end - start))
    return np.vstack(pieces), ends


def _distance(points: Points, low: Any, high: Any) -> Points:
    """Return the distance (n,) [m] of points (n, 3) from a box with these corners (3,); 0 inside."""
    outside = np.maximum(np.maximum(low - points, points - high), 0.0)
    return np.asarray(np.linalg.norm(outside, axis=1), np.float64)


def _aside(point: Points, low: Any, high: Any) -> float:
    """Return the horizontal distance [m] of a point (3,) from a box with these corners (3,); 0 above or below it."""
    return float(np.linalg.norm(np.maximum(np.maximum(low[:2] - point[:2], point[:2] - high[:2]), 0.0)))
