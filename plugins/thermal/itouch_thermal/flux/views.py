"""What the compiled tick works on: named tuples of views of State, and of constants."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch_thermal.flux.law import Bounds, Fixed

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class Scene(NamedTuple):
    """Views of State fields that are not the modality's, scalars as (1,).

    ``load`` (6,) is the wrench on the plate [N, N m], ``skin`` [K] and ``skin_valid`` are the skin's reading; (0,): it
    is not measured, and so for all that a rig or scene does not have.  ``sent`` and ``command`` are the current [A]
    that was sent last and that is commanded; a driver that holds a temperature is told that instead, and ``actual`` is
    the current [A] that it reports.  ``guess`` is no State: the temperature [K] of a skin that no sensor sees, NaN
    where only Python can tell it.

    ``finger`` (n,) and ``bodies`` (objects, m) are the modes [K] of the modality `heat`, ``resistance`` [K m2/W] and
    ``beside_part`` [1] its contact resistance and the share of the disc on a second object.  Forces are in [N], fluxes,
    also ``heat_desired``, in [W/m2], temperatures in [K], ``tick`` and ``age`` in ticks; ``near_object``, ``below`` and
    ``met`` are indices of objects, -1: none; ``ready`` and ``plate`` are 0 or 1.
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
    beside_part: Floats
    sent: Floats
    actual: Floats
    command: Floats
    guess: Floats


class OwnFields(NamedTuple):
    """Views of the modality's own State fields that all controllers have, scalars as (1,).

    Each has the unit of the field of its name in `FluxControl.fields`.  ``covered`` (n,) are modes [K] of a finger at
    rest, ``account`` (9,) and ``beside`` (7,) sums of the open contact in mixed units, see `onset` and `flux_error`.
    """

    open: Numbers
    touching: Numbers
    object: Numbers
    begun: Numbers
    last_end: Numbers
    slid: Numbers
    fresh: Numbers
    pressing: Numbers
    on_plate: Numbers
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
    account: Floats
    beside: Floats
    integral: Floats
    unready: Numbers


class Course(NamedTuple):
    """Views of the State fields of the controller `model` beside its law's, scalars as (1,).

    ``tracked``, ``came`` and ``reached`` in ticks, ``force_before`` [N], ``scale_before`` [1], ``came_doubt`` [s],
    ``acting`` [A]; ``preview_finger`` (n,) and ``preview_object`` (m,) are modes [K] of the contact that runs ahead,
    and ``preview_index`` is the index of its object, -1: none.
    """

    tracked: Numbers
    force_before: Floats
    scale_before: Floats
    came: Numbers
    came_doubt: Floats
    acting: Floats
    preview_finger: Floats
    preview_object: Floats
    preview_index: Numbers
    reached: Numbers


class Given(NamedTuple):
    """Arrays that never change, for all controllers: what is known of each object, of finger and sensor.

    Of n objects, ``known`` (n,) says whether its heat is, ``starts`` (n,) whether it has start temperatures, ``played``
    (n,) whether it plays a curve; ``start`` (n, 4) has its start temperatures [K] at three skin temperatures, and its
    own temperature [K]; ``bodies`` (n, m) are packed as `contact_heat.packing` says.  The curves' ``times`` [s] and
    ``fluxes`` [W/m2] stand one after the other, those of an object in ``rows`` (n, 2), its begin and end.  ``cover``
    (4, k) is the tissue of a finger at rest, see `display.column`, ``pad`` (4,) as in `observer.seen`.
    """

    bodies: Floats
    known: Numbers
    starts: Numbers
    played: Numbers
    start: Floats
    times: Floats
    fluxes: Floats
    rows: Numbers
    cover: Floats
    pad: Floats


class Models(NamedTuple):
    """Arrays that never change, of the controller `model`: those of its law (``fixed``) and of its preview.

    ``finger`` (m,) is the preview's, packed as `contact_heat.packing` says; ``law`` (l,) are the numbers, in SI units,
    of the law from force to contact resistance of the virtual objects, ``plate`` those of the plate; ``into`` (n, k)
    converts the modes of the model finger to the law's [1], and ``rise`` (n,) is the law's finger at rest per kelvin of
    its skin [1].
    """

    fixed: Fixed
    finger: Floats
    law: Floats
    plate: Floats
    into: Floats
    rise: Floats


class Figures(NamedTuple):
    """Numbers that never change: the law's (``bounds``), sizes in periods, and what is known of skin and room, in SI.

    Of the contact resistance of the virtual objects ``steady``, ``alone`` and ``press`` are known, of that of the plate
    ``plate_steady``, ``expected``, ``on_plate``, ``plate_full`` and ``plate_press``; see `PlateContact`.

    An update stands for ``hold`` servo periods, which are ``update`` [s] together.  ``probe`` is the number of the
    finger, ``first`` how many steps a contact is run ahead in the tick in which it begins.  ``doubts`` says that only
    the readings tell whether a sensor sees the skin, ``estimates`` that the obtained flux is the law's estimate,
    ``wire`` that readings and currents are late, and ``believes`` as in `ModelLaw`.
    """

    bounds: Bounds
    delay: int
    ahead: int
    again: int
    steady: bool
    heat: bool
    expected: float
    on_plate: float
    plate_full: float
    plate_press: float
    plate_steady: bool
    alone: float
    press: float
    period: float
    dew: float
    rest: float
    preset_time: float
    low: float
    high: float
    part: float
    resting: float
    lead: float
    noise: float
    most: float
    hold: int
    update: float
    probe: int
    first: int
    doubts: bool
    estimates: bool
    wire: bool
    believes: bool


class LawInputs(NamedTuple):
    """What has been found for the law, which is no State, each of shape (1,), and ``out`` of (3,).

    ``scale`` [1] is the contact resistance as a multiple of the expected one, ``press`` [1] how strongly the finger is
    being pressed on; ``unclear`` is 1 where the readings are ambiguous, because the finger hovers.  ``hold``, ``wait``
    and ``out`` are a `FutureCurrent`: what becomes of the current that is asked for.  ``alone`` is 1 while Python runs
    the calls, and can do what is between them; ``passes`` is 1 if time is only to pass, see `flux_tick.track`.
    """

    scale: Floats
    press: Floats
    unclear: Numbers
    hold: Numbers
    wait: Numbers
    out: Floats
    alone: Numbers
    passes: Numbers
