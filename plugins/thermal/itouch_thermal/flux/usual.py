"""A tick of the controller `model`, compiled: three calls, of which the first leaves unusual ticks to Python.

``prepare`` determines what the law takes in, ``track`` lets it do so, ``command`` asks it for the next current.
``hear`` is called with contact events.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact_heat.resistance import resistance_at
from itouch.plugin import Contact
from itouch.plugin.kernels import kernel
from itouch_thermal.display.column import F_BEGIN, F_DECAY, F_END, F_PORT
from itouch_thermal.flux import law as laws
from itouch_thermal.flux import observer, onset
from itouch_thermal.flux.masking import masked
from itouch_thermal.flux.preview import Ahead, begin_ahead, keep_ahead, look_ahead
from itouch_thermal.flux.start import MARGIN
from itouch_thermal.laws import press_factor

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Code that leaves the tick or event to Python.
PYTHON = 1
#: The kinds of event that are heard, as numbers for compiled code.
_NEAR, _BEGIN, _END = int(Contact.NEAR), int(Contact.BEGIN), int(Contact.END)
#: Force [N] on the plate above which a finger is on it.
TOUCHED = 0.03
#: Over how long the infrared readings of the skin are averaged while the rig is calibrated [s], and the greatest flux
#: [W/m2] that the plate then takes from the finger in place of the air: without it, covered skin warms up.
AVERAGED, DRAWN = 1.0, 45.0
#: The plate is ready within this of its start temperature [K].
READY = 0.1
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


class Memory(NamedTuple):
    """Views of the law's State fields; see `ModelLaw`."""

    x: Floats
    theta: Floats
    cover: Floats
    gain: Floats
    memory: Floats
    line: Floats
    slots: Floats
    wanted: Floats
    response: Floats
    knots: Floats
    work: Floats
    trace: Floats
    span: Floats
    past: Floats
    kept: Floats
    future: Floats
    single: Floats
    queue: Floats


class Given(NamedTuple):
    """Arrays that never change: constants of law and preview, and what is known of each object.

    Per object, ``known`` says whether its heat is, ``starts`` whether it has start temperatures, ``played`` whether it
    plays a curve; ``start`` has its start temperatures [K] at three skin temperatures, and its own temperature [K].
    """

    c: Floats
    tissue: Floats
    plate: Floats
    far_tissue: Floats
    far_plate: Floats
    hats: Floats
    band: Floats
    offsets: Numbers
    finger: Floats
    bodies: Floats
    known: Numbers
    starts: Numbers
    played: Numbers
    law: Floats
    cover: Floats
    pad: Floats
    prior: Floats
    into: Floats
    start: Floats


class Figures(NamedTuple):
    """Numbers that never change: sizes in periods, limits, and what is known of skin and room, in SI.

    An update stands for ``hold`` servo periods, which are ``update`` [s] together.  ``probe`` is the number of the
    finger, ``first`` how many steps a contact is run ahead in the tick in which it begins, and ``sees`` says whether
    the skin's temperature is read.
    """

    size: int
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
    flux_limit: float
    ceiling: float
    capacity: float
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


@kernel
def pressed(scene: Any, heat: bool) -> bool:
    """Tell whether the finger is on the plate: by the measured force, else as the virtual contact says."""
    if scene.load.shape[0] > 0:
        return bool(abs(scene.load[2]) > TOUCHED)
    return bool(in_contact(scene, heat))


@kernel
def in_contact(scene: Any, heat: bool) -> bool:
    """Tell whether the finger presses on a virtual object now."""
    return math.isfinite(scene.resistance[0]) if heat else bool(scene.normal_force[0] > 0.0)


@kernel
def scale_of(law: Any, force: float, expected: float, time: float, press: float) -> float:
    """Return the contact resistance at a force [N], ``time`` [s] after the start, as a multiple of the expected one."""
    found = _resistance_at(law, force) / expected * _press_factor(time, press)
    return float(min(SCALE[1], max(SCALE[0], found)))


@kernel
def judged(error: float, passed: float) -> float:
    """Return the readiness, 0 to 1, of a plate that differs from its start temperature by an error [K].

    ``passed`` is the share that is over of the time that every approach takes, and is the readiness until it is 1; 1 or
    more if no such time is set.
    """
    return max(0.0, passed) if passed < 1.0 else max(0.0, min(1.0, 2.0 - abs(error) / READY))


