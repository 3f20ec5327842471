"""A finger on the boundary of two objects: one skin, from which both draw, at any rate of the servo and of the heat."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import itouch
from itouch_thermal.heat import FINGER

#: Conductivity, density and specific heat.
MATERIALS = {"aluminium": (200.0, 2750.0, 900.0), "wood": (0.11, 415.0, 2720.0)}
_SCENE = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <materials>{materials}</materials>
  <world temperature="23 degC">
    <box name="first"  pos="-25 0 9 mm" size="50 60 18 mm" material="aluminium"/>
    <box name="second" pos="25 0 {middle} mm"  size="50 60 {height} mm" material="{second}"/>
  </world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="33 degC">
      <motion>{motion}</motion>
    </operator>
    <thermal:heat probe="finger" contact-resistance="{resistance}"/>
  </interaction>
  <rates servo="{servo} Hz" heat="{heat} Hz"/>
</itouch>
"""
DOWN = '<to pos="{x} 0 40 mm" in="0.1 s" hold="0.1 s"/><to pos="{x} 0 18 mm" in="0.3 s" hold="0.3 s"/>'
BACK = '<to pos="-20 0 18 mm" in="0.9 s" hold="0.3 s"/><to pos="20 0 18 mm" in="0.6 s" hold="0.1 s"/>'


def touched(
    folder: Path, motion: str, *names: str, servo: int = 1000, heat: int = 0, resistance: str = "0",
    second: str = "wood", step: float = 0.0,
) -> list[np.ndarray]:  # fmt: skip
    """Return what the model finger underwent, at the ends of its own steps; the second object's top is a step lower.

    ``step`` [mm].
    """
    thermal = (
        f'<material name="{name}"><contact stiffness="1 N/mm" damping="2 N*s/m" static-friction="0.1" '
        f'dynamic-friction="0.1"/><thermal:material conductivity="{k}" density="{rho}" specific-heat="{c}"/></material>'
        for name, (k, rho, c) in MATERIALS.items()
    )
    bare = '<material name="bare"><contact stiffness="1 N/mm" static-friction="0.1" dynamic-friction="0.1"/></material>'
    path = folder / "boundary.xml"
    path.write_text(
        _SCENE.format(
            materials="".join(thermal) + bare, motion=motion, servo=servo, heat=heat or servo, resistance=resistance,
            second=second, middle=9.0 - 0.5 * step, height=18.0 - step,
        ),
        encoding="utf-8",
    )  # fmt: skip
    engine = itouch.build(path, seed=1)
    every = servo // (heat or servo)
    found: list[list[float]] = [[] for _ in names]
    while not engine.done:
        tick = engine.ticks
        engine.tick()
        if tick % every == 0:
            for values, name in zip(found, names, strict=True):
                values.append(engine.state[name].item())
    return [np.array(values) for values in found]


@pytest.mark.parametrize(("servo", "heat"), [(250, 250), (1000, 1000), (4000, 4000), (1000, 50)])
def test_the_skin_between_two_objects_is_where_three_half_spaces_meet(tmp_path: Path, servo: int, heat: int) -> None:
    """At first finger and objects are half-spaces, and the contact has the mean of their temperatures by effusivity."""
    names = ("heat.skin_temperature", "heat.beside_part", "heat.resistance")
    skin, part, resistance = touched(tmp_path, DOWN.format(x=0), *names, servo=servo, heat=heat)
    begin = int(np.flatnonzero(np.isfinite(resistance))[0])
    early = slice(begin, begin + max(1, round(0.05 * heat)))
    assert part[early] == pytest.approx(0.5, abs=0.02)
    beside = sum(0.5 * math.sqrt(math.prod(values)) for values in MATERIALS.values())
    own = FINGER[0].effusivity
    expected = (own * skin[begin - 1] + beside * 296.15) / (own + beside)
    assert skin[early] == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("resistance", ["0", "1e-4 m^2*K/W"])
def test_the_flux_of_a_slide_over_a_boundary_hardly_depends_on_the_rate(tmp_path: Path, resistance: str) -> None:
    means = []
    for servo in (250, 1000):
        names, motion = ("heat.desired", "heat.beside_part"), DOWN.format(x=20) + BACK
        desired, part = touched(tmp_path, motion, *names, servo=servo, resistance=resistance)
        back = (part > 0.0) & (part < 1.0) & (np.arange(len(part)) > 1.7 * servo)
        means.append(desired[back].mean())
    assert means[0] == pytest.approx(means[1], rel=0.02)


def test_on_the_edge_of_an_object_without_heat_the_rest_of_the_finger_is_in_air(tmp_path: Path) -> None:
    """So at first the skin is where the finger meets half of an object, however long the steps are."""
    names = ("heat.skin_temperature", "heat.resistance")
    for servo in (250, 2000):
        skin, resistance = touched(tmp_path, DOWN.format(x=0), *names, servo=servo, second="bare")
        begin = int(np.flatnonzero(np.isfinite(resistance))[0])
        own, beside = FINGER[0].effusivity, 0.5 * math.sqrt(math.prod(MATERIALS["aluminium"]))
        expected = (own * skin[begin - 1] + beside * 296.15) / (own + beside)
        assert skin[begin : begin + round(0.05 * servo)] == pytest.approx(expected, abs=0.05), servo


@pytest.mark.parametrize("step", [0.005, 0.01, 0.02, 0.05, 0.1, 0.3, 0.8])
def test_the_flux_does_not_jump_where_the_tops_of_two_objects_differ(tmp_path: Path, step: float) -> None:
    """A finger that slides up a step and down again is on both for a while, as on level tops."""
    greatest = []
    for height in (0.0, step):
        motion, resistance = DOWN.format(x=20) + BACK, "1e-4 m^2*K/W"
        (desired,) = touched(tmp_path, motion, "heat.desired", resistance=resistance, step=height)
        change = np.abs(np.diff(desired[800:]))
        greatest.append(change.max() / (desired[800:].max() - desired[800:].min()))
    assert greatest[0] < 0.05  # a finger that goes over a rim is quicker
    assert greatest[1] < 0.1
