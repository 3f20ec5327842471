"""A tick of the controller `model`, compiled: three calls, of which the first leaves unusual ticks to Python.

``prepare`` determines what the law takes in, ``track`` lets it do so, ``command`` asks it for the next current.
Contact events are heard in between (`contact_events`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from contact_heat.resistance import resistance_at
from itouch.plugin.kernels import kernel
from itouch_thermal.flux import aiming, contact_events, observer, onset
from itouch_thermal.flux import law as laws
from itouch_thermal.flux.contact_events import PYTHON
from itouch_thermal.flux.law import Coming, Memory
from itouch_thermal.flux.masking import masked
from itouch_thermal.flux.preview import Ahead, begin_ahead, keep_ahead, look_ahead
from itouch_thermal.flux.views import Figures, Floats, Given, Own, Scene, Taken
from itouch_thermal.laws import press_factor

#: Least and greatest contact resistance that the force may explain, as multiples of the expected one.
SCALE = (0.02, 50.0)
#: Zero, in the type in which Python passes numbers.  A literal in a kernel has a type of its own, for which every
#: function that it is passed to would be compiled once more.
_NOTHING: Any = np.int64(0)
#: Time constant [s] of the press for which the strength of pressing equals by how much the scale exceeds 1, time
#: constant [s] of the filter that gives the resistance's rate of change, and the strength that is noise.
PRESSING, PRESS_FILTER, STILL = 0.05, 0.02, 0.1
#: Seconds after the start from which the flux error counts, and the least flux [W/m2] it is relative to.
SCORED_FROM, FLOOR = 0.1, 50.0

_resistance_at, _press_factor = kernel(resistance_at), kernel(press_factor)


@kernel
def scale_of(law: Any, force: float, expected: float, time: float, press: float) -> float:
    """Return the contact resistance at a force [N], ``time`` [s] after the start, as a multiple of the expected one."""
    found = _resistance_at(law, force) / expected * _press_factor(time, press)
    return float(min(SCALE[1], max(SCALE[0], found)))


@kernel
def enter(account: Floats, flux: float, desired: float, skin: float, period: float) -> None:
    """Enter one tick into the account (9,): obtained and desired flux [W/m2], skin temperature [K] (NaN: unknown)."""
    ticks, first = account[onset.TICKS], account[onset.SKIN_BEGIN]
    if abs(flux) > abs(account[onset.PEAK]):
        account[onset.PEAK] = flux
    if abs(skin - first) > abs(account[onset.SKIN_EXTREME] - first):
        account[onset.SKIN_EXTREME] = skin
    if ticks * period >= SCORED_FROM:
        error = (flux - desired) / max(abs(desired), FLOOR)
        account[onset.SQUARES] += error * error
        account[onset.SCORED] += 1.0
    account[onset.TICKS] = ticks + 1.0
    account[onset.SUM] += flux


@kernel
def _unusual(scene: Any, own: Any, given: Any, figures: Any) -> bool:
    """Tell whether this tick is left to Python: readings or ticks are missing, or an object's flux is not computed.

    Such an object plays a curve, or nothing is known of its heat.  Where an update stands for several periods, ticks in
    which rendering begins or ends are left to Python, too, and so is a new aim where no sensor sees the skin.
    """
    tick, index = scene.tick[0], own.object[0]
    if own.tracked[0] != tick - figures.hold or scene.age[0] != 0:
        return True
    turns = own.open[0] != 0 and contact_events.turns(scene, own, given, index)
    touched = own.touching[0] != 0
    if turns or own.fresh[0] != 0 or (touched and own.on_plate[0] == 0):
        if figures.hold > 1 or (turns and touched and not figures.sees):
            return True
    elif not touched and own.on_plate[0] != 0:
        return True
    if touched != turns:  # it is rendered in this tick
        begins = turns or own.fresh[0] != 0
        body = index if begins else own.preview_index[0]
        return bool(given.played[index] != 0 or body < 0 or given.known[body] == 0)
    if scene.ready[0] == 0 or figures.sees:
        return False
    near = aiming.coming(scene)
    return bool(near >= 0 and (near != own.approached[0] or tick % figures.again < figures.hold))


@kernel
def prepare(
    scene: Scene, own: Own, given: Given, figures: Figures, memory: Memory, taken: Taken
) -> int:  # fmt: skip
    """Begin and end what the plate renders, note what was obtained, and determine what the law takes in.

    Return PYTHON, with nothing changed, to leave the tick to Python, else 0.
    """
    if _unusual(scene, own, given, figures):
        return PYTHON
    # All are set anew in each tick, as these arrays are not in State.
    taken.scale[0], taken.press[0], taken.part[0], taken.unclear[0] = 1.0, 0.0, 1.0, 0
    if own.open[0] != 0 and contact_events.turns(scene, own, given, own.object[0]):
        if own.touching[0] != 0:
            contact_events.part_from(scene, own, given, figures, memory)
        else:
            contact_events.meet(scene, own)
    if own.touching[0] != 0:
        taken.part[0] = observer.seen(given.fixed.pad, _force(scene))
        taken.unclear[0] = int(not aiming.pressed(scene, figures.heat))
        contact = aiming.in_contact(scene, figures.heat)
        if contact and own.pressing[0] != 0:
            enter(own.account, own.obtained[0], own.desired[0], scene.true_skin[0], figures.update)
        own.obtained[0], own.pressing[0] = scene.true_flux[0], int(contact)
        own.desired[0] = scene.heat_desired[0]
        if not figures.steady:
            scale = _scale(scene, own, given, figures, _NOTHING)
            now = math.log(scale)
            taken.scale[0] = scale
            taken.press[0] = (
                press_anew(own.scale_before, now)
                if own.fresh[0] != 0
                else press_on(own.scale_before, now, figures.part)
            )
    else:
        if scene.ready[0] == 0:
            aiming.aim_for_skin(scene, own, given, figures)
        else:
            aiming.look_near(scene, own, given, figures)
        if own.desired[0] != 0.0:
            own.desired[0] = 0.0
        if scene.plate_temperature[0] < figures.dew:
            own.condensation_time[0] += figures.update
    own.tracked[0] = scene.tick[0]
    return 0


@kernel
def press_on(before: Floats, now: float, part: float) -> float:
    """Return how strongly the finger is being pressed on, by how fast the logarithm of the resistance changes.

    ``now`` is the logarithm of the contact resistance as a multiple of the expected one, without a unit; ``before``
    (1,) is the same filtered, and is moved towards it by the share ``part``.
    """
    followed = before[0] + part * (now - before[0])
    before[0] = followed
    return float(max(0.0, PRESSING / PRESS_FILTER * abs(now - followed) - STILL))


@kernel
def press_anew(before: Floats, now: float) -> float:
    """Return how strongly a finger that has just come is being pressed on.

    ``before`` (1,) is written; it and ``now`` are as in `press_on`, without a unit.
    """
    before[0] = now + PRESS_FILTER / PRESSING
    return float(press_on(before, now, 0.0))


@kernel
def _force(scene: Any) -> float:
    """Return the force on the plate [N], measured or virtual."""
    return float(abs(scene.load[2]) if scene.load.shape[0] > 0 else scene.normal_force[0])


@kernel
def _scale(scene: Any, own: Any, given: Any, figures: Any, later: int) -> float:
    """Return the resistance that the force explains ``later`` periods from now, as a multiple of the expected one."""
    time = (scene.tick[0] - own.begun[0] + later + 1) * figures.period
    return float(scale_of(given.law, _force(scene), figures.expected, time, figures.press))


@kernel
def track(scene: Scene, given: Given, memory: Memory, taken: Taken, size: int, passed: int) -> int:
    """Let the law take in what was sent and read, after ``passed`` periods without readings."""
    memory.memory[observer.M_PART] = taken.part[0]
    for k in range(passed + 1):
        last = k == passed and taken.unclear[0] == 0
        laws._track(  # noqa: SLF001
            given.fixed.fine, memory, size, scene.sent[0], taken.scale[0], taken.press[0],
            scene.heat_flux[0] if last else math.nan, scene.plate_temperature[0] if last else math.nan,
            scene.sink[0] if last else math.nan,
        )  # fmt: skip
    return 0


@kernel
def _look_on(scene: Any, own: Any, given: Any, figures: Any, future: Floats, ticks: int) -> None:
    """Keep the preview a horizon ahead, with the resistance that is expected to last at the felt force."""
    index = own.preview_index[0]
    ahead = Ahead(
        given.finger, own.preview_finger, given.bodies[index], own.preview_object, future, own.reached
    )  # fmt: skip
    resistance = figures.alone if figures.steady else _resistance_at(given.law, scene.felt_force[0])
    press = figures.press / figures.period
    if own.fresh[0] != 0:
        begin_ahead(
            ahead, scene.finger, scene.bodies[index], own.desired[0], resistance, press, ticks, figures.first,
            figures.ahead,
        )  # fmt: skip
    else:
        keep_ahead(
            ahead, scene.finger, scene.bodies[index], own.desired[0], resistance, press, ticks, figures.ahead,
            figures.hold, figures.steady,
        )  # fmt: skip


@kernel
def _set_down(scene: Any, own: Any, given: Any, memory: Any, scale: float) -> None:
    """Set the finger down as of when, by the force, it came: a reading is a period old, and the force had to grow."""
    ago = 0
    if scene.load.shape[0] > 0:
        ago = onset.grown_for(abs(scene.load[2]), own.force_before[0])
    laws._begin(given.fixed, memory, own.flux[0], scale, laws.PRIOR_ONSET)  # noqa: SLF001
    basis = given.fixed.fine
    own.on_plate[0] = 1
    for _ in range(ago):
        observer.advance(
            basis.c, basis.tissue, basis.plate, memory.x, memory.theta, memory.memory, scene.sent[0], scale
        )  # fmt: skip


@kernel
def command(
    scene: Scene, own: Own, given: Given, figures: Figures, memory: Memory, taken: Taken, leaving: Coming
) -> int:  # fmt: skip
    """Command the current [A] by which the law follows the plan, or brings the plate to its start temperature.

    ``leaving`` says what leaves before it; without a wire nothing does.
    """
    touching, ticks = own.touching[0] != 0, scene.tick[0] - own.begun[0]
    comes = own.on_plate[0] == 0 and aiming.pressed(scene, figures.heat)
    if comes or (figures.hold > 1 and scene.ready[0] == 0):
        memory.memory[observer.M_QUIET] = observer.QUIET
    if touching:
        if own.fresh[0] != 0:
            own.preview_index[0] = own.object[0]
            if own.on_plate[0] == 0:
                onset.converted(given.into, scene.finger, memory.x[0])
        _look_on(scene, own, given, figures, memory.future, ticks)
        if comes:
            _set_down(scene, own, given, memory, taken.scale[0])
    if touching and own.on_plate[0] != 0:
        scale = 1.0
        look_ahead(memory.future, ticks, given.fixed.offsets, own.desired[0], memory.wanted)
        if not figures.steady:
            scale = _scale(scene, own, given, figures, figures.delay)
        doubt = memory.cover[observer.RESISTANCE, observer.RESISTANCE]
        current, flux = laws._follow(  # noqa: SLF001
            given.fixed, memory, figures.bounds, leaving, scale, doubt, figures.hold
        )
    else:
        if scene.load.shape[0] > 0:
            own.force_before[0] = abs(scene.load[2])
        current, flux, error = laws._approach(  # noqa: SLF001
            given.fixed.fine, memory, figures.bounds, leaving, own.start_temperature[0], figures.within
        )
        aiming.judge(scene, own, figures, error)
        if not touching:
            current = masked(current, figures.noise, figures.most, scene.tick[0])
    own.fresh[0] = 0
    own.flux[0], scene.command[0] = flux, current
    return 0
