"""Random States that a plugin could meet: from those of a run, and from what their fields are declared to hold."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.loop.event_detection import silent
from itouch.plugin import Channel, Contact, ContactArrays, ContactEvent, Field, Record, Role, TwinInputs
from itouch.testing.harness import TwinBench, limits
from itouch.world import Model

Array = NDArray[Any]

#: How far [unit] a number is drawn from what it was in a run, if it did not vary more there.
_SPANS = {"m": 0.02, "m/s": 0.2, "rad": 0.3, "N": 2.0, "K": 5.0, "A": 1.0, "W/m^2": 1000.0, "s": 0.5}
#: The powers of ten between which that distance is scaled: small changes pass other thresholds than large ones.
_SCALES = (-3.0, 0.5)
#: Integers above it are no numbers, but words of a generator.
_WORD = 1 << 32
#: Greatest integer that is drawn.
_MOST = 1 << 62
#: Greatest number from which a distance is computed.
_FAR = 1e150
#: Names of the arrays in `TwinInputs`.
INPUTS = tuple(name for name in TwinInputs.__slots__ if name not in ("ambient", "finger_attached"))


class _Range:
    """What a field held in a run, and may hold."""

    def __init__(self, field: Field, held: Array) -> None:
        """``held`` (n, ...): its values in n States."""
        bounds = (np.asarray(bound, np.float64) for bound in (field.low, field.high))
        self.low, self.high = (np.broadcast_to(bound, held.shape[1:]) for bound in bounds)
        self._held = held
        with np.errstate(over="ignore"):
            self._bounded = np.isfinite(self.high - self.low)  # not where any finite number is allowed
        if held.dtype.kind != "f":
            return
        known = np.isfinite(held)
        self._least = np.where(known, held, np.inf).min(axis=0)
        self._most = np.where(known, held, -np.inf).max(axis=0)
        never = ~known.any(axis=0)
        ends = (np.where(never, 0.0, end) for end in (self._least, self._most))
        self._least, self._most = (np.clip(end, -_FAR, _FAR) for end in ends)
        #: Where it is a count, an index or a choice that is kept as a float.
        self._whole = (~known | (held == np.round(held))).all(axis=0) & (self._most > self._least)
        self._span = np.maximum(self._most - self._least, _SPANS.get(field.unit, 1.0))

    def other(self, value: Array, rng: np.random.Generator) -> Array:
        """Return another value in place of one."""
        if value.dtype.kind == "f":
            return self._number(value, rng)
        if value.dtype.kind == "u" and self._held.max() > _WORD:
            return rng.integers(0, 1 << 63, value.shape, value.dtype)
        # beyond what it held, an index could lead out of an array: of that only declared bounds can tell
        held = np.clip(self._held, -_MOST if value.dtype.kind == "i" else 0, _MOST).astype(np.int64)
        least = np.where(self._bounded, np.clip(self.low, -_MOST, _MOST).astype(np.int64), held.min(axis=0))
        most = np.where(self._bounded, np.clip(self.high, -_MOST, _MOST).astype(np.int64), held.max(axis=0))
        return rng.integers(least, most, value.shape, np.int64, endpoint=True).astype(value.dtype)

    def _number(self, value: Array, rng: np.random.Generator) -> Array:
        inside = rng.uniform(self._least, np.nextafter(self._most, np.inf), value.shape)
        low, high = np.where(self._bounded, self.low, -1.0), np.where(self._bounded, self.high, 1.0)
        beyond = value + self._span * rng.normal(size=value.shape) * 10.0 ** rng.uniform(*_SCALES, value.shape)
        beyond = np.where(self._bounded, rng.uniform(low, high, value.shape), beyond)
        found = np.where(rng.random(value.shape) < 0.5, inside, np.clip(beyond, self.low, self.high))
        found = np.where(self._whole, np.round(np.where(self._bounded, found, inside)), found)
        kept = ~np.isfinite(value) | (rng.random(value.shape) < rng.choice((0.0, 0.9 if value.size > 1 else 0.0)))
        return np.where(kept, value, found)


class States:
    """States that are drawn at random: those of a run, with fields from others, changed a little, or drawn anew."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._kept: list[bytes] = []
        self._ranges: dict[str, _Range] = {}
        self._own: list[str] = []
        self._others: list[str] = []

    def keep(self, state: Record) -> None:
        """Keep a State of the run."""
        self._kept.append(state.tobytes())

    def free(self, fields: Iterable[Field], own: Collection[str], state: Record) -> None:
        """Say which fields may be drawn by themselves, once all States of the run are kept; tables are not.

        ``own``: those that matter to the plugin, which are drawn more often than others, of which there may be many.
        """
        table = np.frombuffer(b"".join(self._kept), state.dtype) if state.nbytes else np.zeros(1, state.dtype)
        self._ranges = {one.name: _Range(one, table[one.name]) for one in fields if table[one.name].dtype.kind in "iuf"}
        self._own = [name for name in self._ranges if name in own]
        self._others = [name for name in self._ranges if name not in own]

    def draw(self, state: Record) -> None:
        """Write a State."""
        rng = self._rng
        state.raw[:] = np.frombuffer(self._any(), np.uint8)
        way = rng.random()
        if way < 0.1:  # as it was
            return
        if way < 0.25:
            for name in self._ranges:
                if state[name].dtype.kind == "f":
                    state[name] *= rng.uniform(0.97, 1.03, state[name].shape)
            return
        chosen = self._some(self._own, (0.1, 0.5)) + self._some(self._others, (0.0, 0.03, 0.3))
        other = Record(state.dtype, np.frombuffer(self._any(), np.uint8).copy())
        moved = 1.0 if way < 0.4 else rng.choice((0.0, 0.3))
        for name in chosen:
            state[name] = other[name] if rng.random() < moved else self._ranges[name].other(state[name], rng)

    def _some(self, names: Sequence[str], shares: Sequence[float]) -> list[str]:
        """Return a share of the names, and one of them at least if it is not 0."""
        share = self._rng.choice(shares)
        chosen = self._rng.random(len(names)) < share
        if share and names:
            chosen[self._rng.integers(len(names))] = True
        return [name for name, one in zip(names, chosen.tolist(), strict=True) if one]

    def _any(self) -> bytes:
        return self._kept[self._rng.integers(len(self._kept))]


