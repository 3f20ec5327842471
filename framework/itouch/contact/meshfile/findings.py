"""Findings of a mesh file as sentences: what was repaired, and what may not be as intended, such as its unit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.faults import MeshError, MeshFinding
from itouch.contact.meshfile.repair import MeshFacts

#: Usual extents of what a finger touches [m]; a mesh outside them was probably meant in another unit.
SMALLEST, GREATEST = 1e-3, 10.0
#: Extents below and above which a mesh is refused; the greater is also how far it may reach from its origin [m].
TOO_SMALL, TOO_LARGE = 1e-5, 100.0


def check_size(low: NDArray[np.float64], high: NDArray[np.float64], shown: str) -> None:
    """Refuse a mesh that cannot be meant in metres, given the corners (3,) [m] of its bounding box.

    Raises
    ------
    MeshError
        If it is smaller than TOO_SMALL or larger than TOO_LARGE, or reaches farther than TOO_LARGE from its origin.
    """
    extent, reach = float((high - low).max()), float(np.maximum(-low, high).max())
    if extent > TOO_LARGE or extent < TOO_SMALL:
        allowed = f"{_length(TOO_SMALL)} to {_length(TOO_LARGE)}"
        sentence = f"'{shown}' is {_length(extent)} long; what can be touched is {allowed}"
        raise MeshError("mesh-units", sentence, _units(extent))
    if reach > TOO_LARGE:
        sentence = f"'{shown}' reaches {_length(reach)} from its origin; at most {_length(TOO_LARGE)} is allowed"
        raise MeshError("mesh-units", sentence, "move its origin to its middle, or give a scale")


def findings(facts: MeshFacts, shown: str, *, sides: str | None, scaled: bool = False) -> tuple[MeshFinding, ...]:
    """Return what to tell of a mesh, warnings first.

    Parameters
    ----------
    facts
        Facts of the repaired mesh.
    shown
        The file's name.
    sides
        "one" or "two" if the user said from which sides it is touched; None if not.
    scaled
        Whether the user gave a scale: an unusual size is then intended.
    """
    told = [*_sizes(facts, shown, scaled), *_surface(facts, shown, sides), *_mends(facts, shown)]
    return tuple(sorted(told, key=lambda finding: finding.severity != "warning"))


def _sizes(facts: MeshFacts, shown: str, scaled: bool) -> Iterator[MeshFinding]:
    extent = _extent(facts)
    if not scaled and not SMALLEST <= extent <= GREATEST:
        yield MeshFinding("mesh-units", f"'{shown}' is {_length(extent)} long", _units(extent), "warning")


def _units(extent: float) -> str:
    if extent > GREATEST:
        return 'are these millimetres? use scale="0.001" (or scale="1 mm")'
    return 'was it scaled to metres twice? use scale="1000", or write scale="1" if it is right'


def _extent(facts: MeshFacts) -> float:
    return max(high - low for low, high in zip(facts.low, facts.high, strict=True))


def _length(metres: float) -> str:
    return f"{metres * 1e3:.4g} mm" if metres < 1.0 else f"{metres:.4g} m"


def _surface(facts: MeshFacts, shown: str, sides: str | None) -> Iterator[MeshFinding]:
    if facts.one_sided:
        advice = 'write sides="two"'
        sentence = (
            f"'{shown}' has no front and back: {_many(facts.one_sided, 'pair')} of triangles contradict each other"
        )
        yield MeshFinding("mesh-winding", sentence, advice, "note" if sides == "two" else "warning")
    if facts.open_edges:
        torn = facts.open_length < _extent(facts)  # the border of a sheet is longer than the sheet
        what = "has holes" if torn else "is an open surface"
        how = {"two": "it is touched from both sides", "one": "it is touched from the front only"}
        other = "one" if sides == "two" else "two"
        advice = f'{how[sides or "one"]}; sides="{other}" changes that'
        sentence = f"'{shown}' {what}: {_many(facts.open_edges, 'open edge')} of {facts.edges}"
        yield MeshFinding("mesh-open", sentence, advice, "warning" if sides is None and torn else "note")
    if facts.crowded_edges:
        sentence = f"'{shown}': {_many(facts.crowded_edges, 'edge')} with three triangles or more"
        yield MeshFinding("mesh-crowded-edges", sentence, "its inside may not be where it seems", "warning")
    if facts.overlapping:
        sentence = f"'{shown}': {_many(facts.overlapping, 'pair')} of parts reach into one another"
        yield MeshFinding(
            "mesh-overlap", sentence, "make their union in a modeller; inner walls can be felt", "warning"
        )
    if facts.left_out:
        sentence = f"'{shown}': {_many(facts.left_out, 'list')} of points or lines left out"
        yield MeshFinding("mesh-left-out", sentence)


def _mends(facts: MeshFacts, shown: str) -> Iterator[MeshFinding]:
    if facts.turned_parts:
        sentence = f"'{shown}': {_many(facts.turned_parts, 'closed part')} turned: inside out"
        yield MeshFinding("mesh-inverted", sentence)
    if facts.turned_faces:
        sentence = f"'{shown}': {_many(facts.turned_faces, 'triangle')} turned to agree with the others around"
        yield MeshFinding("mesh-winding", sentence)
    if facts.repeated:
        yield MeshFinding("mesh-repeated", f"'{shown}': {_many(facts.repeated, 'triangle')} given twice removed")
    if facts.collapsed or facts.flat:
        sentence = f"'{shown}': {_many(facts.collapsed + facts.flat, 'triangle')} without area removed"
        yield MeshFinding("mesh-degenerate", sentence)
    if facts.kept_flat:
        sentence = f"'{shown}': {_many(facts.kept_flat, 'triangle')} without area kept, because they close the surface"
        yield MeshFinding("mesh-degenerate", sentence)
    if facts.unused_bad:
        sentence = f"'{shown}': {_many(facts.unused_bad, 'vertex')} that are not finite numbers, unused, removed"
        yield MeshFinding("mesh-not-finite", sentence.replace("vertexs", "vertices"))
    if facts.joined_seams:
        sentence = f"'{shown}': {_many(facts.joined_seams, 'vertex')} along seams joined to others close by"
        yield MeshFinding("mesh-joined", sentence.replace("vertexs", "vertices"))
    if facts.joined_vertices and not shown.lower().endswith(".stl"):  # an STL cannot share vertices
        sentence = f"'{shown}': {_many(facts.joined_vertices, 'vertex')} given more than once joined"
        yield MeshFinding("mesh-joined", sentence.replace("vertexs", "vertices"))


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
