"""Another rig under a scene: its devices replace the scene's, and the limits of the scene still hold.

The tighter of both limits counts.  A section of a rig file that would have no effect is an error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from itouch.scene.documents import Document
from itouch.scene.elements import DeviceElement, Limits, Safety
from itouch.scene.names import Names
from itouch.scene.places import Places
from itouch.schema.diagnostics import Problem, did_you_mean
from itouch.schema.fields import specs
from itouch.schema.units import CELSIUS_OFFSET

Element = TypeVar("Element", Limits, Safety)
#: Sections of a rig file that have an effect; files that it includes are checked by themselves.
_EFFECTIVE = frozenset({"include", "defaults", "devices", "safety"})
#: T4: time [s] of one contact if a scene does not give it: a rig may not ask for more.  It is that of
#: `itouch.monitors.default_limits`, which this room lies below; a test compares the two.
CONTACT_TIME = 10.0


def without_effect(rig: str, documents: Sequence[Document], names: Names) -> Iterator[Problem]:
    """Find the sections of a rig's files that have no effect in a rig, and a rig that brings nothing at all.

    ``names``: those that its files give.
    """
    sections = {tag for document in documents for tag in document.sections}
    if documents and sections <= _EFFECTIVE and "safety" not in sections and not names.of("device"):
        sentence = f"rig '{rig}' has no effect: it brings neither a device nor <safety>"
        advice = "put <device> elements with the names of the scene's devices into its <devices>"
        yield Problem("rig", sentence, documents[-1].root.place, advice)
    for document in documents:
        for tag, node in document.sections.items():
            if tag not in _EFFECTIVE:
                written = "fault" if tag == "faults" else tag
                sentence = f"<{written}> in the rig '{rig}' has no effect: it is not a part of a rig"
                advice = "a rig file holds <devices>, <safety>, <defaults> and includes; move the rest into the scene"
                yield Problem("rig", sentence, node.place, advice)


def unmatched(
    rig: str, names: Names, others: Names, *, whole: bool = True, others_whole: bool = True
) -> Iterator[Problem]:
    """Find devices that only one of scene and rig has, by the names that their files give.

    A device with a fault of its own still has its name.  ``whole``, ``others_whole``: whether all files of the scene,
    and of the rig, could be read; of what the others may have, nothing is said, nor of devices whose names could not be
    read.
    """
    own, brought = names.of("device"), others.of("device")
    whole = whole and not any(entry.kind == "device" for entry in names.nameless)
    others_whole = others_whole and not any(entry.kind == "device" for entry in others.nameless)
    wanted, offered = {entry.name for entry in own}, {entry.name for entry in brought}
    for entry in own if others_whole else ():
        if entry.name not in offered and brought:
            advice = did_you_mean(entry.name, offered, "the rig's devices are")
            yield Problem("rig", f"rig '{rig}' has no device named '{entry.name}'", entry.place, advice)
    for entry in brought if whole else ():
        if entry.name not in wanted:
            sentence = f"the scene has no device named '{entry.name}', which the rig brings"
            advice = did_you_mean(entry.name, wanted, "the scene's devices are")
            yield Problem("rig", sentence, entry.place, advice)


def limited(device: DeviceElement, own: DeviceElement | None, places: Places) -> DeviceElement:
    """Return a rig's device with the limits of scene and rig together."""
    if own is None or own.limits == Limits():
        return device
    found = replace(device, limits=_merged(own.limits, device.limits, places))
    places.succeed(found, device)
    return found


def tightened(own: Safety, other: Safety, places: Places) -> Safety:
    """Return the ``<safety>`` of scene and rig together."""
    found = _merged(own, other, places)
    ramps = [ramp for ramp in (own.ramp, other.ramp) if ramp is not None]
    stops = "stop" if "stop" in (own.servo_overrun, other.servo_overrun) else own.servo_overrun
    whole = replace(found, ramp=max(ramps, default=None), hold_to_run=own.hold_to_run or other.hold_to_run,
                    servo_overrun=stops, participant=own.participant or other.participant)  # fmt: skip
    places.succeed(whole, found)
    return whole


def looser(own: Safety, other: Safety, places: Places) -> Iterator[Problem]:
    """Find what is looser in a rig's ``<safety>`` than in the scene's: the contact time, of which 10 s is the default.

    A rig may not name another participant either: nothing would be recorded for one of the two.
    """
    most = CONTACT_TIME if own.contact_time is None else own.contact_time
    if other.contact_time is not None and other.contact_time > most:
        sentence = f"<safety contact-time> of the rig asks for {other.contact_time:g} s, the scene for {most:g} s"
        place = places.of(other, "contact_time")
        yield Problem("loosened-limit", sentence, place, "a rig may tighten limits, never loosen; say it in the scene")
    if own.participant and other.participant not in ("", own.participant):
        sentence = f"<safety participant> of the rig is '{other.participant}', that of the scene '{own.participant}'"
        place = places.of(other, "participant")
        yield Problem("loosened-limit", sentence, place, "say in one of the two who takes part")


def apart(own: Limits | Safety, other: Limits | Safety, who: str, places: Places) -> Iterator[Problem]:
    """Find bands of temperature of scene and rig that have nothing in common; ``who``: what they are of."""
    mine, theirs = own.temperature, other.temperature
    if mine is None or theirs is None or mine[0] >= mine[1] or theirs[0] >= theirs[1]:
        return  # an end that is not below the other one is told by itself
    if max(mine[0], theirs[0]) >= min(mine[1], theirs[1]):
        bands = [f"{low - CELSIUS_OFFSET:.4g} to {high - CELSIUS_OFFSET:.4g} degC" for low, high in (mine, theirs)]
        sentence = f"{who}: the scene allows {bands[0]} and the rig {bands[1]}, and no temperature is within both"
        place = places.of(own, "temperature")
        related = ((place, "the scene's"),) if place else ()
        yield Problem("rig", sentence, places.of(other, "temperature"), "let the rig's overlap the scene's", related)


def _merged(own: Element, other: Element, places: Places) -> Element:
    """Return the tighter of two elements, limit by limit; each limit keeps the place where it was written."""
    values: dict[str, Any] = {}
    spots = {}
    for name, spec in specs(type(own)).items():
        if spec.kind not in ("quantity", "temperature"):
            continue
        mine, theirs = getattr(own, name), getattr(other, name)
        value = _tighter(mine, theirs)
        values[name] = value
        said = next((one for one in (other, own) if getattr(one, name) == value), own)
        if value is not None and (spot := places.of(said, name)) is not None:
            spots[name] = spot
    found = replace(own, **values)
    if (place := places.of(other) or places.of(own)) is not None:
        places.put(found, place, spots)
    return found


def _tighter(first: Any, second: Any) -> Any:
    if first is None or second is None:
        return second if first is None else first
    if isinstance(first, tuple):
        low, high = max(first[0], second[0]), min(first[1], second[1])
        return (low, high) if low < high else first  # if they have nothing in common, that is told of both
    return min(first, second)
