"""A compiled tick of the modality `heat`: the model finger on the object that it touches, other objects in air."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact_heat.live import air_step, contact_step, shift_surface, surface_temperature
from contact_heat.resistance import contact_area, resistance_at
from itouch.plugin import Contact as Kind
from itouch.plugin.kernels import kernel, linked
from itouch_thermal.boundary import beyond
from itouch_thermal.laws import press_factor

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: The kinds of event that it hears, as compiled code compares them.
_BEGIN, _END = int(Kind.BEGIN), int(Kind.END)
#: Return value that leaves the tick to Python: a recorded curve is played, or the contact disc lies on two objects.
PYTHON = 1
#: Length of valid infrared readings before a touch that the mean extends over [s]; older readings fade out.
SKIN_WINDOW = 1.0


class Given(NamedTuple):
    """The constants of a scene.

    The model finger; the n objects, packed, one a row; whether each is ``known``, and whether a recorded curve is
    ``played`` for it (n,); the law from force to resistance; contact area at 1 N [m2] and exponent of the force in it
    (2,); time constant of a press and period [s] (2,).
    """

    finger: Floats
    bodies: Floats
    known: Numbers
    played: Numbers
    law: Floats
    area: Floats
    times: Floats


class Skin(NamedTuple):
    """What infrared sees of the skin, each of shape (1,).

    Mean of its difference from the model finger's skin temperature [K], positive if warmer, and its number of ticks;
    the newest reading [K], shape (0,) if there is no sensor, and whether that is valid.
    """

    change: Floats
    seen: Numbers
    reading: Floats
    valid: Floats


class Kept(NamedTuple):
    """The modality's State, scalars as shape (1,).

    Modes of the finger and of the objects (n, widest), and whether each has been touched (n,); the object in contact
    and the ticks since its touch began; the ticks since the touch of the object beside it began, and that object's
    share of the contact disc; then the outputs.
    """

    finger: Floats
    objects: Floats
    touched: Numbers
    object: Numbers
    since: Numbers
    since_beside: Numbers
    beside_part: Floats
    desired: Floats
    resistance: Floats
    contact_area: Floats
    skin_temperature: Floats


class Touch(NamedTuple):
    """What of the State is the touch's, each (1,): when the last one ended [tick], and whether one is open."""

    left_tick: Numbers
    in_contact: Numbers


class Contact(NamedTuple):
    """How the finger touches, each of shape (1,).

    The force on it [N]; the object that begins beside the place of contact (-1: none), and its distance [m].
    """

    felt: Floats
    beside: Numbers
    distance: Floats


_resistance_at, _press_factor, _contact_area = kernel(resistance_at), kernel(press_factor), kernel(contact_area)
_beyond = kernel(beyond)


@linked
def knows(given: Given, index: int) -> bool:
    """Tell whether an object's heat is known; -1 is no object."""
    return bool(index >= 0 and (given.known[index] != 0 or given.played[index] != 0))


@linked
def overlaps(given: Given, kept: Kept, contact: Contact) -> bool:
    """Tell whether a part of the contact disc lies on a second object, and the heat of one of the two is known.

    So it is, too, while the contact still counts as one with the object that lies beside the place of contact.
    """
    force, beside = contact.felt[0], contact.beside[0]
    if not force > 0.0 or beside < 0 or not (knows(given, kept.object[0]) or knows(given, beside)):
        return False
    area = _contact_area(force, given.area[0], given.area[1])
    return bool(beside == kept.object[0] or _beyond(contact.distance[0], area) > 0.0)


@linked
def watch(given: Given, kept: Kept, skin: Skin) -> None:
    """Add a valid infrared reading to the mean of its difference from the model finger.

    The model finger warms up in air as the real one does, so the mean may be as long as its noise requires: behind a
    wire there are few readings in a tenth of a second.
    """
    if skin.reading.shape[0] == 0 or (skin.valid.shape[0] > 0 and skin.valid[0] < 0.5):
        return
    skin.seen[0] += 1
    beside = skin.reading[0] - surface_temperature(given.finger, kept.finger)
    skin.change[0] += (beside - skin.change[0]) / min(float(skin.seen[0]), max(1.0, SKIN_WINDOW / given.times[1]))


