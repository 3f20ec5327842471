"""What things look like: finishes, edges, the range of temperatures, the scale bar, words that fit."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from graphics import need_graphics
from hypothesis import given
from hypothesis import strategies as st
from shipped import SCENES

import itouch
from itouch.contact.heightmap import height_map
from itouch_tools.viewer import colours, overlay, solids
from itouch_tools.viewer.finishes import FINISHES, finishes
from itouch_tools.viewer.overlay import TextLines
from itouch_tools.viewer.scales import grid_step, length, titled
from itouch_tools.viewer.scene_graph import SceneGraph
from itouch_tools.viewer.signals import charts
from itouch_tools.viewer.temperatures import Range, degrees

BLOCKS = """<itouch version="1.0">
  <materials>{materials}</materials>
  <defaults><box size="38 38 10 mm"/></defaults>
  <world>{boxes}</world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="5 mm" pose-from="arm" force-to="arm"/></interaction>
</itouch>"""


@pytest.fixture(scope="module")
def plates():
    return itouch.build(SCENES / "texture_and_sound.xml")


def test_a_material_looks_as_its_finish_says_whatever_it_is_called(plates):
    found = finishes(plates.model)
    for material in plates.model.scene.materials:
        assert found[material.name].kind == FINISHES[material.visual.finish]
        assert (found[material.name].carved is not None) == (material.texture is not None)


def test_a_height_map_is_drawn_where_it_is_felt(plates):
    look = finishes(plates.model)["washboard"].carved
    texture = next(m for m in plates.model.scene.materials if m.name == "washboard").texture
    heights = height_map(next(file.data for file in plates.model.files if file.file == texture.file))
    assert look.size[0] == texture.width and look.size[1] / look.size[0] == heights.shape[0] / heights.shape[1]
    np.testing.assert_array_equal(look.heights[::-1], heights.astype(np.float32))  # in pictures rows go upwards
    assert (look.depth, look.axis) == (texture.depth, 2)


@pytest.mark.parametrize(
    ("solid", "length"),
    [
        (solids.box((1.0, 2.0, 3.0)), 48.0),
        (solids.sphere(1.0), 0.0),
        (solids.capsule(1.0, 1.0), 0.0),
        (solids.cylinder(1.0, 2.0), 4 * math.pi),
        (solids.disc(1.0, 0.0, 1.0), 2 * math.pi),
    ],
    ids=["box", "sphere", "capsule", "cylinder", "disc"],
)
def test_edges_are_where_a_solid_bends_sharply(solid, length):
    edges = solids.feature_edges(solid).reshape(-1, 2, 3)
    assert np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum() == pytest.approx(length, rel=5e-3, abs=1e-6)
    assert not len(solids.feature_edges(solid, most=3))


@pytest.mark.parametrize(("step", "count"), [(0.02, 1), (0.01, 7), (1.0, 36)])
def test_the_grid_fades_to_nothing_before_it_ends(step, count):
    lines, strength = solids.grid(count * step, step)
    away = np.linalg.norm(lines[:, :2], axis=1)
    assert strength.max() < 0.61 and (strength[away >= count * step * 0.999] < 1e-4).all()
    assert lines.shape == (len(strength), 3) and len(lines) % 2 == 0
    assert np.linalg.norm(lines[1::2] - lines[::2], axis=1) == pytest.approx(step, rel=1e-3)


@given(st.lists(st.floats(250.0, 390.0), min_size=1, max_size=12))
def test_the_range_of_temperatures_holds_all_and_never_shrinks(given_):
    model = itouch_model(given_[0])
    shown = Range(model)
    before = shown.ends
    for kelvin in given_:
        shown._low, shown._high = min(shown._low, kelvin), max(shown._high, kelvin)
        low, high = shown.ends
        assert low <= before[0] and high >= before[1]
        assert low - 0.31 <= kelvin <= high + 0.31 and high - low >= 9.9
        before = low, high
        assert len(degrees(low, high)) in range(2, 7)
        assert all(low - 1e-6 <= celsius + 273.15 <= high + 1e-6 for celsius in degrees(low, high))
    assert shown.colour(math.nan) == colours.UNKNOWN


@pytest.mark.parametrize("celsius", [20.0, 19.75, 20.25])
def test_the_scale_is_no_wider_than_it_has_to_be(celsius):
    """A quarter of a kelvin beyond a round number asks for no more of the scale."""
    low, high = Range(itouch_model(celsius + 273.15)).ends
    assert (low - 273.15, high - 273.15) == pytest.approx((15.0, 25.0))


class itouch_model:  # noqa: N801 - stands for a Model: a world with a temperature, and nothing in it
    def __init__(self, ambient: float) -> None:
        world = type("World", (), {"temperature": ambient})
        self.scene = type("Scene", (), {"world": world, "objects": ()})


def test_a_few_kelvin_are_told_apart_and_a_broken_sensor_does_not_stretch_the_scale():
    session = itouch.build(SCENES / "four_materials.xml")
    stage = SceneGraph(session.model)
    stage.draws(session.state)
    low, high = stage.range.ends
    assert 10.0 <= high - low <= 25.0
    cold, warm = stage.range.colour(296.15), stage.range.colour(303.15)
    assert max(abs(a - b) for a, b in zip(cold, warm, strict=True)) > 0.2
    state = session.state.copy()
    for wrong in (0.0, math.nan, math.inf, 900.0):
        state["peltier.plate_temperature"] = wrong
        assert all(np.isfinite(draw.colour).all() for draw in stage.draws(state))
        assert stage.range.ends == (low, high)


@given(st.floats(1e-2, 1e7), st.floats(20.0, 900.0))
def test_the_scale_bar_is_a_round_length_that_fits(metre, room):
    metres = length(metre, room)
    assert 0.39 * room <= metres * metre <= room * (1 + 1e-6)
    digits = metres / 10.0 ** math.floor(math.log10(metres) + 1e-9)
    assert any(digits == pytest.approx(one) for one in (1.0, 2.0, 5.0))


def test_the_grid_is_of_round_millimetres():
    assert [grid_step(width) for width in (0.05, 0.2, 0.5)] == pytest.approx([0.01, 0.01, 0.1])


@given(
    st.lists(st.tuples(st.text("abc ", max_size=60), st.sampled_from(["plain", "good", "warn", "bad"])), max_size=12),
    st.integers(3, 50), st.integers(0, 12),
)  # fmt: skip
def test_words_that_have_no_room_are_left_out_and_what_is_wrong_last(lines, width, most):
    kept = overlay.fitted(TextLines(tuple(lines)), width, most).lines
    assert len(kept) == min(most, len(lines)) and all(len(line) <= width for line, _ in kept)
    wrong = sum(weight in ("bad", "warn") for _, weight in lines)
    assert sum(weight in ("bad", "warn") for _, weight in kept) == min(most, wrong)


def test_the_chart_of_temperatures_has_the_skins_and_the_plates_and_no_difference():
    model = itouch.build(SCENES / "four_materials.xml").model
    (found,) = [chart for chart in charts(model, page=True) if chart.title == "temperature"]
    assert [signal.label for signal in found.signals] == ["skin on the object", "skin", "skin, held", "plate"]


def test_a_chart_never_loses_its_unit(plates):
    for chart in charts(plates.model):
        for room in (12, 20, 60):
            said = titled(chart.title, chart.unit, room)
            assert said.endswith(f"[{chart.unit}]") and len(said) <= max(room, len(chart.unit) + 5)


DRAW = """
import sys, numpy as np, itouch
from itouch_tools.viewer.offscreen import Offscreen
pictures = {}
for path in sys.argv[2:]:
    session = itouch.build(path)
    shots = Offscreen(session.model, width=480, height=360)
    choices = shots.picture.choices
    choices.words = choices.curves = choices.names = choices.aids = False
    pictures[path.rpartition("/")[2].removesuffix(".xml")] = shots.shoot(session.state)
    shots.close()