def draw_inputs(bench: TwinBench, rng: np.random.Generator) -> None:
    """Write a command within its limits, and what the world presents: those of some tick, or drawn anew."""
    bench.tick = int(rng.integers(4000))
    bench.drive()
    for channel in bench.commands:
        if rng.random() < 0.5:
            bench.command[channel.name] = _command(channel, rng)
    touch = bench.touch
    if rng.random() < 0.7:
        touch.finger_pose[:3] += rng.normal(size=3) * 10.0 ** rng.uniform(-4.0, -1.5)
        touch.finger_pose[3:] = _turned(rng)
        touch.finger_twist[:] = rng.normal(size=6) * 10.0 ** rng.uniform(-3.0, 0.0)
        touch.wrench[:] = rng.normal(size=6) * np.repeat((2.0, 0.02), 3)
        touch.force = float(rng.choice((0.0, rng.uniform(0.0, 3.0))))
        touch.gap = float(rng.choice((-1.0, 1.0))) * 10.0 ** float(rng.uniform(-5.0, -2.0))
        touch.skin_temperature[0] = rng.uniform(290.0, 312.0)
        touch.heat_flux[0], touch.total_heat_flux[0] = rng.normal(size=2) * rng.choice((0.0, 500.0))


def _command(channel: Channel, rng: np.random.Generator) -> Array:
    found = rng.uniform(limits(channel.low, channel.size), limits(channel.high, channel.size))
    if channel.role is Role.SURFACE_POSE:
        found[3:] = (1.0, 0.0, 0.0, 0.0)
    return found


def _turned(rng: np.random.Generator) -> Array:
    """Return the quaternion of a small rotation."""
    found = np.array((1.0, *rng.normal(size=3) * rng.choice((0.0, 0.1))))
    found /= np.linalg.norm(found)
    return found


class Happening:
    """A contact event that is drawn at random, in numbers for compiled code and as Python hears of it."""

    def __init__(self, model: Model, rng: np.random.Generator) -> None:
        self.numbers: ContactArrays = silent()
        self._probes, self._objects, self._rng = [probe.name for probe in model.probes], list(model.objects), rng

    def draw(self, hears: frozenset[Contact], tick: int) -> None:
        """Write an event of a tick, mostly one that is heard of; kind -1: nothing happens."""
        rng, n = self._rng, self.numbers
        n.kind[0] = rng.choice(sorted(hears)) if rng.random() < 0.85 else rng.integers(-1, len(Contact))
        n.tick[0], n.probe[0] = tick, rng.integers(len(self._probes))
        n.object[0] = rng.integers(len(self._objects))
        normal = rng.normal(size=3) * rng.choice((0.05, 1.0)) + (0.0, 0.0, 1.0)
        n.normal[:] = normal / np.linalg.norm(normal)
        n.point[:] = rng.uniform(-0.1, 0.1, 3)
        along = rng.normal(size=3) * 10.0 ** rng.uniform(-3.0, -0.5)
        n.tangential_velocity[:] = along - (along @ n.normal) * n.normal
        n.speed[0] = rng.normal() * 10.0 ** rng.uniform(-3.0, -0.5)
        touches = n.kind[0] in (Contact.BEGIN, Contact.MOVE)
        n.distance[0] = 0.0 if touches else 10.0 ** rng.uniform(-5.0, -1.5)
        n.penetration[0] = 10.0 ** rng.uniform(-6.0, -2.5) if touches else 0.0
        n.force[0] = 600.0 * n.penetration[0]
        n.area[0] = 5e-5 * n.force[0] ** (1 / 3)
        n.time_to_contact[0] = n.distance[0] / n.speed[0] if n.speed[0] > 0.0 else np.inf

    @property
    def said(self) -> str:
        """The event in words."""
        kind = self.numbers.kind[0]
        return "no event" if kind < 0 else f"an event {Contact(kind).name}"

    def heard(self) -> ContactEvent:
        """Return the event as Python hears of it."""
        kind, tick, probe, index, point, normal, distance, speed, along, *rest = [one.tolist() for one in self.numbers]
        return ContactEvent(
            Contact(kind[0]), tick[0], self._probes[probe[0]], self._objects[index[0]], index[0], tuple(point),
            tuple(normal), distance[0], speed[0], tuple(along), *(part[0] for part in rest),
        )  # fmt: skip
