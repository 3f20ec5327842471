"""Random scenes of a carried surface, and wires for them, drawn from a seed and a number: the same on every machine."""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from itouch.plugin import Device
from itouch.plugin.discovery import DEVICES, Catalog, Found, find
from itouch_evidence.surface import edges, meshes
from itouch_evidence.surface.scenes import RADIUS, Slope, ball, ramp

#: The steepest ramp [deg].
STEEPEST = 80.0
#: Greatest speed of strokes over a ball [mm/s]: a plate that slides past a finger at more than 0.15 m/s trips (K5).
FASTEST = 140.0
#: Share of the scenes that have a thermal display on the table.
WARM = 0.3

#: The plugin that brings the surface.
TABLE = "xyz-table"
#: Range of the period of the table's exchanges [s]: servos on a fast bus exchange in every tick, others less often.
SHORTEST, LONGEST = 1e-3, 10e-3


def draw(number: int, seed: int, folder: Path) -> tuple[str, Slope]:
    """Return the family and the scene of a number; ``folder`` has the shipped scenes, and the mesh is written there."""
    rng = random.Random(f"surface {seed} {number}")
    family = tuple(FAMILIES)[number % len(FAMILIES)]
    return family, dataclasses.replace(FAMILIES[family](rng, folder), warm=rng.random() < WARM)


def _ramp(rng: random.Random, folder: Path) -> Slope:
    return _with(rng, *ramp(rng.uniform(0.0, STEEPEST), rng.uniform(1.0, 6.0)))


def _ball(rng: random.Random, folder: Path) -> Slope:
    """Return a scene of strokes over a ball, both drawn from wide ranges of speed and size."""
    count = rng.randint(3, 6)
    angles = np.clip(np.cumsum([rng.uniform(-35.0, 35.0) for _ in range(count)]), -70.0, 70.0).tolist()
    radius, deep = rng.uniform(5.0, 100.0), rng.uniform(1.5, 8.0)
    longest = 1.875 * math.radians(np.abs(np.diff([0.0, *angles])).max()) * (radius + RADIUS)
    speed = math.exp(rng.uniform(math.log(10.0), math.log(FASTEST)))
    each = max(min(max(0.1, longest / speed), 8.0 / count), longest / FASTEST)  # a plate withdraws after 10 s (T4)
    return _with(rng, *ball(angles, each, radius, deep))


def _mesh(rng: random.Random, folder: Path) -> Slope:
    return _stroked(rng, meshes.make, folder, rng.choice(meshes.KINDS))


def _shipped(rng: random.Random, folder: Path) -> Slope:
    return _stroked(rng, meshes.shipped, folder, rng.choice(meshes.SHIPPED))


def _edge(rng: random.Random, folder: Path) -> Slope:
    return edges.edge(_seed(rng))


def _rim(rng: random.Random, folder: Path) -> Slope:
    return edges.rim(_seed(rng))


def _moving(rng: random.Random, folder: Path) -> Slope:
    return moved(_seed(rng))


FAMILIES: dict[str, Callable[[random.Random, Path], Slope]] = {
    "ramp": _ramp, "ball": _ball, "mesh": _mesh, "shipped mesh": _shipped, "edge": _edge, "rim": _rim,
    "moving": _moving,
}  # fmt: skip


def _seed(rng: random.Random) -> int:
    return rng.randrange(10**9)


def _with(rng: random.Random, world: str, motion: str) -> Slope:
    return Slope(world, motion, **_material(rng), seed=rng.randint(0, 99))  # type: ignore[arg-type]


def _material(rng: random.Random) -> dict[str, float]:
    return {
        "stiffness": rng.uniform(0.4, 2.0), "friction": rng.choice((0.0, 0.3, 0.8)), "force": rng.uniform(1.0, 3.0),
    }  # fmt: skip


def _stroked(rng: random.Random, make: Callable[..., Slope], folder: Path, kind: str) -> Slope:
    deep, speed, scene = rng.uniform(2.0, 7.0), rng.uniform(15.0, 110.0), _material(rng)
    found = make(folder, kind, _seed(rng), deep=deep, speed=speed, **scene)
    return dataclasses.replace(found, seed=rng.randint(0, 99))


