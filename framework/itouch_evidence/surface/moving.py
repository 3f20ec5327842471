"""Objects that come, go, tilt and slide away under a finger that presses, made from a seed."""

from __future__ import annotations

import random

from itouch_evidence.surface.scenes import Slope


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
