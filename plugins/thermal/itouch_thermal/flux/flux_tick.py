"""A tick, compiled: ``attend`` says which touch the plate renders, what was obtained and what is desired.

For the controller `model`, ``begin`` lets its law know before a touch ends, and leaves unusual ticks to Python;
``prepare`` determines what the law takes in, ``track`` lets it do so, and ``command`` asks it for the next current.
Contact events are heard in between (`contact_events`).

In every function ``scene`` is a `Scene`, ``own`` are `OwnFields`, ``given`` is `Given`, ``figures`` are `Figures`,
``course`` is a `Course`, ``models`` are `Models`, ``memory`` is a `Memory`, and ``law`` (n,) the numbers of a law of
the contact resistance, in SI units.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from contact_heat.resistance import resistance_at
from itouch.plugin.kernels import inlined, kernel, linked
from itouch_thermal.flux import approach, contact_events, flux_error, late_readings, observer, onset
from itouch_thermal.flux import law as laws
from itouch_thermal.flux.contact_events import PYTHON
from itouch_thermal.flux.current_command import FutureCurrent, approach_current, plan_current
from itouch_thermal.flux.curve import flux_at
from itouch_thermal.flux.law import DEADBEAT, MISSED, PRIOR_ONSET, Memory
from itouch_thermal.flux.masking import masked
from itouch_thermal.flux.preview import PreviewState, begin_ahead, extrapolate, keep_ahead, keep_past, look_ahead
from itouch_thermal.flux.views import Course, Figures, Floats, Given, LawInputs, Models, OwnFields, Scene
from itouch_thermal.laws import press_factor

#: Least and greatest contact resistance that the force may explain, as multiples of the expected one.
SCALE = (0.02, 50.0)
#: Zero, in the type in which Python passes numbers.  A literal in a kernel has a type of its own, for which every
#: function that it is passed to would be compiled once more.
_NOTHING: Any = np.int64(0)
#: Time constant [s] of the press for which the strength of pressing equals by how much the scale exceeds 1, time
#: constant [s] of the filter that gives the resistance's rate of change, and the strength that is noise.
PRESSING, PRESS_FILTER, STILL = 0.05, 0.02, 0.1
#: For how long [s] the plate may have let go of a finger that lifts, before it counts as missing.
LIFTS = 0.05
#: Behind a wire, how many servo periods ago at most the finger may have come when it is set down.
EARLY = 50

_resistance_at, _press_factor = kernel(resistance_at), kernel(press_factor)


@linked
def scale_of(law: Any, force: float, full: float, expected: float, time: float, press: float) -> float:
    """Return the contact resistance at a force [N], ``time`` [s] after the start, as a multiple of the expected one.

    Below the force ``full`` [N] it grows as the force falls, besides what the law says.
    """
    found = _resistance_at(law, force) / expected * _press_factor(time, press)
    if force < full:
        found = found * full / force if force > 0.0 else SCALE[1]
    return float(min(SCALE[1], max(SCALE[0], found)))


@inlined
def _turns(scene: Any, own: Any, given: Any) -> bool:
    """Tell whether the plate begins, or ceases, in this tick to render a contact that is open."""
    return bool(own.open[0] != 0 and contact_events.turns(scene, own, given, own.object[0]))


@inlined
def _aims(scene: Any, own: Any, given: Any, figures: Any) -> bool:
    """Tell whether in this tick the plate gets a start temperature for which the skin's temperature is needed."""
    begins_or_ends, touched = _turns(scene, own, given), own.touching[0] != 0
    if touched or begins_or_ends:
        return touched and begins_or_ends
    near = approach.coming(scene)
    return bool(
        scene.ready[0] != 0
        and near >= 0
        and (near != own.approached[0] or scene.tick[0] % figures.again < figures.hold)
    )


