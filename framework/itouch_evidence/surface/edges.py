"""Random edges, roofs, troughs and rims, and strokes on which the contact passes between plate and arm repeatedly."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from itouch_evidence.surface.scenes import RADIUS, Slope

#: A function that returns the height of the centre of a resting finger at x [mm].
Height = Callable[[float], float]

#: Height of the finger's centre where nothing is below it [mm].
BESIDE = 5.0


def edge(seed: int) -> Slope:
    """Return a scene of one or two boxes, a capsule or two balls that a finger strokes over, made from a seed."""
    rng = random.Random(f"prim{seed}")
    kind = rng.choice(["roof", "cylinder", "steps", "boxedge", "trough", "ellipsoid"])
    deep = rng.uniform(2, 6)
    world, rest, ends = {
        "roof": _roof, "cylinder": _capsule, "steps": _steps, "boxedge": _box, "trough": _trough, "ellipsoid": _balls,
    }[kind](rng)  # fmt: skip
    motion = _strokes(rng, rest, ends, deep)
    return _scene(rng, world, motion)


def rim(seed: int) -> Slope:
    """Return a scene of a hand that presses deep and slips off the rim of a box or ball, made from a seed."""
    rng = random.Random(f"rim{seed}")
    deep, speed, tilt = rng.uniform(4, 20), rng.uniform(40, 140), rng.uniform(-20, 20)
    shape, y = rng.choice(["box", "sphere", "sphere"]), rng.uniform(-5, 5)
    if shape == "box":
        world = _block("l", "0 0 5", tilt, "40 60 14")
    else:
        radius = rng.uniform(8, 20)
        world = _sphere("l", f"0 0 {12 - radius:.2f}", radius)
    z, out = 20 - deep, rng.choice([-1, 1]) * rng.uniform(30, 60)
    motion = (
        f'<to pos="0 {y:.2f} 35 mm" in="0.1 s" hold="0.2 s"/><to pos="0 {y:.2f} {z:.2f} mm" in="0.5 s" hold="0.3 s"/>'
        f'<to pos="{out:.2f} {y:.2f} {z + rng.uniform(-4, 4):.2f} mm" in="{1.875 * abs(out) / speed:.3f} s" '
        f'hold="0.3 s"/><to pos="{out:.2f} {y:.2f} 35 mm" in="0.4 s"/>'
    )
    return _scene(rng, world, motion)


def _scene(rng: random.Random, world: str, motion: str) -> Slope:
    return Slope(
        world, motion, stiffness=rng.uniform(0.4, 2.0), friction=rng.choice([0.0, 0.3, 0.8]),
        force=rng.uniform(1.0, 3.0), seed=rng.randint(0, 99), warm=rng.random() < 0.15,
    )  # fmt: skip


def _block(name: str, pos: str, tilt: float, size: str) -> str:
    return f'<box name="{name}" pos="{pos} mm" rpy="0 {tilt} 0 deg" size="{size} mm" material="stuff"/>'


def _sphere(name: str, pos: str, radius: float) -> str:
    return f'<sphere name="{name}" pos="{pos} mm" radius="{radius:.2f} mm" material="stuff"/>'


def _roof(rng: random.Random) -> tuple[str, Height, tuple[float, float]]:
    a, b = rng.uniform(5, 45), rng.uniform(5, 45)
    up, down = math.radians(a), math.radians(b)
    world = _block("l", "-25 0 -10", -a, "70 80 12") + _block("r", "25 0 -10", b, "70 80 12")
    left: Height = lambda x: -10 + (x + 25) * math.tan(up) + 14 / math.cos(up)  # noqa: E731
    right: Height = lambda x: -10 - (x - 25) * math.tan(down) + 14 / math.cos(down)  # noqa: E731
    return world, lambda x: max(left(x), right(x)), (-35.0, 35.0)


def _trough(rng: random.Random) -> tuple[str, Height, tuple[float, float]]:
    a, b = rng.uniform(5, 40), rng.uniform(5, 40)
    down, up = math.radians(a), math.radians(b)
    world = _block("l", "-20 0 0", a, "70 80 12") + _block("r", "20 0 0", -b, "70 80 12")
    left: Height = lambda x: -(x + 20) * math.tan(down) + 14 / math.cos(down)  # noqa: E731
    right: Height = lambda x: (x - 20) * math.tan(up) + 14 / math.cos(up)  # noqa: E731
    return world, lambda x: max(left(x), right(x)), (-25.0, 25.0)


def _round(x: float, middle: float, radius: float) -> float:
    reach = radius + RADIUS
    beside = abs(x - middle) >= reach
    return BESIDE if beside else 15 - radius + math.sqrt(max(0.0, reach**2 - (x - middle) ** 2))


def _capsule(rng: random.Random) -> tuple[str, Height, tuple[float, float]]:
    radius = rng.uniform(10, 35)
    world = (
        f'<capsule name="c" pos="0 0 {15 - radius:.2f} mm" rpy="90 0 0 deg" radius="{radius:.2f} mm" length="90 mm" '
        'material="stuff"/>'
    )
    far = 0.9 * (radius + RADIUS)
    return world, lambda x: _round(x, 0.0, radius), (-far, far)


def _balls(rng: random.Random) -> tuple[str, Height, tuple[float, float]]:
    radius = rng.uniform(14, 30)
    world = _sphere("c", f"-12 0 {15 - radius:.2f}", radius)
    world += _sphere("d", f"{rng.uniform(4, 25):.1f} 4 {12 - radius:.2f}", radius)
    far = 0.8 * (radius + RADIUS)
    return world, lambda x: _round(x, -12.0, radius), (-far - 12, far)


def _steps(rng: random.Random) -> tuple[str, Height, tuple[float, float]]:
    high, tilt = rng.uniform(1, 6), rng.uniform(-15, 15)
    world = _block("l", "-30 0 0", 0.0, "60 80 20") + _block("r", f"30 0 {-high}", tilt, "60 80 20")
    return world, lambda x: 18.0 if x < 0 else 18 - high, (-25.0, 25.0)


def _box(rng: random.Random) -> tuple[str, Height, tuple[float, float]]:
    tilt = rng.uniform(-35, 35)
    turn = math.radians(tilt)
    world = _block("l", "0 0 0", tilt, "40 60 14")
    return world, lambda x: -x * math.tan(turn) + 15 / math.cos(turn) if abs(x) < 20 else 4.0, (-30.0, 30.0)


def _strokes(rng: random.Random, rest: Height, ends: tuple[float, float], deep: float) -> str:
    """Return the motion of a touch and two to four straight strokes between random places, ``deep`` mm in the surface.

    ``rest``: height of the finger's centre along x; ``ends``: the range of x [mm].
    """
    x, y = rng.uniform(*ends), rng.uniform(-8, 8)
    moves = [
        f'<to pos="{x:.2f} {y:.2f} {rest(x) + 15:.2f} mm" in="0.1 s" hold="0.2 s"/>',
        f'<to pos="{x:.2f} {y:.2f} {rest(x) - deep:.2f} mm" in="0.5 s" hold="0.2 s"/>',
    ]
    for _ in range(rng.randint(2, 4)):
        there = rng.uniform(*ends), rng.uniform(-8, 8)
        way = math.hypot(there[0] - x, there[1] - y)
        pieces, speed = max(1, round(way / 8)), rng.uniform(15, 100)
        for i in range(1, pieces + 1):
            at = x + (there[0] - x) * i / pieces
            moves.append(
                f'<to pos="{at:.2f} {y + (there[1] - y) * i / pieces:.2f} {rest(at) - deep:.2f} mm" '
                f'in="{max(0.08, way / pieces / speed):.3f} s"/>'
            )
        x, y = there
    moves.append(f'<to pos="{x:.2f} {y:.2f} {rest(x) + 15:.2f} mm" in="0.4 s"/>')
    return "".join(moves)
