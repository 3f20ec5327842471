"""Contact events, compiled: when the plate begins and ceases to render a touch."""

from __future__ import annotations

from typing import Any

from itouch.plugin import Contact
from itouch.plugin.kernels import kernel
from itouch_thermal.flux import aiming, observer, onset
from itouch_thermal.flux.law import Memory
from itouch_thermal.flux.views import Figures, Given, Own, Scene

#: Code that leaves the tick or event to Python.
PYTHON = 1
#: The kinds of event that are heard, as numbers for compiled code.
_NEAR, _BEGIN, _END = int(Contact.NEAR), int(Contact.BEGIN), int(Contact.END)


@kernel
def turns(scene: Any, own: Any, given: Any, index: int) -> bool:
    """Tell whether the plate begins, or ceases, to render the open contact with an object."""
    if given.starts[index] == 0 or scene.met[0] < 0:  # a finger lifts for a moment: no change
        return False
    return bool((own.touching[0] != 0) != (scene.plate[0] != 0))


@kernel
def meet(scene: Any, own: Any) -> None:
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
def part_from(scene: Any, own: Any, given: Any, figures: Any, memory: Any) -> None:
    """End the touch of a finger that the plate no longer touches, and aim for the next object.

    The finger may be on that already, so readiness is judged at once, by how near its start temperature is.
    """
    tick, touched = scene.tick[0], own.touching[0] != 0
    if own.on_plate[0] != 0:
        observer.end_touch(given.fixed.fine.tissue, given.fixed.fine.plate, memory.x, memory.memory)
        own.on_plate[0] = 0
    own.touching[0] = 0
    aiming.aim(scene, own, given, figures, aiming.coming(scene), tick)
    if touched:
        aiming.judge(scene, own, figures, scene.plate_temperature[0] - own.start_temperature[0])


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
        aiming.aim(scene, own, given, figures, aiming.coming(scene), tick)
    elif kind == _BEGIN:
        if figures.hold > 1 or own.touching[0] != 0:
            return PYTHON
        own.account[:] = 0.0
        own.beside[:] = 0.0
        own.object[0], own.begun[0], own.open[0] = index, tick, 1
        if turns(scene, own, given, index):
            meet(scene, own)
    elif kind == _END:
        if figures.hold > 1 or not figures.sees or own.tracked[0] != tick - 1:
            return PYTHON
        own.open[0] = 0
        part_from(scene, own, given, figures, memory)
    return 0