@kernel
def attend(scene: Scene, own: OwnFields, given: Given, figures: Figures) -> int:
    """Begin and end what the plate renders; in a touch note what was obtained and is desired, before it take aim."""
    if _turns(scene, own, given):
        if own.touching[0] != 0:
            contact_events.part_from(scene, own, given, figures)
        else:
            contact_events.meet(scene, own)
    if own.touching[0] != 0:
        _note(scene, own, given, figures)
        own.desired[0] = _desired(scene, own, given, figures)
        return 0
    if scene.ready[0] == 0:
        approach.aim_for_skin(scene, own, given, figures)
    else:
        approach.look_near(scene, own, given, figures)
    if own.desired[0] != 0.0:
        own.desired[0] = 0.0
    if scene.plate_temperature[0] < figures.dew:
        own.condensation_time[0] += figures.update
    return 0


@kernel
def attend_and_judge(scene: Scene, own: OwnFields, given: Given, figures: Figures) -> int:
    """Do the same, and judge by the reading of the plate how ready it is."""
    attend(scene, own, given, figures)
    if own.touching[0] == 0:
        approach.judge(scene, own, figures, scene.plate_temperature[0] - own.start_temperature[0])
    return 0


@inlined
def _note(scene: Any, own: Any, given: Any, figures: Any) -> None:
    """Enter the last update into the account, but not those in which the finger lifts: they are no part of the touch.

    The plate lets go of a finger a little before the virtual contact does, and a slow model finger takes note of that
    later still.  Such updates wait, and count only if the finger comes back to the plate, or stays away for long: then
    the plate is missing.  What was desired in them is nearly what is desired now.
    """
    contact, before, after = approach.in_contact(scene, figures.heat), own.pressing[0], 1
    if contact and before != 0:
        lifts = (
            scene.true_flux.shape[0] > 0 and own.obtained[0] == 0.0 and flux_error.scored(own.account, figures.update)
        )
        if lifts and 0 < before <= LIFTS / figures.update:
            after = before + 1
        else:
            skin = scene.true_skin[0] if scene.true_skin.shape[0] > 0 else math.nan
            for _ in range(before - 1):
                flux_error.enter(own.account, 0.0, own.desired[0], skin, figures.update)
            flux_error.enter(own.account, own.obtained[0], own.desired[0], skin, figures.update)
            after = -1 if lifts else 1
    own.pressing[0] = after if contact else 0
    if scene.true_flux.shape[0] > 0:
        own.obtained[0] = scene.true_flux[0]
    elif not figures.estimates:
        force = _force(scene)
        own.obtained[0] = scene.heat_flux[0] / (observer.seen(given.pad, force) if force > 0.0 else 1.0)


@inlined
def _desired(scene: Any, own: Any, given: Any, figures: Any) -> float:
    """Return the flux [W/m2] that is desired in this tick."""
    index = own.object[0]
    if index < 0 or given.played[index] == 0:
        return float(scene.heat_desired[0])
    time = (scene.tick[0] - own.begun[0] + 1) * figures.period
    return flux_at(given.times, given.fluxes, given.rows[index, 0], given.rows[index, 1], time)


@kernel
def begin(
    scene: Scene, own: OwnFields, given: Given, figures: Figures, course: Course, models: Models, memory: Memory,
) -> int:  # fmt: skip
    """Let the law know before a finger leaves the plate, and compare its estimate with the sensor's reading.

    Return PYTHON, with nothing changed, to leave the tick to Python, else 0: if ticks must be caught up with before the
    finger leaves the plate, or the skin's temperature is needed and not known here.
    """
    parts = own.touching[0] != 0 and _turns(scene, own, given)
    if parts and own.on_plate[0] != 0 and course.tracked[0] != scene.tick[0] - 1:
        return PYTHON
    if approach.blind(scene, figures) and _aims(scene, own, given, figures):
        return PYTHON
    if parts:
        contact_events.take_off(scene, own, course, figures, models, memory)
    elif figures.estimates and own.touching[0] != 0:
        _compare(scene, own, figures, models, memory)
    return 0


