"""Recording the flux of a touch as a curve that ``target="file"`` plays: the paper's own method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from itouch.plugin import waiting
from itouch.plugin.commands import framework
from itouch_thermal.flux.modality import FluxControl
from itouch_thermal.heat import Heat

#: What can be recorded: the flux out of the finger, the display's sensor reading, or the desired flux.
KINDS = ("obtained", "sensor", "desired")
#: After how many ticks it is told again how far the run is.
_TOLD = 100


@dataclass(frozen=True, slots=True)
class Recorded:
    """A touch: its object, times [s] since it began, and fluxes [W/m2] out of the finger."""

    object: str
    material: str
    times: tuple[float, ...]
    fluxes: tuple[float, ...]


def record_flux(
    scene: str,
    *,
    object_name: str = "",
    kind: str = "obtained",
    seconds: float | None = None,
    seed: int = 0,
    rig: str | None = None,
    twin: str | None = None,
) -> Recorded:
    """Run a scene until an object has been touched, and return the flux of that touch, one value per servo period.

    Parameters
    ----------
    scene, rig, twin, seed
        As for a run.
    object_name
        The object; default: the first one touched.
    kind
        One of `KINDS`.
    seconds
        Longest time to wait [s]; default: until the scripted motion ends.

    Raises
    ------
    ValueError
        If there is no such object, nothing to record, or no touch.
    ItouchError
        If the scene is wrong or a device fails.
    """
    with waiting(f"preparing {scene}"):
        session = framework().build(scene, seed=seed, rig=rig, twin=twin)
    with session, waiting(f"running {scene}") as wait:
        wanted = _wanted(session, object_name)
        probe, field = _source(session, kind)
        if seconds is None and not session.scripted:
            raise ValueError("the scene has no scripted motion: say for how long to run, with --for 30s")
        last = None if seconds is None else round(seconds / session.model.period)
        rows, index = _follow(session, probe, field, wanted, last, wait.part)
    if len(rows) < 2:
        what = f"'{object_name}'" if object_name else "nothing"
        raise ValueError(f"the finger touched {what if not object_name else what + ' never'}: no flux to record")
    times = tuple((i + 1) * session.model.period for i in range(len(rows)))
    element = session.model.scene.objects[index]
    return Recorded(element.name, element.material, times, tuple(rows))


def _wanted(session: Any, name: str) -> int:
    """Return the index of an object, -1 for any."""
    names = list(session.model.objects)
    if name and name not in names:
        raise ValueError(f"there is no object '{name}'; there are {', '.join(repr(n) for n in names) or 'none'}")
    return names.index(name) if name else -1


def _source(session: Any, kind: str) -> tuple[str, str]:
    """Return the finger and the State field to record."""
    if kind not in KINDS:
        raise ValueError(f"what = '{kind}' is unknown: {', '.join(KINDS)}")
    for modality in session.model.modalities:
        if isinstance(modality.instance, FluxControl):
            model = modality.model
            if kind == "desired":
                return model.probe, model.names.desired
            truth = kind == "obtained" and model.names.true_flux in session.state
            return model.probe, model.names.true_flux if truth else model.names.heat_flux
    for modality in session.model.modalities:
        if isinstance(modality.instance, Heat) and kind == "desired":
            return modality.model.probe, f"{modality.name}.desired"
    raise ValueError(f"the scene has no modality that knows the flux ({kind})")


def _follow(
    session: Any, probe: str, field: str, wanted: int, last: int | None, tell: Callable[[float, str], None]
) -> tuple[list[float], int]:
    """Tick until a touch has ended; return its fluxes while the finger pressed, and the object's index."""
    state = session.state
    current, force = state[f"{probe}.contact.object"], state[f"{probe}.normal_force"]
    rows: list[float] = []
    pressed, index, ticks = 0, -1, 0
    while not (session.done if last is None else ticks >= last):
        session.tick()
        ticks += 1
        if ticks % _TOLD == 0:
            most = last if last is not None else ticks + session.left
            tell(ticks / most, f"{session.seconds:.1f} s simulated")
        touched = current.item()
        if index >= 0 and touched != index:
            break
        if touched >= 0 and wanted in (-1, touched):
            index = touched
            rows.append(float(state[field].item()))
            if force.item() > 0.0:
                pressed = len(rows)
    del rows[max(0, pressed - 1) :]  # without the period in which the finger lifts
    while rows and rows[-1] == 0.0:  # the plate may leave the finger a little sooner than the object does
        del rows[-1]
    return rows, index
