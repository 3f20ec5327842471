"""The desired flux of the time to come: the model finger on the virtual object, simulated ahead of real time.

In every function but `run_ahead`, ``ahead`` is a `PreviewState`, and ``finger`` (n,) and ``below`` (m,) are the modes
[K] of finger and object with which it begins.  ``future`` and ``past`` (size,) are rings of the flux [W/m2], and
``wanted`` (steps,) is the flux [W/m2] at ``offsets`` (steps,) in ticks from now, or a little later.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact_heat import live
from contact_heat.layers import Layer, Side
from contact_heat.modes import layer_modes, side_modes
from itouch.plugin import World, kept
from itouch.plugin.kernels import linked
from itouch_thermal.display.column import REACH, Array, Column, tissue_side
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.onset import SKIN_STEP
from itouch_thermal.flux.start import Touched, Trial, outer_effusivity, start_temperature
from itouch_thermal.heat import FINGER, ROOM_FOR, HeatParams, finger_side, object_side
from itouch_thermal.laws import press_factor

#: How many steps of the preview are computed anew in a tick while the contact resistance changes.
STRIDE = 16
#: Greatest number of steps that the preview advances in a tick while the resistance is constant, or after a gap.
CATCH_UP = 64
#: Shortest servo period [s] at which a touch begins with the whole horizon.  At a shorter one the preview takes no
#: larger share of the first tick, which has enough else to do, and reaches its horizon in the next ticks.
FIRST_PERIOD = 1e-3
#: A desired flux of which only the past is known goes on as it has changed over this time [s] ...
TREND = 0.02
#: ... but by no more than this share of what it is now.
MOST_CHANGE = 0.25

Numbers = NDArray[np.int64]


@linked
def run_ahead(
    finger: Any,
    above: Any,
    body: Any,
    below: Any,
    resistance: float,
    press: float,
    out: Any,
    first: int,
    count: int,
    slid: int,
) -> None:
    """Step the contact ``count`` times; write the flux [W/m2] to the ring buffer ``out`` from index ``first`` on.

    ``finger`` and ``body`` (k,) are packed models, with the units of `contact_heat.packing`; ``above`` (n,) and
    ``below`` (m,) their modes [K]; ``out`` (size,) [W/m2].  Index k is the end of step k of the touch; ``press`` is the
    time constant, in steps, of a resistance that is still falling, 0 if it is not, and ``slid`` how many steps the
    finger had touched other objects before.
    """
    size = out.shape[0]
    for i in range(count):
        now = resistance
        if press > 0.0:
            now = resistance / -math.expm1(-(slid + first + i + 1) / press)
        out[(first + i) % size] = live.contact_step(finger, above, body, below, now)


class PreviewState(NamedTuple):
    """A contact that runs ahead of the touch: finger and object, packed, their modes, and a ring buffer of the flux.

    ``finger`` and ``body`` (k,) as in `contact_heat.packing`; ``above`` (n,) and ``below`` (m,): their modes [K];
    ``future`` (size,): the flux [W/m2]; ``reached`` (1,): up to which tick of the touch it has come; ``slid`` (1,): for
    how many ticks the finger had touched others when it slid to this object.
    """

    finger: Array
    above: Array
    body: Array
    below: Array
    future: Array
    reached: Numbers
    slid: Numbers


@linked
def go_on(ahead: Any, resistance: float, press: float, count: int) -> None:
    """Run ahead by ``count`` more steps; a resistance that is not finite is no contact, and nothing is done.

    ``press`` as in `run_ahead`.
    """
    if math.isfinite(resistance):
        reached = ahead.reached[0]
        run_ahead(
            ahead.finger, ahead.above, ahead.body, ahead.below, resistance, press, ahead.future, reached + 1, count,
            ahead.slid[0],
        )  # fmt: skip
        ahead.reached[0] = reached + count


@linked
def stay(ahead: Any, until: int) -> None:
    """Hold the last flux from where the contact has come up to tick ``until`` of the touch."""
    size, reached = ahead.future.shape[0], ahead.reached[0]
    for k in range(reached + 1, until + 1):
        ahead.future[k % size] = ahead.future[reached % size]


@linked
def begin_at(ahead: Any, finger: Any, below: Any, desired: float, ticks: int) -> None:
    """Begin anew with the modes of finger and object after step ``ticks``, in which the flux was ``desired`` [W/m2]."""
    for i in range(ahead.above.shape[0]):
        ahead.above[i] = finger[i]
    for i in range(ahead.below.shape[0]):
        ahead.below[i] = below[i]
    ahead.future[ticks % ahead.future.shape[0]] = desired
    ahead.reached[0] = ticks


@linked
def begin_ahead(
    ahead: Any, finger: Any, below: Any, desired: float, resistance: float, press: float, ticks: int, first: int,
    horizon: int, shared: bool,
) -> None:  # fmt: skip
    """Begin at step ``ticks`` of the touch as in `begin_at`, run ``first`` steps ahead, and then hold the last flux.

    ``shared`` as in `keep_ahead`.
    """
    begin_at(ahead, finger, below, desired, ticks)
    go_on(ahead, resistance, press, first)
    stay(ahead, ticks + horizon)
    if shared:
        size = ahead.future.shape[0]
        ahead.future[ticks % size] = ahead.future[(ticks + 1) % size]


@linked
def _begin_level(
    ahead: Any, finger: Any, below: Any, desired: float, resistance: float, press: float, ticks: int, steps: int,
    horizon: int,
) -> None:  # fmt: skip
    """Begin anew as in `begin_at`, run ``steps`` ahead, and shift what was found before to where this begins.

    The contact that runs ahead draws another flux than is desired where this is a mean of two objects'.  All of the
    preview must be of one level, or its difference from what is desired would be another one in the next tick.
    """
    size = ahead.future.shape[0]
    here, before = ahead.future[ticks % size], ahead.future[(ticks + 1) % size]
    begin_at(ahead, finger, below, desired, ticks)
    go_on(ahead, resistance, press, steps)
    if ahead.reached[0] == ticks:  # there is no contact to run ahead
        ahead.future[ticks % size] = here
        return
    shift = ahead.future[(ticks + 1) % size] - before
    ahead.future[ticks % size] = here + shift
    for k in range(ahead.reached[0] + 1, ticks + horizon + 1):
        ahead.future[k % size] += shift


def first_steps(horizon: int, period: float) -> int:
    """Return how many steps a contact is run ahead in the tick in which it begins; ``period`` is that of a tick [s]."""
    return min(horizon, math.ceil(horizon * (period / FIRST_PERIOD) ** 2 - 1e-9))


@linked
def keep_ahead(
    ahead: Any, finger: Any, below: Any, desired: float, resistance: float, press: float, ticks: int, horizon: int,
    hold: int, steady: bool, shared: bool,
) -> None:  # fmt: skip
    """Keep the contact a horizon ahead of tick ``ticks`` of the touch.

    Where the resistance is not ``steady`` it begins anew from now whenever it has reached its horizon.  An update,
    every ``hold`` ticks, advances it by a limited number of steps.  ``finger``, ``below`` and ``desired`` are those of
    now, as in `begin_at`.  ``shared``: a part of the contact disc lies on another object, and ``desired`` is a mean.
    """
    reached, wanted = ahead.reached[0], ticks + horizon
    if reached < ticks:  # periods were left out
        begin_at(ahead, finger, below, desired, ticks)
        go_on(ahead, resistance, press, min(horizon, CATCH_UP * hold))
        stay(ahead, wanted)
    elif steady:
        go_on(ahead, resistance, press, min(wanted - reached, CATCH_UP * hold))
    elif reached >= wanted - hold and shared:
        _begin_level(
            ahead, finger, below, desired, resistance, press, ticks, min(horizon, STRIDE * hold), horizon
        )  # fmt: skip
    elif reached >= wanted - hold:
        begin_at(ahead, finger, below, desired, ticks)
        go_on(ahead, resistance, press, min(horizon, STRIDE * hold))
    else:
        go_on(ahead, resistance, press, min(wanted - reached, STRIDE * hold))


@linked
def look_ahead(future: Any, ticks: int, offsets: Any, wait: int, desired: float, wanted: Any) -> None:
    """Fill in the desired flux at ``offsets`` ticks from ``wait`` ticks on; its difference from the preview is kept."""
    size = future.shape[0]
    lift = desired - future[ticks % size]
    for k in range(offsets.shape[0]):
        wanted[k] = future[(ticks + wait + offsets[k]) % size] + lift


@linked
def keep_past(future: Any, ticks: int, desired: float, fresh: bool) -> None:
    """Keep the desired flux of tick ``ticks`` of the touch in the ring ``future``, where there is no preview to keep.

    ``fresh``: the touch begins, and there is no past yet.
    """
    if fresh:
        future[:] = desired
    future[ticks % future.shape[0]] = desired


@linked
def extrapolate(past: Any, ticks: int, offsets: Any, wait: int, wanted: Any, period: float, hold: int) -> None:
    """Fill in the desired flux at ``offsets`` ticks from ``wait`` ticks on, of which only the ``past`` is known.

    It goes on as it has changed over ``TREND``, by at most ``MOST_CHANGE`` of what it is now.  ``hold``: the ticks of
    an update; ``past`` is the ring of `keep_past`.
    """
    size, desired = past.shape[0], past[ticks % past.shape[0]]
    span = min(max(1, round(TREND / (period * hold))), (size - 1) // hold) * hold
    slope = (desired - past[(ticks - span) % size]) / span if span > 0 else 0.0
    most = MOST_CHANGE * abs(desired)
    for k in range(offsets.shape[0]):
        wanted[k] = desired + min(most, max(-most, slope * (wait + offsets[k])))


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """Packed models of the desired contact, the matrix from the model finger's modes to the controller's, and starts.

    The matrix is ``into``; ``starts`` holds per object the start temperatures [K] at three skin temperatures, None
    without a thermal material.
    """

    finger: Array
    bodies: tuple[Array | None, ...]
    widest: int
    resistance: float
    into: Array
    skin: float
    starts: tuple[tuple[float, float, float] | None, ...]


def preview(heat: HeatParams, world: World, law: ModelLaw, press: float) -> Preview:
    """Build the preview of a scene for a controller; ``press`` [s]: the time constant with which a finger is set down.

    It is that of the plate; the virtual objects have their own, and their own contact resistance, in ``heat``.
    """
    trial = Trial(law)
    layers = heat.layers or FINGER
    side = finger_side(layers, heat.arterial, world.skin_of(heat.probe), world.ambient)
    sides = [object_side(o.material, o.temperature, heat.object_depth) for o in world.objects]
    bodies = tuple(None if s is None else live.side_model(s, world.servo_period, finger=False) for s in sides)
    finger = live.side_model(side, world.servo_period, finger=True)
    skins = [world.skin_of(heat.probe) + step for step in (-SKIN_STEP, 0.0, SKIN_STEP)]
    starts: list[tuple[float, float, float] | None] = []
    known: dict[Side, tuple[float, float, float]] = {}
    for body in sides:
        if body is not None and body not in known:
            known[body] = _starts(layers, heat, body, skins, law, trial, press)
        starts.append(None if body is None else known[body])
    widest = max((ROOM_FOR, *(live.state_size(body) for body in bodies if body is not None)))
    into = conversion(side, layers, heat.arterial, world.servo_period)
    return Preview(finger, bodies, widest, heat.expected_resistance, into, world.skin_of(heat.probe), tuple(starts))


def conversion(side: Side, layers: tuple[Layer, ...], core: float, period: float) -> Array:
    """Return the matrix that converts the solver's finger coordinates to those of the controller's column."""
    ours = layer_modes(layers, tissue_side(layers, core, core).back, REACH / 1e-3)
    theirs = side_modes(side, period)
    shape = (len(ours.rates), len(theirs.rates))

    def make() -> Array:
        rows = np.stack([theirs.row(float(depth)) for depth in ours.depths])
        return np.asarray(ours.shapes.T @ (ours.weights[:, None] * rows))

    found = kept(("conversion", side, layers, core, period), make, lambda a: (a,), lambda a: _fits(a, shape))
    found.setflags(write=False)
    return found


def _fits(arrays: tuple[Array, ...], shape: tuple[int, ...]) -> Array:
    if len(arrays) != 1 or arrays[0].shape != shape:
        raise ValueError(f"a stored array should have the shape {shape}")
    return arrays[0]


def _starts(
    layers: tuple[Layer, ...], heat: HeatParams, body: Side, skins: list[float], law: ModelLaw, trial: Trial,
    press: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the start temperatures [K] for three skin temperatures [K]; they are found by trials."""

    def make() -> Array:
        middle = _start(layers, heat, body, skins[1], law, trial, press)
        gap = skins[1] - (body.initial.temperature or 0.0)
        share = 1.0 - (skins[1] - middle) / gap if abs(gap) > SKIN_STEP else 0.5
        low, high = (
            _start(layers, heat, body, skin, law, trial, press, middle + share * (skin - skins[1]))
            for skin in (skins[0], skins[2])
        )
        return np.array([low, middle, high])

    given = (layers, heat, body, skins, law.display, law.given, law.period, law.band.tolist(), law.ceiling, press)
    low, middle, high = kept(("starts", given), make, lambda a: (a,), lambda a: _fits(a, (3,))).tolist()
    return low, middle, high


