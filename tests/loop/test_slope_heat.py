"""Heat follows what touches the finger, at every moment, on surfaces that are not flat."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from program import program
from shipped import SCENES

from itouch_evidence.surface.course import Floats
from itouch_evidence.surface.scenes import RADIUS, Slope, ramp
from itouch_thermal.boundary import beyond

BALL = 30.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("heat") / "scenes"
    shutil.copytree(SCENES, path)
    return path


def stroke(*degrees: float) -> tuple[str, str]:
    """Return a ball, and a touch of it at the first angle that goes on over the others."""

    def at(angle: float, reach: float) -> str:
        there = math.radians(angle)
        return f"{reach * math.sin(there):.3f} 0 {reach * math.cos(there):.3f} mm"

    away, on = BALL + RADIUS + 12.0, BALL + RADIUS - 4.0
    strokes = "".join(f'<to pos="{at(angle, on)}" in="0.5 s" hold="0.2 s"/>' for angle in degrees[1:])
    return f'<sphere name="ball" pos="0 0 0 mm" radius="{BALL} mm" material="stuff"/>', (
        f'<to pos="{at(degrees[0], away)}" in="0.1 s" hold="1 s"/><to pos="{at(degrees[0], on)}" in="0.4 s"/>'
        f'{strokes}<to pos="{at(degrees[-1], away)}" in="0.4 s" hold="0.05 s"/>'
    )


def rows(folder: Path, slope: Slope, *names: str) -> tuple[list[Floats], dict[str, Any]]:
    """Run a scene to its end; return fields of State by tick, and the report."""
    session = slope.build(folder)
    found = []
    while not session.done:
        session.tick()
        found.append([session.state[name].item() for name in names])
    return list(np.array(found).T), session.report()


@pytest.mark.parametrize("degrees", [(34.0, 8.0), (8.0, 40.0), (34.0, 8.0, 40.0, 5.0)])
def test_heat_follows_the_plate_within_a_contact(folder: Path, degrees: tuple[float, ...]) -> None:
    world, motion = stroke(*degrees)
    names = ("finger.plate", "finger.object", "flux-control.touching", "peltier.twin.true_flux", "flux-control.desired")
    found, report = rows(folder, Slope(world, motion, warm=True), *names)
    plate, touched, touching, flux, desired = found
    (contact,) = report["contacts"]
    on = touched >= 0
    assert (plate[on] > 0).any()
    assert (plate[on] == 0).any()
    assert (touching[on] == plate[on]).all()
    assert not flux[on & (plate == 0)].any()
    assert contact["plate"] is True
    assert contact["mean_flux_W_m2"] == pytest.approx(flux[on & (plate > 0)].mean(), rel=0.1)
    assert contact["peak_flux_W_m2"] == pytest.approx(np.abs(flux[on]).max(), rel=0.02)
    assert (np.abs(desired[on & (plate > 0)][5:]) > 50.0).all()
    assert not desired[on & (plate == 0)].any()


PRESSURE = "<thermal:pressure-resistance/>"
FORCES = ("finger.normal_force", "finger.felt_force", "finger.plate_force", "heat.resistance", "finger.object")


def test_one_press_has_one_resistance_however_stiff_the_object_is(folder: Path) -> None:
    presses = []
    for stiffness in (0.5, 1.5):
        slope = Slope(*ramp(0.0), stiffness=stiffness, warm=True, heat=PRESSURE)
        (virtual, felt, pad, resistance, touched), _ = rows(folder, slope, *FORCES)
        on = np.flatnonzero(touched >= 0)
        begin, hold = on[0], on[len(on) // 2]
        assert felt[begin] == virtual[begin]  # nothing is felt yet
        late = slice(begin + 120, hold)
        assert felt[late] == pytest.approx(pad[late], abs=0.05)
        assert np.abs(np.diff(felt[begin:hold])).max() < 0.15  # blended: no jump
        presses.append((virtual[hold], pad[hold], resistance[hold]))
    (soft, pad_soft, first), (hard, pad_hard, second) = presses
    assert hard > 2.0 * soft
    assert pad_hard == pytest.approx(pad_soft, rel=0.05)
    assert second == pytest.approx(first, rel=0.05)


def test_where_the_arm_renders_the_virtual_force_is_what_is_felt(folder: Path) -> None:
    slope = Slope(*ramp(35.0), warm=True, heat=PRESSURE)
    (virtual, felt, *_), _ = rows(folder, slope, *FORCES)
    assert virtual.max() > 0.5
    assert (felt == virtual).all()


@pytest.mark.parametrize(("seed", "mismatch"), [(0, ""), (3, ""), (1, 'finger-effusivity="0.1"')])
def test_touch_off_neither_cools_nor_warms_the_finger(folder: Path, seed: int, mismatch: str) -> None:
    slope = Slope(*ramp(0.0), warm=True, touch_off=True, error=3.0, seed=seed)
    session = slope.build(folder, f"<thermal:mismatch {mismatch}/>" if mismatch else "")
    state, rows = session.state, []
    truths = [state[f"peltier.twin.true_{name}"] for name in ("flux", "skin", "plate")]
    while not state["ready"].item():
        session.tick()
        rows.append([state["finger.plate_force"].item(), *(truth.item() for truth in truths)])
    force, flux, skin, plate = np.array(rows).T
    felt = force > 0.0
    assert felt.sum() > 300
    assert np.abs(flux).max() < 50.0
    assert np.abs(skin - skin[0]).max() < 0.1
    assert np.abs(plate - skin)[felt].max() < 0.12
    if seed:
        return
    session.run()
    (contact,) = session.report()["contacts"]
    assert contact["plate_ready"] is False or contact["flux_error_rms"] < 0.02
    assert contact["mean_flux_W_m2"] > 1000.0


def test_a_slide_onto_another_material_is_judged_anew_and_told(folder: Path) -> None:
    world = (
        '<box name="first" pos="-30 0 -5 mm" size="60 60 10 mm" material="aluminium"/>'
        '<box name="second" pos="30 0 -5 mm" size="60 60 10 mm" material="polystyrene"/>'
    )
    motion = (
        '<to pos="-15 0 25 mm" in="0.1 s" hold="1.5 s"/><to pos="-15 0 4 mm" in="0.4 s" hold="0.3 s"/>'
        '<to pos="15 0 4 mm" in="0.3 s" hold="0.4 s"/><to pos="15 0 25 mm" in="0.4 s"/>'
    )
    session = Slope(world, motion, warm=True).build(folder)
    session.run()
    report = session.report()
    first, second = report["contacts"]
    assert first["plate_ready"] is True
    assert second["object"] == "second"
    assert second["begin_s"] == first["end_s"]
    assert second["plate_ready"] is False
    assert report["modalities"]["flux-control"]["contacts_before_ready"] == 1
    ended = program("run", folder / "slope.xml", "--pace", "fast")
    assert ended.stdout.count("began before the plate was ready") == 1


@pytest.mark.parametrize(("deep", "speed"), [(4.0, 60.0), (10.0, 100.0), (20.0, 200.0), (15.0, 190.0)])
def test_a_finger_that_slips_off_a_rim_is_let_go_at_once_and_heat_after_the_end_is_told(
    folder: Path, deep: float, speed: float
) -> None:
    world = '<box name="block" pos="0 0 5 mm" size="60 60 10 mm" material="stuff"/>'
    motion = (
        f'<to pos="0 0 30 mm" in="0.1 s" hold="0.8 s"/><to pos="0 0 {18.0 - deep} mm" in="0.5 s" hold="0.3 s"/>'
        f'<to pos="50 0 {18.0 - deep} mm" in="{1.875 * 50.0 / speed} s" hold="0.3 s"/>'
        '<to pos="50 0 40 mm" in="0.3 s" hold="0.1 s"/>'
    )
    slope = Slope(world, motion, friction=0.4 if deep == 15.0 else 0.0, warm=True)
    (touched, pad, flux), report = rows(folder, slope, "finger.object", "finger.plate_force", "peltier.twin.true_flux")
    (contact,) = report["contacts"]
    apart = int(np.flatnonzero(touched >= 0)[-1]) + 1
    assert np.diff(pad[apart - 1 :]).max() <= 0.03  # it only goes
    assert np.abs(np.diff(pad[apart - 1 :])).max() <= 0.1
    lasts = np.flatnonzero(flux)[-1] * 1e-3 - contact["end_s"]
    assert lasts < 0.03
    told = [notice for notice in report["notices"] if "after a contact had ended" in notice]
    assert len(told) == (lasts > 0.5e-3)  # of a single tick too
    if told:
        (after,) = re.findall(r"for (\d+) ms after", told[0])
        assert int(after) == pytest.approx(1e3 * lasts, abs=2.5)  # below 0.05 N nothing is felt


def crossing(angle: float, speed: float, first: str, second: str) -> tuple[str, str]:
    """Return two blocks that meet at x = 0, and a slide over their boundary at an angle [rad] and a speed [mm/s]."""
    x, y = 12.0 * math.cos(angle), 12.0 * math.sin(angle)
    return (
        f'<box name="first" pos="-30 0 -5 mm" size="60 120 10 mm" material="{first}"/>'
        f'<box name="second" pos="30 0 -5 mm" size="60 120 10 mm" material="{second}"/>'
    ), (
        f'<to pos="{-x} {-y} 25 mm" in="0.1 s" hold="0.3 s"/><to pos="{-x} {-y} 4 mm" in="0.4 s" hold="0.3 s"/>'
        f'<to pos="{x} {y} 4 mm" in="{24.0 / speed} s" hold="0.15 s"/><to pos="{x} {y} 25 mm" in="0.3 s"/>'
    )


@settings(
    max_examples=4, derandomize=True, deadline=None, phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
@given(
    angle=st.floats(-0.9, 0.9), speed=st.floats(30.0, 100.0), pressed=st.booleans(),
    pair=st.sampled_from([("aluminium", "polystyrene"), ("polystyrene", "aluminium"), ("pyrex", "polystyrene")]),
)  # fmt: skip
def test_the_desired_flux_does_not_jump_at_a_boundary(
    folder: Path, angle: float, speed: float, pressed: bool, pair: tuple[str, str]
) -> None:
    # Within these angles the whole disc is over the boundary in the end, and each pair differs by more than the noise.
    names = ("heat.desired", "heat.beside_part", "finger.object", "heat.skin_temperature", "heat.resistance")
    slope = Slope(*crossing(angle, speed, *pair), warm=True, heat=PRESSURE if pressed else "")
    (desired, part, touched, skin, resistance), report = rows(folder, slope, *names)
    first, second = report["contacts"]
    assert (first["object"], second["object"]) == ("first", "second")
    assert second["begin_s"] == first["end_s"]  # events stay END and BEGIN in one tick
    assert 0.4 < part.max() <= 1.0
    begin, end = (int(np.flatnonzero(touched >= 0)[i]) for i in (0, -1))
    settled = slice(begin + 150, end - 250)
    assert not part[end - 250 - 20]  # it is on the second one alone in the end
    change = float(np.ptp(desired[settled]))
    assert change > 1000.0
    assert np.abs(np.diff(desired[settled])).max() < 0.04 * change
    assert np.abs(np.diff(skin[settled])).max() < 0.02
    assert np.isfinite(resistance[settled]).all()


def test_the_part_of_a_disc_beyond_a_line_is_that_of_its_area() -> None:
    x, y = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 400_000))
    inside = x * x + y * y < 1.0
    for distance in (-1.2, -0.7, 0.0, 0.3, 0.9, 1.0):
        drawn = (x[inside] > distance).mean()
        assert beyond(distance * 0.005, math.pi * 0.005**2) == pytest.approx(drawn, abs=3e-3)