@kernel
def prepare(
    scene: Scene, own: OwnFields, given: Given, figures: Figures, course: Course, models: Models, memory: Memory,
    taken: LawInputs,
) -> int:  # fmt: skip
    """Determine what the law takes in: all is set anew in each tick, as ``taken`` is not in State."""
    taken.scale[0], taken.press[0], taken.unclear[0] = 1.0, 0.0, 0
    memory.memory[observer.M_PART] = 1.0
    if own.touching[0] != 0:
        memory.memory[observer.M_PART] = observer.seen(given.pad, _force(scene))
        taken.unclear[0] = int(not approach.pressed(scene, figures.heat))
        if not figures.plate_steady:
            scale = _scale(scene, own, models, figures, _NOTHING)
            now = math.log(scale)
            taken.scale[0] = scale
            taken.press[0] = (
                press_anew(course.scale_before, now)
                if own.fresh[0] != 0
                else press_on(course.scale_before, now, figures.part)
            )
    return 0


@inlined
def _compare(scene: Any, own: Any, figures: Any, models: Any, memory: Any) -> None:
    """Enter what stands beside the estimate of the last update, if that is entered into the account."""
    entered = own.pressing[0] != 0 and approach.in_contact(scene, figures.heat)
    if entered and flux_error.scored(own.account, figures.update):
        deviation = late_readings.estimate(memory.x, memory.cover, _column(models))[1]
        flux_error.compare(own.beside, scene.heat_flux[0], deviation, own.desired[0])


@inlined
def _column(models: Any) -> int:
    """Return the number of modes of tissue and plate."""
    return int(models.fixed.fine.tissue.shape[1] + models.fixed.fine.plate.shape[1])


@linked
def press_on(before: Floats, now: float, part: float) -> float:
    """Return how strongly the finger is being pressed on, by how fast the logarithm of the resistance changes.

    ``now`` is the logarithm of the contact resistance as a multiple of the expected one, without a unit; ``before``
    (1,) is the same filtered, and is moved towards it by the share ``part``.
    """
    followed = before[0] + part * (now - before[0])
    before[0] = followed
    return float(max(0.0, PRESSING / PRESS_FILTER * abs(now - followed) - STILL))


@linked
def press_anew(before: Floats, now: float) -> float:
    """Return how strongly a finger that has just come is being pressed on.

    ``before`` (1,) is written; it and ``now`` are as in `press_on`, without a unit.
    """
    before[0] = now + PRESS_FILTER / PRESSING
    return float(press_on(before, now, 0.0))


@linked
def _force(scene: Any) -> float:
    """Return the force on the plate [N], measured or virtual."""
    return float(abs(scene.load[2]) if scene.load.shape[0] > 0 else scene.normal_force[0])


@linked
def _scale(scene: Any, own: Any, models: Any, figures: Any, later: int) -> float:
    """Return the resistance that the force explains ``later`` periods from now, as a multiple of the expected one.

    A finger that slides to another object has been on the plate for longer than the contact lasts.
    """
    time = (scene.tick[0] - own.begun[0] + own.slid[0] + later + 1) * figures.period
    return float(scale_of(models.plate, _force(scene), figures.plate_full, figures.expected, time, figures.plate_press))


