"""The phases of a touch, each as a stored State from which a cell of the matrix begins."""

from __future__ import annotations

import dataclasses
import os
from typing import Any

import numpy as np

from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.scene.elements import Fault
from itouch.session import Session, build, load_scene

#: The phases, in order.
PHASES = ("closed-open", "idle", "approach", "contact", "release")
#: Times [s] of phases: the approach before a contact's start, the settled contact after it, the release before its end.
BEFORE, INTO, UNTIL = 0.25, 1.5, 0.15
_STEP = 10


def prepared(
    scene: str | os.PathLike[str] | Scene, *, slots: int = 1, seed: int = 0, catalog: Catalog | None = None
) -> Session:
    """Build a session in which every device has slots for injected faults, none of which begins by itself."""
    scene = scene if isinstance(scene, Scene) else load_scene(scene, catalog=catalog)
    late = 1e6
    faults = tuple(Fault(device=d.name, kind="freeze", at=late) for d in scene.devices for _ in range(slots))
    return build(dataclasses.replace(scene, faults=faults), seed=seed, catalog=catalog)


def phases(session: Session) -> dict[str, bytes]:
    """Run a session through its first contact, and return the State at the start of each phase.

    Raises
    ------
    ValueError
        If there is no complete contact in the scene's script.
    """
    start = session.state.tobytes()
    stored: dict[int, bytes] = {}

    def store() -> None:
        stored[session.ticks] = session.state.tobytes()

    if session.scripted:
        session.run(None, each=store, every=_STEP, until=lambda: bool(session.statistics.contacts) or session.done)
    ticks = np.array(sorted(stored))
    wanted = moments(session, _ready(stored, session))
    found = {name: stored[int(ticks[np.abs(ticks - moment).argmin()])] for name, moment in wanted.items()}
    return {"closed-open": start, **found}


def moments(session: Session, ready: int) -> dict[str, float]:
    """Return the tick of each phase, for a session that has run through its first contact.

    Raises
    ------
    ValueError
        If there was no contact.
    """
    if not session.statistics.contacts:
        raise ValueError("the scene's script has no whole contact")
    contact: dict[str, Any] = session.statistics.contacts[0]
    begin, end, period = contact["begin_s"], contact["end_s"], session.model.period
    return {
        "idle": ready + 0.5 / period,
        "approach": (begin - BEFORE) / period,
        "contact": min(begin + INTO, 0.5 * (begin + end)) / period,
        "release": (end - UNTIL) / period,
    }


def _ready(stored: dict[int, bytes], session: Session) -> int:
    """Return the first tick at which the rig was calibrated."""
    dtype = session.state.dtype
    return next(tick for tick, data in sorted(stored.items()) if np.frombuffer(data, dtype)[0]["ready"])
