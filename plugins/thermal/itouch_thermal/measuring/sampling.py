"""Runs a scene with an instrumented sample, and samples the channels by their roles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from itouch.plugin import ItouchError, Role
from itouch.plugin.commands import framework
from itouch_thermal.measuring.correct import Sensors
from itouch_thermal.measuring.touches import Record

#: Called at each sample with the time [s] and the force [N]; true ends the measurement.
Watch = Callable[[float, float], bool]


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """The State fields of a scene's readings; empty if there is no such reading."""

    flux: str
    force: str
    film: str
    skin: str
    valid: str
    sensors: Sensors
    full_scale: float
    device: str
    calibration: str = ""


@dataclass(frozen=True, slots=True)
class Given:
    """What the command line says about the film: lag [s] and heat capacity [J/m2K]; None: the scene's."""

    lag: float | None = None
    capacity: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """The readings, their source, the room's temperature [K], and why the run ended early; empty if it did not."""

    record: Record
    source: Source
    room: float
    stopped: str


def find(model: Any) -> Source:
    """Return the channels of a scene: the first heat flux, the first contact force, and the temperatures.

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

    keys = ("flux_lag", "film_lag", "film_capacity", "film_resistance")
    sensors = Sensors(*(float(getattr(params, key, 0.0)) for key in keys))
    film = path(Role.OTHER_TEMPERATURE) or path(Role.SKIN_CONTACT_TEMPERATURE)
    return Source(
        f"{name}.{flux.name}", path(Role.CONTACT_FORCE), film, path(Role.SKIN_TEMPERATURE), path(Role.SKIN_VALID),
        sensors if film else replace(sensors, film_lag=0.0, capacity=0.0),
        float(flux.high[0]) if flux.high else math.inf, name,
        str(getattr(params, "calibration", "")) or f"as device '{name}' has it",
    )  # fmt: skip


def calibrated(source: Source, given: Given) -> Source:
    """Return a source in which the given values of the film replace those of the scene.

    Raises
    ------
    ValueError
        If stored heat is to be corrected, and no device reads the film's temperature.
    """
    sensors = source.sensors
    if given.capacity is not None and given.capacity > 0.0 and not source.film:
        raise ValueError(
            f"--film-capacity {given.capacity:g} J/(m^2*K): no device of the scene reads the film's temperature, and "
            f"stored heat follows from it; name the film's thermometer, or omit --film-capacity"
        )
    lag = sensors.lag if given.lag is None else given.lag
    capacity = sensors.capacity if given.capacity is None else given.capacity
    return replace(source, sensors=replace(sensors, lag=lag, capacity=capacity))


def sample(
    scene: str, *, seed: int = 0, rig: str | None = None, twin: str | None = None, longest: float | None = None,
    watch: Watch | None = None, given: Given = Given(),
) -> Sampled:  # fmt: skip
    """Run a scene until its own motion ends, ``longest`` seconds have passed, or ``watch`` returns True.

    Readings until a device fails, or until Ctrl-C, are kept.

    Raises
    ------
    ValueError
        If the scene cannot measure a touch, or would never end.
    ItouchError
        If the scene is wrong or a device fails before the first reading.
    """
    itouch = framework()
    description = itouch.load(scene, rig=rig, twin=twin)
    real = any(not device.twin for device in description.devices)
    session = itouch.build(description, seed=seed, clock=itouch.WallClock() if real else None)
    rows: list[tuple[float, ...]] = []
    stopped = ""
    try:
        with session:
            source = calibrated(find(session.model), given)
            if any(device.twin for device in description.devices if device.name == source.device):
                source = replace(source, calibration=f"none, device '{source.device}' is a twin")
            if longest is None and not session.scripted and watch is None:
                raise ValueError("the scene never ends: say for how long to measure, with --for 10min")
            if real:
                session.enable()
            try:
                _follow(session, source, longest, watch, rows)
            except KeyboardInterrupt:
                stopped = "interrupted"
    except ItouchError as error:  # of a device in the touch, or when it was to be made safe and released
        if not rows:
            raise
        stopped = str(error)
    columns = np.array(rows, dtype=np.float64).reshape(-1, 5).T.copy()
    return Sampled(Record(*columns), source, description.world.temperature, stopped)


def _follow(
    session: Any, source: Source, longest: float | None, watch: Watch | None, rows: list[tuple[float, ...]]
) -> None:
    """Tick, and append a row at every new reading of the film; a held reading does not count."""
    state, period = session.state, session.model.period
    flux, force = state[source.flux], state[source.force]
    film = state[source.film] if source.film else None
    skin = state[source.skin] if source.skin else None
    valid = state[source.valid] if source.valid else None
    number, tick, missed = (state[name] for name in (f"{source.device}.sequence", "tick", f"{source.device}.missed"))
    begun = int(tick.item()) + int(missed.item())
    last, newest = math.inf if longest is None else longest / period, int(number.item())
    ticks = 0
    while ticks < last and not (longest is None and session.scripted and session.done):
        session.tick()
        ticks = int(tick.item()) + int(missed.item()) - begun
        if int(number.item()) == newest:
            continue
        newest = int(number.item())
        pushed = math.sqrt(float(np.square(force[:3]).sum())) if force.ndim else abs(float(force))
        pushed = pushed if force.ndim == 0 or force[2] <= 0.0 else -pushed
        seen = math.nan if skin is None or (valid is not None and not valid.item()) else skin.item()
        rows.append((ticks * period, flux.item(), math.nan if film is None else film.item(), pushed, seen))
        if watch is not None and watch(ticks * period, pushed):
            break


__all__ = ["Given", "Sampled", "Source", "calibrated", "find", "sample"]
