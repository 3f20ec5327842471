"""Running a scene with an instrumented sample, and sampling its channels by what they mean."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from itouch.plugin import Role
from itouch_thermal.measuring.correct import Sensors
from itouch_thermal.measuring.touches import TOUCHED, Record

#: Told at each sample: seconds, force [N].
Watch = Callable[[float, float], bool]


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Where the readings of a scene stand in its State; empty: there is none."""

    flux: str
    force: str
    film: str
    skin: str
    valid: str
    sensors: Sensors
    full_scale: float
    device: str


def find(model: Any) -> Source:
    """Return the channels of a scene: the first heat flux, the first contact force, and the temperatures beside.

    Raises
    ------
    ValueError
        If there is no heat flux or no force.
    """
    by_role: dict[Role, tuple[str, Any]] = {}
    for name, device in model.devices.items():
        for channel in device.reads:
            by_role.setdefault(channel.role, (name, channel))
    missing = [role.value for role in (Role.HEAT_FLUX, Role.CONTACT_FORCE) if role not in by_role]
    if missing:
        raise ValueError(f"no device of the scene reads a {' or a '.join(missing)}: a touch is measured by both")
    name, flux = by_role[Role.HEAT_FLUX]
    params = model.devices[name].params

    def path(role: Role) -> str:
        found = by_role.get(role)
        return f"{found[0]}.{found[1].name}" if found else ""

    sensors = Sensors(*(float(getattr(params, key, 0.0)) for key in ("flux_lag", "film_lag", "film_capacity")))
    film = path(Role.OTHER_TEMPERATURE) or path(Role.SKIN_CONTACT_TEMPERATURE)
    return Source(
        f"{name}.{flux.name}", path(Role.CONTACT_FORCE), film, path(Role.SKIN_TEMPERATURE), path(Role.SKIN_VALID),
        sensors if film else Sensors(sensors.lag), float(flux.high[0]) if flux.high else math.inf, name,
    )  # fmt: skip


def sample(
    scene: str, *, seed: int = 0, rig: str | None = None, twin: str | None = None, longest: float | None = None,
    watch: Watch | None = None,
) -> tuple[Record, Source]:  # fmt: skip
    """Run a scene until its own motion ends, so many seconds have passed, or ``watch`` returns True.

    Raises
    ------
    ValueError
        If the scene cannot measure a touch, or would never end.
    ItouchError
        If the scene is wrong or a device fails.
    """
    itouch = import_module("itouch")
    description = itouch.load(scene, rig=rig, twin=twin)
    real = any(not device.twin for device in description.devices)
    session = itouch.build(description, seed=seed, clock=itouch.WallClock() if real else None)
    with session:
        source = find(session.model)
        if longest is None and not session.scripted and watch is None:
            raise ValueError("the scene never ends: say for how long to measure, with --for 10min")
        if real:
            session.enable()
        rows = _follow(session, source, longest, watch)
        period = session.model.period
    columns = np.array(rows).reshape(-1, 4).T.copy()
    return Record(period, *columns), source


def _follow(session: Any, source: Source, longest: float | None, watch: Watch | None) -> list[tuple[float, ...]]:
    """Tick and keep what is read."""
    state, period = session.state, session.model.period
    flux, force = state[source.flux], state[source.force]
    film = state[source.film] if source.film else None
    skin = state[source.skin] if source.skin else None
    valid = state[source.valid] if source.valid else None
    rows: list[tuple[float, ...]] = []
    last = math.inf if longest is None else longest / period
    while len(rows) < last and not (longest is None and session.scripted and session.done):
        session.tick()
        pushed = math.sqrt(float(np.square(force[:3]).sum())) if force.ndim else abs(float(force))
        pushed = pushed if force.ndim == 0 or force[2] <= 0.0 else -pushed
        seen = math.nan if skin is None or (valid is not None and not valid.item()) else skin.item()
        rows.append((flux.item(), math.nan if film is None else film.item(), pushed, seen))
        if watch is not None and watch(len(rows) * period, pushed):
            break
    return rows


__all__ = ["TOUCHED", "Source", "find", "sample"]