def _start(
    layers: tuple[Layer, ...], heat: HeatParams, body: Side, skin: float, law: ModelLaw, trial: Trial, press: float,
    near: float | None = None,
) -> float:  # fmt: skip
    side, coarse = finger_side(layers, heat.arterial, skin, skin), law.coarse_ticks
    count = trial.needed * coarse
    flux, warmth = contact_course(side, body, heat.expected_resistance, law.period, count, heat.press)
    every = slice(coarse - 1, None, coarse)
    factor = np.array([press_factor((i + 1) * law.step, press) for i in range(trial.needed)])
    touched = Touched(flux[every], warmth[every], factor, outer_effusivity(body.layers))
    return start_temperature(trial, rising(law.fine, skin), touched, near)


def rising(parts: Column, skin: float) -> Array:
    """Return the coordinates of a finger at rest with a skin temperature [K]."""
    return np.asarray(parts.rise * (skin - parts.rest))


def contact_course(
    side: Side, body: Side, resistance: float, period: float, count: int, press: float = 0.0
) -> tuple[Array, Array]:
    """Return flux [W/m2] and skin temperature [K] at the end of each step of an ideal contact, shape (count,).

    ``press`` is the time constant [s] of the press, 0 for none.
    """
    finger, other = live.side_model(side, period, finger=True), live.side_model(body, period, finger=False)
    above, below = live.initial_state(side, period, finger=True), live.initial_state(body, period, finger=False)
    flux, warmth = np.empty(count), np.empty(count)
    for i in range(count):
        now = resistance * press_factor((i + 1) * period, press)
        flux[i] = live.contact_step(finger, above, other, below, now)
        warmth[i] = live.surface_temperature(finger, above)
    return flux, warmth
