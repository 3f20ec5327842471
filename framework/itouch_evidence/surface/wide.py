"""Random scenes of a wider kind: other rates, fingers, sensors and clearances, a touch-off, neighbours and bodies."""

from __future__ import annotations

import dataclasses
import math
import random
import re
from collections.abc import Callable
from pathlib import Path

from itouch_evidence.surface.draw import FAMILIES, WARM
from itouch_evidence.surface.scenes import HIGHEST, RADIUS, Slope

#: Rates of the loop [Hz].
RATES = (1000, 2000, 4000)
#: How often each of the other dimensions is drawn: mostly one or two at a time, so that a cause can be told.
OFTEN = 0.3
#: The same of a touch-off, which takes seconds of each scene.
CALIBRATED = 0.15
#: Range of the clearance of a withdrawn plate, and of the finger's radius [mm].
CLEARANCES, RADII = (1.0, 30.0), (4.0, 14.0)
#: Range of the pad's stiffness [N/m] and damping [N s/m].
PADS, DAMPINGS = (300.0, 2500.0), (0.0, 4.0)
#: Greatest noise of the plate's force sensor [mN]: eight times that of the table's twin.
NOISIEST = 40.0
#: Longest time constant of a press [s].
LONGEST_PRESS = 0.5
#: Greatest error of the height at which the table is mounted [mm], which the touch-off finds.
GREATEST_ERROR = 3.0
#: How long the hand waits in the air for the touch-off [s].
WAITS = 9.0
#: Range of the step between two neighbours [mm].
STEPS = (0.003, 1.0)

_SOFTER = """
    <material name="softer" base="polystyrene">
      <contact stiffness="{stiffness:.3f} N/mm" damping="2 N*s/m" static-friction="{friction}"
               dynamic-friction="{friction}"/>
    </material>"""


def draw_wide(number: int, seed: int, folder: Path) -> tuple[str, Slope]:
    """Return the family and the scene of a number; ``folder`` has the shipped scenes, and a mesh is written there."""
    rng = random.Random(f"surface wide {seed} {number}")
    family = tuple(WIDE)[number % len(WIDE)]
    scene = dataclasses.replace(WIDE[family](rng, folder), warm=rng.random() < WARM)
    return family, _widened(rng, scene)


def widths(scene: Slope) -> str:
    """Return in words what of a scene is other than in the scenes that are not wide."""
    stiffness, damping = scene.pad or (0.0, 0.0)
    said = (
        (scene.rate is not None, f"{scene.rate} Hz"),
        (scene.radius != RADIUS, f"a finger of {scene.radius:g} mm"),
        (scene.pad is not None, f"a pad of {stiffness:g} N/m and {damping:g} N s/m"),
        (scene.clearance is not None, f"a clearance of {scene.clearance} mm"),
        (scene.noise is not None, f"a force sensor with {scene.noise} mN of noise"),
        (scene.touch_off, f"a touch-off that finds {scene.error:g} mm"),
        (scene.press is not None, f"a press of {scene.press} s"),
        (bool(scene.heat), "heat by a law of pressure"),
    )
    return ", ".join(text for holds, text in said if holds)


def _widened(rng: random.Random, scene: Slope) -> Slope:
    """Return a scene with other numbers, all of which are drawn, so that one more changes none of the others."""
    rate, radius, clearance = rng.choice(RATES), round(rng.uniform(*RADII), 1), round(_spread(rng, *CLEARANCES), 1)
    pad = round(_spread(rng, *PADS)), round(rng.uniform(*DAMPINGS), 2)
    noise, error = round(rng.uniform(0.0, NOISIEST), 1), round(rng.uniform(-GREATEST_ERROR, GREATEST_ERROR), 2)
    press, law = round(rng.uniform(0.05, LONGEST_PRESS), 2), rng.random() < OFTEN
    of_all = {"radius": radius, "clearance": clearance, "pad": pad, "noise": noise, "press": press}
    found: dict[str, object] = {name: value for name, value in of_all.items() if rng.random() < OFTEN}
    if not scene.warm:
        found.pop("press", None)
    elif law:
        found["heat"] = "<thermal:pressure-resistance/>"
    if "radius" in found:
        found["motion"] = _raised(scene.motion, radius - RADIUS)
    if rng.random() < CALIBRATED and "<motion>" not in scene.world:  # an object would have moved before it ends
        held = waiting(str(found.get("motion", scene.motion)))
        found |= {"touch_off": True, "error": error, "motion": held}
    return dataclasses.replace(scene, rate=rate, **found)  # type: ignore[arg-type]


