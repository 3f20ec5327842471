"""What the compiled tick of the controller `model` works on: named tuples of views of State, and of constants."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch_thermal.flux.law import Bounds, Fixed

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class Scene(NamedTuple):
    """Views of State fields that are not the modality's, scalars as (1,).

    ``load`` is the wrench on the plate, ``skin`` and ``skin_valid`` are the skin's reading; (0,): it is not measured.
    """

    tick: Numbers
    ready: Numbers
    near_object: Numbers
    below: Numbers
    met: Numbers
    plate: Numbers
    normal_force: Floats
    felt_force: Floats
    load: Floats
    age: Numbers
    heat_flux: Floats
    plate_temperature: Floats
    sink: Floats
    skin: Floats
    skin_valid: Floats
    true_flux: Floats
    true_skin: Floats
    heat_desired: Floats
    resistance: Floats
    finger: Floats
    bodies: Floats
    sent: Floats
    command: Floats


class Own(NamedTuple):
    """Views of the modality's own State fields, scalars as (1,)."""

    open: Numbers
    touching: Numbers
    object: Numbers
    begun: Numbers
    fresh: Numbers
    pressing: Numbers
    on_plate: Numbers
    tracked: Numbers
    approached: Numbers
    calm: Floats
    looked: Floats
    covered: Floats
    start_temperature: Floats
    plate_limited: Numbers
    preset_begun: Numbers
    readiness: Floats
    plate_ready: Numbers
    desired: Floats
    obtained: Floats
    flux: Floats
    condensation_time: Floats
    force_before: Floats
    scale_before: Floats
    account: Floats
    beside: Floats
    integral: Floats
    unready: Numbers
    preview_finger: Floats
    preview_object: Floats
    preview_index: Numbers
    reached: Numbers


class Given(NamedTuple):
    """Arrays that never change: those of the law (``fixed``) and of the preview, and what is known of each object.

    Per object, ``known`` says whether its heat is, ``starts`` whether it has start temperatures, ``played`` whether it
    plays a curve; ``start`` has its start temperatures [K] at three skin temperatures, and its own temperature [K].
    """

    fixed: Fixed
    finger: Floats
    bodies: Floats
    known: Numbers
    starts: Numbers
    played: Numbers
    law: Floats
    cover: Floats
    into: Floats
    start: Floats


class Figures(NamedTuple):
    """Numbers that never change: the law's (``bounds``), sizes in periods, and what is known of skin and room, in SI.

    An update stands for ``hold`` servo periods, which are ``update`` [s] together.  ``probe`` is the number of the
    finger, ``first`` how many steps a contact is run ahead in the tick in which it begins, and ``sees`` says whether
    the skin's temperature is read.
    """

    bounds: Bounds
    delay: int
    ahead: int
    again: int
    steady: bool
    heat: bool
    expected: float
    alone: float
    press: float
    period: float
    dew: float
    rest: float
    preset_time: float
    low: float
    high: float
    within: float
    part: float
    resting: float
    lead: float
    noise: float
    most: float
    hold: int
    update: float
    probe: int
    first: int
    sees: bool


class Taken(NamedTuple):
    """What ``prepare`` has found for the law, each of shape (1,).

    ``scale`` is the contact resistance as a multiple of the expected one, ``press`` how strongly the finger is being
    pressed on, ``part`` the part of the sensor that the finger covers; ``unclear`` is 1 where the readings are
    ambiguous, because the finger hovers.
    """

    scale: Floats
    press: Floats
    part: Floats
    unclear: Numbers