@kernel
def track(scene: Scene, course: Course, models: Models, memory: Memory, taken: LawInputs, size: int) -> int:
    """Let the law take in what was sent and read; periods in which nothing was taken in pass without readings before.

    ``taken.passes`` is 1 if only these pass.  A driver that holds a temperature may give another current than was asked
    for: it reports which.
    """
    passed = max(0, min(MISSED, scene.tick[0] - 1 - course.tracked[0]))
    for k in range(passed + 1 - taken.passes[0]):
        last = k == passed and taken.unclear[0] == 0 and scene.age[0] == 0
        if k == passed and scene.actual.shape[0] > 0 and memory.slots[1] > 0.0:
            memory.line[int(memory.slots[0])] = scene.actual[0]
        laws._track(  # noqa: SLF001
            models.fixed.fine, memory, size, scene.sent[0], taken.scale[0], taken.press[0],
            scene.heat_flux[0] if last else math.nan, scene.plate_temperature[0] if last else math.nan,
            scene.sink[0] if last else math.nan,
        )  # fmt: skip
    course.tracked[0] = scene.tick[0] - taken.passes[0]
    return 0


@linked
def _look_on(
    scene: Any, own: Any, given: Any, figures: Any, course: Any, models: Any, future: Floats, ticks: int
) -> None:
    """Keep the preview a horizon ahead, with the resistance that is expected to last at the felt force."""
    index = course.preview_index[0]
    ahead = PreviewState(
        models.finger, course.preview_finger, given.bodies[index], course.preview_object, future, course.reached,
        own.slid,
    )  # fmt: skip
    resistance = figures.alone if figures.steady else _resistance_at(models.law, scene.felt_force[0])
    press = figures.press / figures.period
    shared = scene.beside_part.shape[0] > 0 and scene.beside_part[0] > 0.0
    if own.fresh[0] != 0:
        begin_ahead(
            ahead, scene.finger, scene.bodies[index], own.desired[0], resistance, press, ticks, figures.first,
            figures.ahead, shared,
        )  # fmt: skip
    else:
        keep_ahead(
            ahead, scene.finger, scene.bodies[index], own.desired[0], resistance, press, ticks, figures.ahead,
            figures.hold, figures.steady, shared,
        )  # fmt: skip


@inlined
def _place(scene: Any, figures: Any, models: Any, memory: Any) -> None:
    """Tell the law which finger is about to touch: the model finger as it is now or, without one, a resting one."""
    if figures.heat:
        onset.converted(models.into, scene.finger, memory.x[0])
    else:
        risen = (scene.skin[0] if scene.skin.shape[0] > 0 else figures.rest) - models.fixed.fine.c[observer.O_REST]
        for i in range(models.rise.shape[0]):
            memory.x[0, i] = models.rise[i] * risen


@inlined
def since(scene: Any, own: Any, figures: Any, course: Any) -> tuple[int, float]:
    """Return how many servo periods ago the finger came to the plate, and the standard deviation of that [s]."""
    tick = scene.tick[0]
    if scene.load.shape[0] == 0:
        return 0, PRIOR_ONSET
    if figures.hold > 1:  # it was not there when the touch began, else it would have been set down then
        return max(1, min(figures.hold, tick - own.begun[0])), PRIOR_ONSET
    if figures.wire:
        return max(1, min(EARLY, tick - course.came[0])), course.came_doubt[0]
    return onset.grown_for(abs(scene.load[2]), course.force_before[0]), PRIOR_ONSET


@inlined
def _set_down(scene: Any, own: Any, figures: Any, course: Any, models: Any, memory: Any, scale: float) -> None:
    """Set the finger down as of when, by the force, it came: a reading is a period old, and the force had to grow."""
    ago, doubt = since(scene, own, figures, course)
    flows = scene.sent[0]
    if figures.wire:
        flows = memory.line[int(memory.slots[0])] if figures.delay > 0 else course.acting[0]
    laws._begin(models.fixed, memory, own.flux[0], scale, doubt)  # noqa: SLF001
    basis = models.fixed.fine
    own.on_plate[0] = 1
    for _ in range(ago):
        observer.advance(basis.c, basis.tissue, basis.plate, memory.x, memory.theta, memory.memory, flows, scale)