def _spread(rng: random.Random, low: float, high: float) -> float:
    """Return a number that is as likely in each part of a range that is as many times as long."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _raised(motion: str, more: float) -> str:
    """Return the motion of a finger whose radius is greater by ``more`` [mm]: it presses about as deep as before."""
    return re.sub(
        r'pos="(\S+) (\S+) (\S+) mm"', lambda to: f'pos="{to[1]} {to[2]} {float(to[3]) + more:.3f} mm"', motion
    )


def waiting(motion: str) -> str:
    """Return a motion that stays at its first target, in the air, until the touch-off has ended."""
    return re.sub(r'hold="\S+ s"', f'hold="{WAITS:g} s"', motion, count=1)


def _softer(rng: random.Random) -> str:
    return _SOFTER.format(stiffness=rng.uniform(0.3, 1.5), friction=rng.choice((0.0, 0.3, 0.8)))


def _material(rng: random.Random) -> dict[str, float]:
    return {
        "stiffness": rng.uniform(0.4, 2.0), "friction": rng.choice((0.0, 0.3, 0.8)), "force": rng.uniform(1.0, 3.0),
    }  # fmt: skip


def _neighbours(rng: random.Random, folder: Path) -> Slope:
    """Return a scene of two to four boxes of two materials side by side, a little higher or lower each, with gaps."""
    count, wide, parts, tops = rng.randint(2, 4), rng.uniform(12.0, 30.0), [], []
    for i in range(count):
        high = 6.0 + rng.choice((-1.0, 0.0, 1.0)) * _spread(rng, *STEPS)
        gap, x = rng.choice((0.0, 0.0, rng.uniform(-3.0, 3.0))), (i + 0.5 - 0.5 * count) * wide
        material = ("stuff", "softer")[i % 2]
        parts.append(
            f'<box name="part{i}" pos="{x:.3f} 0 {high / 2:.4f} mm" size="{wide - gap:.3f} 60 {high:.4f} mm" '
            f'material="{material}"/>'
        )
        tops.append((x, high + RADIUS))
    motion = _along(rng, tops, 0.5 * wide)
    return Slope("".join(parts), motion, **_material(rng), materials=_softer(rng), seed=rng.randint(0, 99))  # type: ignore[arg-type]


def _along(rng: random.Random, tops: list[tuple[float, float]], beyond: float) -> str:
    """Return a touch and one to three strokes along objects whose middles [mm] have these heights of a resting finger.

    ``beyond``: how far beyond the outer ones' middles a stroke may go [mm].
    """
    deep, speed = rng.uniform(1.0, 5.0), _spread(rng, 3.0, 100.0)
    x, high = tops[0]
    moves = [
        f'<to pos="{x:.2f} 0 {high + 20.0:.2f} mm" in="0.1 s" hold="0.2 s"/>',
        f'<to pos="{x:.2f} 0 {high - deep:.2f} mm" in="0.5 s" hold="0.2 s"/>',
    ]
    for _ in range(rng.randint(1, 3)):
        to = rng.uniform(tops[0][0] - 0.5 * beyond, tops[-1][0] + 0.5 * beyond)
        time = min(2.5, max(0.1, 1.875 * abs(to - x) / speed))
        moves.append(
            f'<to pos="{to:.2f} {rng.uniform(-5, 5):.2f} {high - deep:.2f} mm" in="{time:.3f} s" hold="0.1 s"/>'
        )
        x = to
    return "".join((*moves, f'<to pos="{x:.2f} 0 {high + 20.0:.2f} mm" in="0.4 s"/>'))


def _body(rng: random.Random, folder: Path) -> Slope:
    """Return a scene of a box or a ball that lies on a floor, and is pressed and pushed."""
    wide, high, mass = rng.uniform(20.0, 50.0), rng.uniform(10.0, 0.45 * HIGHEST), rng.choice((20, 100, 500))
    kind, shape, top = rng.choice((
        ("box", f'pos="0 0 {high / 2:.2f} mm" size="{wide:.1f} {wide:.1f} {high:.1f} mm"', high),
        ("sphere", f'pos="0 0 {high:.2f} mm" radius="{high:.2f} mm"', 2.0 * high),
    ))  # fmt: skip
    world = (
        '<box name="floor" pos="0 0 -5 mm" size="200 120 10 mm" material="softer"/>'
        f'<{kind} name="body" {shape} material="stuff"><dynamics mass="{mass} g" friction="{rng.choice((0.1, 0.5))}"/>'
        f"</{kind}>"
    )
    rest, deep = top + RADIUS, rng.uniform(1.0, 4.0)
    pushes = "".join(
        f'<to pos="{rng.uniform(-20, 20):.2f} {rng.uniform(-10, 10):.2f} {rest - deep:.2f} mm" '
        f'in="{rng.uniform(0.3, 1.0):.2f} s"/>'
        for _ in range(rng.randint(0, 3))
    )
    motion = (
        f'<to pos="0 0 {rest + 17.0:.2f} mm" in="0.1 s" hold="0.4 s"/>'
        f'<to pos="0 0 {rest - deep:.2f} mm" in="0.5 s" hold="0.2 s"/>{pushes}'
        f'<to pos="0 0 {rest + 22.0:.2f} mm" in="0.4 s" hold="0.1 s"/>'
    )
    return Slope(world, motion, **_material(rng), materials=_softer(rng), seed=rng.randint(0, 99))  # type: ignore[arg-type]


WIDE: dict[str, Callable[[random.Random, Path], Slope]] = {**FAMILIES, "neighbours": _neighbours, "body": _body}