@kernel
def enter(account: Floats, flux: float, desired: float, skin: float, period: float) -> None:
    """Enter one tick into the account (9,): obtained and desired flux [W/m2], skin temperature [K] (NaN: unknown)."""
    ticks, first = account[2], account[5]
    if abs(flux) > abs(account[4]):
        account[4] = flux
    if abs(skin - first) > abs(account[6] - first):
        account[6] = skin
    if ticks * period >= SCORED_FROM:
        error = (flux - desired) / max(abs(desired), FLOOR)
        account[7] += error * error
        account[8] += 1.0
    account[2] = ticks + 1.0
    account[3] += flux


@kernel
def _equal(scene: Any, own: Any, given: Any, figures: Any) -> None:
    """Aim for the skin's temperature during calibration; see `approach.equal`."""
    seen = scene.skin.shape[0] > 0 and (scene.skin_valid.shape[0] == 0 or scene.skin_valid[0] >= 0.5)
    own.approached[0] = -1
    wanted = neutral(
        own.calm, own.looked, own.covered, given.cover, figures.resting, scene.skin[0] if seen else math.nan,
        figures.rest, pressed(scene, figures.heat), figures.expected, figures.update, figures.lead,
    )  # fmt: skip
    aim_at(own.start_temperature, own.plate_limited, wanted, figures.low, figures.high)


@kernel
def neutral(
    calm: Floats, looked: Floats, covered: Floats, tissue: Floats, resting: float, measured: float, rest: float,
    touched: bool, resistance: float, period: float, lead: float,
) -> float:  # fmt: skip
    """Return the plate temperature [K] with which a finger that touches the plate in a calibration keeps its own.

    Skin at rest gives heat to the air.  On the plate it gives it to the plate, up to what that may take; the rest warms
    the skin, and the plate follows it.  Nobody knows when it will be touched next, so it is always prepared for that.

    Parameters
    ----------
    calm, looked
        Mean of the resting skin's readings [K], 0 before the first, and over how long it is [s], shape (1,) each.
    covered
        Modes of the skin's warming by the plate so far, shape (n,); changed.
    tissue
        Packed finger, shape (4, n); see `itouch_thermal.display.column`.
    resting, rest
        Heat [W/m2] that the finger at rest gives to the air, and its skin's temperature where no sensor sees it [K].
    measured
        Reading of the skin's temperature [K]; NaN: it is not seen now.
    touched, resistance
        Whether the finger is on the plate, and with what contact resistance [K m2/W].
    period, lead
        Time since the last call, and time from now until the plate reaches its target [s].
    """
    drawn = min(DRAWN, max(-DRAWN, resting))
    kept, warmer, soon, steps = resting - drawn, 0.0, 0.0, lead / period
    for i in range(covered.shape[0]):
        decay, gained = tissue[F_DECAY, i], kept * (tissue[F_BEGIN, i] + tissue[F_END, i])
        covered[i] = decay * covered[i] + (gained if touched else 0.0)
        warmer += tissue[F_PORT, i] * covered[i]
        left = decay**steps
        soon += tissue[F_PORT, i] * (
            left * covered[i] + gained * ((1.0 - left) / (1.0 - decay) if decay < 1.0 else steps)
        )
    if math.isfinite(measured):
        looked[0] = min(AVERAGED, looked[0] + period) if calm[0] != 0.0 else period
        calm[0] += min(1.0, period / looked[0]) * (measured - warmer - calm[0])
    skin = calm[0] if calm[0] != 0.0 else rest
    return float(skin + soon - resistance * drawn)


@kernel
def aim_at(start: Floats, limited: Any, wanted: float, low: float, high: float) -> None:
    """Set the start temperature [K], clipped to the plate's band less MARGIN.

    ``start`` (1,) and ``limited`` (1,), whether ``wanted`` is outside the band, are written; ``wanted``, ``low`` and
    ``high`` [K].
    """
    start[0] = min(high - MARGIN, max(low + MARGIN, wanted))
    limited[0] = int(not low <= wanted <= high)


@kernel
def _coming(scene: Any) -> int:
    """Return the object that the plate will render, -1: none; it is the one below, even if a taller one is nearer."""
    near, below = scene.near_object[0], scene.below[0]
    return int(below if near >= 0 and below >= 0 else near)


