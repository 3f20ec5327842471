"""Contact events: what happens between a probe and an object, as modalities hear of it."""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class Contact(enum.IntEnum):
    """Kinds of contact event."""

    NEAR = 0
    BEGIN = 1
    MOVE = 2
    END = 3


class ContactEvent(NamedTuple):
    """What happened between a probe and an object in this tick; lengths in m, world frame.

    ``distance`` is the distance between surface and probe (0 in contact), ``speed`` the approach speed along the normal
    [m/s] (> 0: closing), ``tangential_velocity`` the finger's velocity along the surface [m/s], both relative to it;
    ``force`` is the normal force [N], ``area`` the area of contact by Hertz's law [m2]; ``time_to_contact`` [s] is
    infinite unless the finger approaches.
    """

    kind: Contact
    tick: int
    probe: str
    object: str
    object_index: int
    point: Vector
    normal: Vector
    distance: float
    speed: float
    tangential_velocity: Vector
    penetration: float
    force: float
    time_to_contact: float
    area: float = 0.0


class ContactArrays(NamedTuple):
    """The numbers of a `ContactEvent` as compiled code is shown them: arrays that stay, written anew for each event.

    Scalars have shape (1,), vectors (3,); units are the same, lengths in m; ``probe`` is the number of the probe in
    `World.probes`, ``object`` that of the object.
    """

    kind: Numbers
    tick: Numbers
    probe: Numbers
    object: Numbers
    point: Floats
    normal: Floats
    distance: Floats
    speed: Floats
    tangential_velocity: Floats
    penetration: Floats
    force: Floats
    time_to_contact: Floats
    area: Floats

    @classmethod
    def of(cls, event: ContactEvent, probe: int) -> ContactArrays:
        """Return the numbers of an event at the probe with a number."""
        whole = (event.kind, event.tick, probe, event.object_index)
        numbers = (np.array([number], np.int64) for number in whole)
        return cls._make([*numbers, *(np.array(value, np.float64).reshape(-1) for value in event[5:])])