def block(motion: str, shape: str = 'box name="block" pos="0 0 0 mm" size="60 60 10 mm"') -> str:
    """Return the XML of an object that moves: ``motion`` has its targets, ``shape`` its element and attributes."""
    return f'<{shape} material="stuff"><motion>{motion}</motion></{shape.split()[0]}>'


def press(deep: float) -> str:
    """Return the motion of a hand that presses ``deep`` mm into the block for 1.5 s, and lifts."""
    return (
        '<to pos="0 0 25 mm" in="0.1 s" hold="0.1 s"/>'
        f'<to pos="0 0 {13 - deep:.3f} mm" in="0.4 s" hold="1.5 s"/><to pos="0 0 40 mm" in="0.4 s" hold="0.1 s"/>'
    )


def moved(seed: int) -> Slope:
    """Return a scene made from a seed: an object moves to one to three other poses under a finger that presses."""
    rng = random.Random(seed)
    kind = rng.choice(["tilt", "aside", "rise", "mix", "ball"])
    rest = "0 0 -25" if kind == "ball" else "0 0 0"
    moves = [f'<to pos="{rest} mm" in="{rng.uniform(0.7, 1.1):.3f} s"/>']
    for _ in range(rng.randint(1, 3)):
        x, y, z = rng.uniform(-70, 70), rng.uniform(-70, 70), rng.uniform(-25, 3)
        tilt = f"{rng.uniform(-50, 50):.2f} {rng.uniform(-50, 50):.2f} 0 deg"
        to = {
            "tilt": f'0 0 0 mm" rpy="{tilt}',
            "aside": f"{x:.2f} {y:.2f} 0 mm",
            "rise": f"0 0 {z:.2f} mm",
            "mix": f'{0.4 * x:.2f} {0.4 * y:.2f} {0.7 * z:.2f} mm" rpy="{tilt}',
            "ball": f"{0.3 * x:.2f} {0.3 * y:.2f} {0.7 * z - 15:.2f} mm",
        }[kind]
        time = rng.choice([0.1, 0.2, 0.4, 0.8]) * rng.uniform(0.6, 1.4)
        moves.append(f'<to pos="{to}" in="{time:.3f} s" hold="{rng.uniform(0, 0.2):.3f} s"/>')
    shape = 'sphere name="block" pos="0 0 -25 mm" radius="30 mm"' if kind == "ball" else ""
    world = block("".join(moves), shape) if shape else block("".join(moves))
    return Slope(
        world, press(rng.uniform(1.5, 6.0)), friction=rng.choice([0.0, 0.3, 0.8]), stiffness=rng.uniform(0.4, 1.2),
        force=rng.uniform(1.5, 3.0), seed=seed % 100,
    )  # fmt: skip


class Wire(NamedTuple):
    """A wire behind which readings and commands are late, and not in every tick.

    Period of a device's exchanges, and the time that one takes [s], as in `itouch.plugin.Timing`.
    """

    period: float
    delay: float

    def __str__(self) -> str:
        return f"an exchange every {1e3 * self.period:.1f} ms that takes {1e3 * self.delay:.1f} ms"

    def catalog(self) -> Catalog:
        """Return the plugins of this environment, with the table behind this wire."""
        found = dict(find(DEVICES))
        own = found[TABLE]
        wired = type("WiredTable", (own.load(),), {"blocking": True, "period": self.period, "delay": self.delay})
        found[TABLE] = Found(own.name, own.distribution, own.version, _Entry(wired))  # type: ignore[arg-type]
        return Catalog(lambda group: found if group == DEVICES else find(group))


class _Entry:
    value = "a table behind a wire"

    def __init__(self, loaded: type[Device]) -> None:
        self._loaded = loaded

    def load(self) -> type[Device]:
        """Return the device's class."""
        return self._loaded


def draw_wire(number: int, seed: int) -> Wire:
    """Return the wire of a scene's number; the scene itself is the same as without one."""
    rng = random.Random(f"surface wire {seed} {number}")
    period = rng.uniform(SHORTEST, LONGEST)
    return Wire(period, rng.uniform(0.0, period))
