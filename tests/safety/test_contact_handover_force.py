"""Laws of a contact that changes hands: arm and plates together never press a finger harder than the scene allows."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from campaign import seeds
from test_two_devices_per_finger import DISPLAY, SCENE, SECOND, TABLE

import itouch
from itouch.monitors import Trip
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.session import build

BLOCK = '<box name="block" size="60 60 18 mm" pos="0 0 9 mm" material="steel"/>'
#: Flat; round, so that plates come and go with its tilt; and a step that a finger slides over.
WORLDS = {
    "flat": BLOCK,
    "round": '<sphere name="ball" radius="40 mm" pos="0 0 -22 mm" material="steel"/>',
    "step": '<box name="low" size="30 60 15 mm" pos="15 0 7.5 mm" material="steel"/>'
    '<box name="high" size="30 60 18 mm" pos="-15 0 9 mm" material="steel"/>',
}


#: A finger that is faster [m/s] may strike plates so hard that they alone pass the limit; the arm adds nothing then, and
#: what is far beyond trips.
STRIKES = 0.2


def path(dice: random.Random, seconds: float, fastest: float) -> str:
    """Return movements of a finger onto surfaces, along them and off again, no faster than so many m/s."""
    x, z, time = 0.0, 30.0, 0.05
    found = ['<to pos="0 0 30 mm" in="0.05 s"/>']
    while time < seconds:
        down = z > 27.0 or dice.random() < 0.4
        there = dice.uniform(-22.0, 22.0), dice.uniform(18.0, 26.0) if down else dice.uniform(28.0, 36.0)
        way = math.hypot(there[0] - x, there[1] - z) * 1e-3
        took = max(0.04, 1.875 * way / dice.uniform(0.03, fastest))  # minimum jerk: 1.875 times the mean speed
        hold = dice.uniform(0.0, 0.1)
        found.append(f'<to pos="{there[0]:.1f} 0 {there[1]:.1f} mm" in="{took:.3f} s" hold="{hold:.3f} s"/>')
        (x, z), time = there, time + took + hold
    return "".join(found)


def scene(dice: random.Random, surfaces: int, force: float, world: str, seconds: float, fastest: float) -> str:
    """Return a scene of a finger on an arm and so many surfaces, which moves at random."""
    devices = "".join(TABLE.format(n) + DISPLAY.format(n, n, 0) for n in range(1, surfaces + 1))
    if dice.random() < 0.5:
        devices = devices.replace('force-noise="0 N"', "")
    text = SCENE.replace(BLOCK, WORLDS[world]).format(
        devices=devices, probes=SECOND if surfaces > 1 else "", safety=f'force="{force} N"'
    )
    begin, end = text.index("<motion>") + len("<motion>"), text.index("</motion>")
    return text[:begin] + path(dice, seconds, fastest) + text[end:]


def pushes(text: str, surfaces: int, seconds: float, *, strikes: bool = False) -> np.ndarray:
    """Return what the plates press with, all together, and what the arm does, tick by tick, shape (n, 2) [N]."""
    run, found = build(loads(text.encode(), Catalog())), list[tuple[float, float]]()
    pads = [run.state[f"{name}.plate_force"] for name in ("finger", "other")[:surfaces]]
    arm = run.state["arm.sent.wrench"]
    run.taps.append(lambda tick: found.append((sum(p.item() for p in pads), math.hypot(*arm[:3].tolist()))))
    try:
        run.run(seconds)
    except itouch.DeviceFaultError as fault:
        assert strikes and fault.trip is Trip.FINGER_FORCE, fault
    run.close()
    return np.array(found)


def holds(seed: int, seconds: float, fastest: float) -> np.ndarray:
    """Look at one random session; return its pushes."""
    dice = random.Random(seed)
    surfaces, force = dice.choice((1, 2, 2)), dice.choice((0.6, 0.8, 1.0, 1.5, 3.0))
    world = dice.choice(sorted(WORLDS))
    found = pushes(scene(dice, surfaces, force, world, seconds, fastest), surfaces, seconds, strikes=fastest >= STRIKES)
    plates, arm = found.T
    over = plates + arm - (force if fastest < STRIKES else np.maximum(force, plates))
    worst = int(over.argmax())
    assert over[worst] <= 1e-9, f"seed {seed}, {surfaces} on '{world}', {force} N: {over[worst]:.3f} N over at {worst}"
    return found


@pytest.mark.parametrize("seed", seeds(2, 8, first=1))
def test_together_they_press_no_harder_than_the_scene_allows_at_any_tick(seed: int) -> None:
    holds(seed, 1.0, 0.12)


def test_a_finger_that_lands_between_two_plates_and_an_arm_was_the_worst() -> None:
    text = SCENE.format(
        devices="".join(TABLE.format(n) + DISPLAY.format(n, n, 0) for n in (1, 2)),
        probes=SECOND,
        safety='force="0.8 N"',
    )
    plates, arm = pushes(text, 2, 0.6).T
    assert arm.max() > 0.6 and plates.max() > 0.6, "the force changes hands"
    assert (plates + arm).max() <= 0.8


def test_the_pad_of_the_operator_is_that_of_every_probe_on_the_finger() -> None:
    """A plate is brought by a probe without an operator: it was taken for a soft finger, and pressed with 1.5 N."""
    text = SCENE.replace(' surface-to="t1"', "").replace("<operator ", '<operator pad-stiffness="5000 N/m" ')
    devices = TABLE.format(2) + DISPLAY.format(2, 2, 0)
    plates, arm = pushes(text.format(devices=devices, probes=SECOND, safety='force="0.8 N"'), 2, 0.6).T
    assert arm.max() > 0.6 and plates.max() > 0.6
    assert (plates + arm).max() <= 0.8 + 1e-9


@pytest.mark.long
@pytest.mark.parametrize("fastest", [0.12, 0.25])
def test_hundreds_of_hand_overs_keep_to_the_scenes_force(fastest: float) -> None:
    touched = [holds(seed, 2.4, fastest)[:, 0].max() > 0.1 for seed in range(100, 200)]
    assert sum(touched) > 80