@kernel
def _wanted(scene: Any, given: Any, figures: Any, index: int) -> float:
    """Return the start temperature [K] for an object, as warm as it and the skin, which must be seen, are now."""
    goes_on, warmed, row = given.played[index] == 0, 0.0, given.start[index]
    if goes_on and given.known[index] != 0:
        warmed = onset.warmth(given.bodies[index], scene.bodies[index], row[3])
    return float(
        onset.start_for(row[0], row[1], row[2], figures.rest, row[3], goes_on, scene.skin[0], warmed)
    )  # fmt: skip


@kernel
def _aim(scene: Any, own: Any, given: Any, figures: Any, index: int, tick: int) -> None:
    """Aim for the object that the finger approaches; if nothing is known of its heat, the start temperature stays."""
    own.preset_begun[0] = tick
    if index >= 0:
        own.approached[0] = index
        if given.starts[index] != 0:
            wanted = _wanted(scene, given, figures, index)
            aim_at(own.start_temperature, own.plate_limited, wanted, figures.low, figures.high)


@kernel
def _look(scene: Any, own: Any, given: Any, figures: Any) -> None:
    """Aim, between touches, for the near object, anew now and then, as it and the skin recover from the last touch."""
    near, tick = _coming(scene), scene.tick[0]
    if near < 0:
        return
    if near != own.approached[0]:
        _aim(scene, own, given, figures, near, tick)
    elif tick % figures.again < figures.hold and given.starts[near] != 0:
        wanted = _wanted(scene, given, figures, near)
        if abs(wanted - own.start_temperature[0]) > READY / 2.0:
            aim_at(own.start_temperature, own.plate_limited, wanted, figures.low, figures.high)


@kernel
def _judge(scene: Any, own: Any, figures: Any, error: float) -> None:
    """Write the readiness of a plate that differs from its start temperature by an error [K]."""
    passed = 1.0
    if figures.preset_time > 0.0:
        passed = (scene.tick[0] - own.preset_begun[0]) * figures.period / figures.preset_time
    own.readiness[0] = judged(error, passed)
    own.plate_ready[0] = int(own.readiness[0] >= 1.0)


@kernel
def _turns(scene: Any, own: Any, given: Any, index: int) -> bool:
    """Tell whether the plate begins, or ceases, to render the open contact with an object."""
    if given.starts[index] == 0 or scene.met[0] < 0:  # a finger lifts for a moment: no change
        return False
    return bool((own.touching[0] != 0) != (scene.plate[0] != 0))


@kernel
def _meet(scene: Any, own: Any) -> None:
    """Begin to render the open contact: what touches the finger is now the plate."""
    aimed = own.approached[0] == own.object[0]
    ready, limited = aimed and own.plate_ready[0] != 0, aimed and own.plate_limited[0] != 0
    again = onset.render(own.account, ready, limited, scene.true_skin[0])
    own.touching[0] = own.fresh[0] = 1
    own.pressing[0] = 0
    own.integral[0] = own.flux[0]
    if not ready and not again:
        own.unready[0] += 1


@kernel
def _part(scene: Any, own: Any, given: Any, figures: Any, memory: Any) -> None:
    """End the touch of a finger that the plate no longer touches, and aim for the next object.

    The finger may be on that already, so readiness is judged at once, by how near its start temperature is.
    """
    tick, touched = scene.tick[0], own.touching[0] != 0
    if own.on_plate[0] != 0:
        observer.end_touch(given.tissue, given.plate, memory.x, memory.memory)
        own.on_plate[0] = 0
    own.touching[0] = 0
    _aim(scene, own, given, figures, _coming(scene), tick)
    if touched:
        _judge(scene, own, figures, scene.plate_temperature[0] - own.start_temperature[0])


@kernel
def hear(event: Any, scene: Scene, own: Own, given: Given, figures: Figures, memory: Memory) -> int:
    """Aim for the object that comes near; begin and end the touch.

    ``event`` is a `HeardContact`.  Return PYTHON, with nothing changed, to leave the event to Python, else 0.
    """
    if event.probe[0] != figures.probe:
        return 0
    kind, tick, index = event.kind[0], event.tick[0], event.object[0]
    if kind == _NEAR and own.touching[0] == 0:
        if not figures.sees:
            return PYTHON
        _aim(scene, own, given, figures, _coming(scene), tick)
    elif kind == _BEGIN:
        if figures.hold > 1 or own.touching[0] != 0:
            return PYTHON
        own.account[:] = 0.0
        own.beside[:] = 0.0
        own.object[0], own.begun[0], own.open[0] = index, tick, 1
        if _turns(scene, own, given, index):
            _meet(scene, own)
    elif kind == _END:
        if figures.hold > 1 or not figures.sees or own.tracked[0] != tick - 1:
            return PYTHON
        own.open[0] = 0
        _part(scene, own, given, figures, memory)
    return 0