@linked
def resist(given: Given, kept: Kept, force: float) -> float:
    """Count a tick of contact; return the contact resistance at its end [K m2/W] under a force [N]."""
    law: Any = given.law
    found = _resistance_at(law, force)
    kept.since[0] += 1
    if given.times[0] > 0.0:
        found *= _press_factor(kept.since[0] * given.times[1], given.times[0])
    return float(found)


@linked
def press_on(given: Given, kept: Kept) -> None:
    """Let the press of a finger that has left the object beside go on: it began with the earlier touch of the two."""
    index = kept.object[0]
    if given.times[0] > 0.0 and index >= 0 and given.played[index] == 0:  # a curve goes on with its own touch
        kept.since[0] = max(kept.since[0], kept.since_beside[0])


@linked
def settle(given: Given, kept: Kept, own: int, force: float, flux: float, resistance: float) -> None:
    """Let the objects that have been touched cool, all but ``own``, and write the outputs of the tick."""
    for other in range(given.known.shape[0]):
        if kept.touched[other] != 0 and given.known[other] != 0 and other != own:
            air_step(given.bodies[other], kept.objects[other])
    kept.desired[0], kept.resistance[0] = flux, resistance
    kept.beside_part[0], kept.since_beside[0] = 0.0, 0
    if force > 0.0:
        kept.contact_area[0] = _contact_area(force, given.area[0], given.area[1])
    kept.skin_temperature[0] = surface_temperature(given.finger, kept.finger)


@kernel
def exchange(given: Given, kept: Kept, skin: Skin, contact: Contact) -> int:
    """Advance the finger, the object that it touches, and every object that has been touched by one period.

    Return `PYTHON` if the tick is left to Python, else 0.
    """
    index = kept.object[0]
    force = contact.felt[0] if index >= 0 else 0.0
    if (index >= 0 and force > 0.0 and given.played[index] != 0) or overlaps(given, kept, contact):
        return PYTHON
    if kept.since_beside[0] > 0:
        press_on(given, kept)
    flux, resistance = 0.0, resist(given, kept, force) if force > 0.0 else math.inf
    own = -1
    if index >= 0 and given.known[index] != 0 and given.played[index] == 0 and math.isfinite(resistance):
        own = index
        flux = contact_step(given.finger, kept.finger, given.bodies[index], kept.objects[index], resistance)
    else:
        air_step(given.finger, kept.finger)
        watch(given, kept, skin)
    settle(given, kept, own, force, flux, resistance)
    return 0


@linked
def start(finger: Floats, kept: Floats, skin: Any) -> None:
    """Bring the model finger to the skin temperature that infrared has measured.

    ``skin`` is a `Skin`, ``finger`` (n,) is packed, ``kept`` (modes,) [K] its modes, as `contact_heat.packing` lays
    them out.
    """
    shift_surface(finger, kept, skin.change[0])
    skin.change[0] = 0.0
    skin.seen[0] = 0


@kernel
def hear(event: Any, given: Given, kept: Kept, skin: Skin, touch: Touch, probe: int) -> int:
    """Begin and end the exchange with an object; ``event`` is a `ContactArrays`, ``probe`` the number of the finger."""
    if event.probe[0] != probe:
        return 0
    kind, tick, index = event.kind[0], event.tick[0], event.object[0]
    if kind == _BEGIN and (given.known[index] != 0 or given.played[index] != 0):
        start(given.finger, kept.finger, skin)
        kept.object[0], touch.in_contact[0] = index, 1
        slides = touch.left_tick[0] == tick
        before = kept.since[0] if slides else 0
        kept.since[0] = kept.since_beside[0] if slides else 0
        kept.since_beside[0] = before
        if slides and kept.beside_part[0] > 0.0:  # the one that was beside is now the one in contact
            kept.beside_part[0] = 1.0 - kept.beside_part[0]
        kept.touched[index] = 1
    elif kind == _END:
        kept.object[0], touch.left_tick[0], touch.in_contact[0] = -1, tick, 0
        kept.contact_area[0] = 0.0
    return 0