@kernel
def feel_between(
    scene: Scene, own: OwnFields, figures: Figures, models: Models, taken: LawInputs
) -> int:  # fmt: skip
    """Return 1 if the finger is on the plate in the tick in which its touch begins, and what that means for the law."""
    taken.scale[0] = 1.0 if figures.plate_steady else _scale(scene, own, models, figures, _NOTHING)
    return int(approach.pressed(scene, figures.heat))


@kernel
def set_between(
    scene: Scene, own: OwnFields, given: Given, figures: Figures, course: Course, models: Models, memory: Memory,
    taken: LawInputs,
) -> int:  # fmt: skip
    """Begin a touch between two updates, in the tick in which it began; ticks before it have been caught up with."""
    memory.memory[observer.M_PART] = observer.seen(given.pad, _force(scene))
    _place(scene, figures, models, memory)
    _set_down(scene, own, figures, course, models, memory, taken.scale[0])
    return 0


@kernel
def command(
    scene: Scene, own: OwnFields, given: Given, figures: Figures, course: Course, models: Models, memory: Memory,
    taken: LawInputs,
) -> int:  # fmt: skip
    """Command the current [A] by which the law follows the plan, or brings the plate to its start temperature."""
    touching, ticks = own.touching[0] != 0, scene.tick[0] - own.begun[0]
    leaving = FutureCurrent(taken.hold[0], taken.wait[0], (taken.out[0], taken.out[1], taken.out[2]))
    comes = own.on_plate[0] == 0 and approach.pressed(scene, figures.heat)
    if comes or (figures.hold > 1 and scene.ready[0] == 0):
        memory.memory[observer.M_QUIET] = observer.quiet(models.fixed.fine.c)
    played, previewed = touching and own.object[0] >= 0 and given.played[own.object[0]] != 0, False
    if touching:
        if own.fresh[0] != 0:
            course.preview_index[0] = own.object[0]
            if own.on_plate[0] == 0:
                _place(scene, figures, models, memory)
        previewed = course.preview_index[0] >= 0 and given.known[course.preview_index[0]] != 0
        if previewed and not played:
            _look_on(scene, own, given, figures, course, models, memory.future, ticks)
        elif not played:
            keep_past(memory.future, ticks, own.desired[0], own.fresh[0] != 0)
        if comes:
            _set_down(scene, own, figures, course, models, memory, taken.scale[0])
    if touching and own.on_plate[0] != 0:
        offsets, scale = models.fixed.offsets, taken.scale[0]
        if played:
            first, end = given.rows[own.object[0], 0], given.rows[own.object[0], 1]
            for k in range(offsets.shape[0]):
                time = (ticks + (offsets[k] + leaving.wait) + 1) * figures.period
                memory.wanted[k] = flux_at(given.times, given.fluxes, first, end, time)
        elif previewed:
            look_ahead(memory.future, ticks, offsets, leaving.wait, own.desired[0], memory.wanted)
        else:
            extrapolate(memory.future, ticks, offsets, leaving.wait, memory.wanted, figures.period, figures.hold)
        if not figures.plate_steady:
            scale = _scale(scene, own, models, figures, figures.delay + leaving.wait)
        doubt = 0.0 if figures.believes else memory.cover[observer.RESISTANCE, observer.RESISTANCE]
        current, flux = plan_current(models.fixed, memory, figures.bounds, leaving, scale, doubt, figures.hold)
    else:
        if scene.load.shape[0] > 0 and not figures.wire:
            course.force_before[0] = abs(scene.load[2])
        within = max(DEADBEAT, 1.5 * leaving.hold * figures.period)
        current, flux, error = approach_current(
            models.fixed.fine, memory, figures.bounds, leaving, own.start_temperature[0], within
        )
        approach.judge(scene, own, figures, error)
        if not touching:
            current = masked(current, figures.noise, figures.most, scene.tick[0])
    own.fresh[0] = 0
    own.flux[0], scene.command[0] = flux, current
    if figures.estimates:
        own.obtained[0] = late_readings.estimate(memory.x, memory.cover, _column(models))[0]
    return 0