@kernel
def _unusual(scene: Any, own: Any, given: Any, figures: Any) -> bool:
    """Tell whether this tick is left to Python: readings or ticks are missing, or an object's flux is not computed.

    Such an object plays a curve, or nothing is known of its heat.  Where an update stands for several periods, ticks in
    which rendering begins or ends are left to Python, too, and so is a new aim where no sensor sees the skin.
    """
    tick, index = scene.tick[0], own.object[0]
    if own.tracked[0] != tick - figures.hold or scene.age[0] != 0:
        return True
    turns = own.open[0] != 0 and _turns(scene, own, given, index)
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
    near = _coming(scene)
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
    if own.open[0] != 0 and _turns(scene, own, given, own.object[0]):
        if own.touching[0] != 0:
            _part(scene, own, given, figures, memory)
        else:
            _meet(scene, own)
    if own.touching[0] != 0:
        taken.part[0] = observer.seen(given.pad, _force(scene))
        taken.unclear[0] = int(not pressed(scene, figures.heat))
        contact = in_contact(scene, figures.heat)
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
            _equal(scene, own, given, figures)
        else:
            _look(scene, own, given, figures)
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
            given.c, given.tissue, given.plate, memory.x, memory.theta, memory.cover, memory.gain, memory.memory,
            memory.line, memory.slots, memory.trace, memory.past, memory.kept, size, scene.sent[0], taken.scale[0],
            taken.press[0], scene.heat_flux[0] if last else math.nan,
            scene.plate_temperature[0] if last else math.nan, scene.sink[0] if last else math.nan,
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
    laws._begin(  # noqa: SLF001
        given.c, given.tissue, given.plate, memory.x, memory.theta, memory.cover, memory.memory, memory.knots,
        memory.trace, memory.kept, given.prior, own.flux[0], scale, laws.PRIOR_ONSET,
    )  # fmt: skip
    own.on_plate[0] = 1
    for _ in range(ago):
        observer.advance(
            given.c, given.tissue, given.plate, memory.x, memory.theta, memory.memory, scene.sent[0], scale
        )  # fmt: skip


@kernel
def command(
    scene: Scene, own: Own, given: Given, figures: Figures, memory: Memory, taken: Taken, out: Any
) -> int:  # fmt: skip
    """Command the current [A] by which the law follows the plan, or brings the plate to its start temperature.

    ``out``: the currents on their way over a wire, see `Coming`.
    """
    touching, ticks = own.touching[0] != 0, scene.tick[0] - own.begun[0]
    comes = own.on_plate[0] == 0 and pressed(scene, figures.heat)
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
        look_ahead(memory.future, ticks, given.offsets, own.desired[0], memory.wanted)
        if not figures.steady:
            scale = _scale(scene, own, given, figures, figures.delay)
        current, flux = laws._follow(  # noqa: SLF001
            given.c, given.tissue, given.plate, given.far_tissue, given.far_plate, memory.x, memory.theta,
            memory.memory, scale, memory.line, memory.slots, memory.single, memory.queue, memory.wanted,
            memory.response, given.hats, memory.knots, memory.work, memory.trace, memory.span, figures.flux_limit,
            figures.ceiling, given.band, figures.capacity, memory.cover[observer.RESISTANCE, observer.RESISTANCE],
            figures.size, figures.hold, figures.hold, out, _NOTHING,
        )  # fmt: skip
    else:
        if scene.load.shape[0] > 0:
            own.force_before[0] = abs(scene.load[2])
        current, flux, error = laws._approach(  # noqa: SLF001
            given.c, given.tissue, given.plate, memory.x, memory.theta, memory.memory, memory.line, memory.slots, out,
            _NOTHING, own.start_temperature[0], figures.capacity, figures.flux_limit, figures.ceiling, figures.within,
        )  # fmt: skip
        _judge(scene, own, figures, error)
        if not touching:
            current = masked(current, figures.noise, figures.most, scene.tick[0])
    own.fresh[0] = 0
    own.flux[0], scene.command[0] = flux, current
    return 0