np.savez(sys.argv[1], **pictures)
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Each finish on the same block, seen from the same place: its picture."""
    need_graphics()
    folder = tmp_path_factory.mktemp("finishes")
    for finish in FINISHES:
        contact = '<contact stiffness="1 N/mm"/>'
        material = f'<material name="m">{contact}<visual color="0.6 0.5 0.4" finish="{finish}"/></material>'
        scene = BLOCKS.format(materials=material, boxes='<box name="b" pos="0 0 -5 mm" material="m"/>')
        (folder / f"{finish}.xml").write_text(scene)
    scenes = [str(folder / f"{finish}.xml") for finish in FINISHES]
    hidden = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    words = [sys.executable, "-c", DRAW, str(folder / "out.npz"), *scenes]
    done = subprocess.run(words, capture_output=True, text=True, env=hidden)
    assert done.returncode == 0, done.stderr
    return {name: picture.astype(float) for name, picture in np.load(folder / "out.npz").items()}


def test_no_two_finishes_look_alike(drawn):
    for one in drawn:
        for other in drawn:
            if one < other:
                differs = np.abs(drawn[one] - drawn[other]).max(2) > 12
                assert differs.mean() > 0.04, (one, other)


def test_wood_and_foam_have_a_grain_and_matte_has_none(drawn):
    def rough(picture: np.ndarray) -> float:
        middle = picture[190:230, 160:300].mean(2)
        return float(np.abs(np.diff(middle, axis=0)).mean() + np.abs(np.diff(middle, axis=1)).mean())

    found = {finish: rough(picture) for finish, picture in drawn.items()}
    assert found["matte"] < 0.5 and found["wood"] > 2.0 and found["foam"] > 2.0 and found["metal"] > 0.5, found
