"""Contact events, compiled: when the plate begins and ceases to render a touch.

In every function ``scene`` is a `Scene`, ``own`` are `OwnFields`, ``given`` is `Given`, ``figures`` are `Figures`,
``course`` is a `Course`, ``models`` are `Models`, and ``memory`` is a `Memory`.
"""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin import Contact, ContactArrays
from itouch.plugin.kernels import inlined, kernel, linked
from itouch_thermal.flux import approach, observer, onset
from itouch_thermal.flux.law import Memory
from itouch_thermal.flux.views import Course, Figures, Given, LawInputs, Models, OwnFields, Scene

#: Code that leaves the tick or event to Python.
PYTHON = 1
#: The kinds of event that are heard, as numbers for compiled code.
_NEAR, _BEGIN, _END = int(Contact.NEAR), int(Contact.BEGIN), int(Contact.END)


@linked
def turns(scene: Any, own: Any, given: Any, index: int) -> bool:
    """Tell whether the plate begins, or ceases, to render the open contact with an object."""
    if given.starts[index] == 0 or scene.met[0] < 0:  # a finger lifts for a moment: no change
        return False
    return bool((own.touching[0] != 0) != (scene.plate[0] != 0))


@linked
def meet(scene: Any, own: Any) -> None:
    """Begin to render the open contact: what touches the finger is now the plate."""
    aimed = own.approached[0] == own.object[0]
    ready, limited = aimed and own.plate_ready[0] != 0, aimed and own.plate_limited[0] != 0
    skin = scene.true_skin[0] if scene.true_skin.shape[0] > 0 else math.nan
    again = onset.render(own.account, ready, limited, skin)
    own.touching[0] = own.fresh[0] = 1
    own.pressing[0] = 0
    own.integral[0] = own.flux[0]
    if not ready and not again:
        own.unready[0] += 1


@linked
def part_from(scene: Any, own: Any, given: Any, figures: Any) -> None:
    """End the touch of a finger that the plate no longer touches, and aim for the next object.

    The finger may be on that already, so readiness is judged at once, by how near its start temperature is.
    """
    touched = own.touching[0] != 0
    own.touching[0] = 0
    approach.aim(scene, own, given, figures, approach.coming(scene), scene.tick[0])
    if touched:
        approach.judge(scene, own, figures, scene.plate_temperature[0] - own.start_temperature[0])


@inlined
def take_off(scene: Any, own: Any, course: Any, figures: Any, models: Any, memory: Any) -> None:
    """Let the law know that the finger leaves the plate; nothing may be left to catch up with."""
    if own.on_plate[0] != 0:
        observer.end_touch(models.fixed.fine.tissue, models.fixed.fine.plate, memory.x, memory.memory)
        own.on_plate[0] = 0
        if figures.wire:  # a finger that slides to another object is on the plate already when the next touch begins
            course.came[0], course.came_doubt[0] = scene.tick[0], 0.5 * figures.period


@inlined
def _ends(event: Any, scene: Any, own: Any, given: Any) -> bool:
    """Tell whether an event of its finger takes that off what the plate renders."""
    if event.kind[0] == _BEGIN:
        return bool(own.touching[0] != 0 and turns(scene, own, given, event.object[0]))
    return bool(event.kind[0] == _END)


@kernel
def hear_without_law(event: ContactArrays, scene: Scene, own: OwnFields, given: Given, figures: Figures) -> int:
    """Aim for the object that comes near; begin and end the touch."""
    return _take_in(event, scene, own, given, figures)


@inlined
def _take_in(event: Any, scene: Any, own: Any, given: Any, figures: Any) -> int:
    """Do so, as far as no law is concerned."""
    if event.probe[0] != figures.probe:
        return 0
    kind, tick, index = event.kind[0], event.tick[0], event.object[0]
    if kind == _NEAR and own.touching[0] == 0:
        approach.aim(scene, own, given, figures, approach.coming(scene), tick)
    elif kind == _BEGIN:
        own.account[:] = 0.0
        own.beside[:] = 0.0
        own.slid[0] = own.slid[0] + tick - own.begun[0] if own.last_end[0] == tick else 0
        own.object[0], own.begun[0], own.open[0] = index, tick, 1
        if turns(scene, own, given, index):
            if own.touching[0] != 0:
                part_from(scene, own, given, figures)
            else:
                meet(scene, own)
    elif kind == _END:
        own.open[0], own.last_end[0] = 0, tick
        part_from(scene, own, given, figures)
    return 0


@kernel
def hear(
    event: ContactArrays, scene: Scene, own: OwnFields, given: Given, figures: Figures, course: Course, models: Models,
    memory: Memory, taken: LawInputs,
) -> int:  # fmt: skip
    """Do the same for the controller `model`, which also lets its law know when the finger leaves the plate.

    Return PYTHON, with nothing changed, to leave the event to Python, else 0: if ticks must be caught up with first,
    the skin's temperature is not known here, or the finger may be on the plate between two updates.
    """
    if event.probe[0] == figures.probe:
        kind, ends = event.kind[0], _ends(event, scene, own, given)
        if ends and own.on_plate[0] != 0 and course.tracked[0] != scene.tick[0] - 1:
            return PYTHON
        if (ends or (kind == _NEAR and own.touching[0] == 0)) and approach.blind(scene, figures):
            return PYTHON
        if kind == _BEGIN and figures.hold > 1 and taken.alone[0] == 0:
            return PYTHON
        if ends:
            take_off(scene, own, course, figures, models, memory)
    return _take_in(event, scene, own, given, figures)
