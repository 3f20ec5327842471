"""What the picture says, without drawing it."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch_tools.viewer import chart_layout, colours, menu, overlay, solids, temperatures
from itouch_tools.viewer.camera import VIEWS, Camera
from itouch_tools.viewer.overlay import SessionStatus
from itouch_tools.viewer.scene_graph import SceneGraph, along, arrow
from itouch_tools.viewer.signals import Ring


def volume(solid: solids.Solid) -> float:
    corners = solid.positions.astype(float)[solid.faces]
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


def test_what_is_shown_is_determined_without_graphics():
    """So it is in a process of its own: what draws asks for a display when it is imported."""
    rooms = ("scene_graph", "camera", "signals", "overlay", "chart_layout", "menu", "colours", "solids")
    script = f"import {', '.join(f'itouch_tools.viewer.{room}' for room in rooms)}, sys; print('pyglet' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.mark.parametrize(
    ("solid", "expected"),
    [
        (solids.box((1.0, 2.0, 3.0)), 48.0),
        (solids.sphere(1.0), 4 / 3 * np.pi),
        (solids.cylinder(1.0, 2.0), 4 * np.pi),
        (solids.capsule(1.0, 2.0), 4 * np.pi + 4 / 3 * np.pi),
        (solids.cone(1.0, 3.0), np.pi),
    ],
)
def test_solids_are_closed_look_outwards_and_have_their_volume(solid, expected):
    assert volume(solid) == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0, atol=1e-6)
    corners = solid.positions[solid.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    agree = (flat[:, None, :] * solid.normals[solid.faces]).sum(2)
    assert (agree >= -1e-7).all()


def test_a_mesh_is_smooth_where_it_bends_little_and_sharp_at_edges():
    box = solids.box((1.0, 1.0, 1.0))
    corners, index = np.unique(box.positions, axis=0, return_inverse=True)
    drawn = solids.from_mesh(corners.astype(float), index.reshape(-1)[box.faces].reshape(-1, 3))
    flat = np.cross(*(drawn.positions[drawn.faces][:, i] - drawn.positions[drawn.faces][:, 0] for i in (1, 2)))
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose(drawn.normals[drawn.faces], np.repeat(flat[:, None], 3, 1), atol=1e-6)
    ball = solids.sphere(1.0)
    corners, index = np.unique(np.round(ball.positions, 6), axis=0, return_inverse=True)
    drawn = solids.from_mesh(corners.astype(float), index.reshape(-1)[ball.faces].reshape(-1, 3))
    assert len(drawn.positions) == len(corners)
    assert (drawn.normals * drawn.positions).sum(1).min() > 0.99


@pytest.mark.parametrize("view", VIEWS)
def test_the_target_is_in_the_middle_of_every_view(view):
    camera = Camera(target=(0.1, -0.2, 0.3))
    camera.look(view)
    assert camera.project(np.array(camera.target), 800, 600) == pytest.approx((400, 300))
    right = camera.view()[:3, :3]
    np.testing.assert_allclose(right @ right.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(right) == pytest.approx(1.0)


def test_orbit_pan_zoom_and_frame():
    camera = Camera()
    assert camera.eye[1] < 0 < camera.eye[2]  # on the operator's side, above
    camera.orbit(0, 500)
    assert -90 < camera.elevation < 90
    camera = Camera(elevation=0.0)
    before = camera.project(np.zeros(3), 100, 100)
    camera.pan(0.25, 0.0)
    after = camera.project(np.zeros(3), 100, 100)
    assert after[0] - before[0] == pytest.approx(25)
    near = camera.distance
    camera.zoom(3)
    assert camera.distance == pytest.approx(near * 0.9**3)
    camera.frame(np.array([-1.0, -1, -1]), np.array([1.0, 1, 1]), 1.5)
    places = [camera.project(np.array([x, y, z]), 300, 200) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    assert all(0 <= x <= 300 and 0 <= y <= 200 for x, y in places)


def test_what_is_behind_the_eye_has_no_place():
    camera = Camera()
    assert camera.project(2 * camera.eye, 100, 100) is None


def test_warmer_is_lighter_everywhere():
    kelvin = np.linspace(colours.COLD - 5, colours.WARM + 5, 200)
    light = [0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in map(colours.of_temperature, kelvin)]
    assert (np.diff(light) >= 0).all()
    assert light[-1] - light[0] > 0.6


@pytest.fixture(scope="module")
def session():
    running = itouch.build(SCENES / "four_materials.xml")
    running.run(3.0)
    return running


def test_the_stage_shows_every_object_the_finger_and_the_plate(session):
    stage = SceneGraph(session.model)
    draws = stage.draws(session.state)
    assert {draw.owner for draw in draws} >= {*session.model.objects, "peltier"}
    assert all(draw.solid in stage.solids for draw in draws)
    assert all(np.isfinite(draw.matrix).all() for draw in draws)
    low, high = stage.bounds(session.state)
    assert (low <= np.array([-0.1, -0.06, -0.01]) + 1e-6).all() and (high >= np.array([0.1, 0.06, 0.022]) - 1e-6).all()
    top = max(
        (draw.matrix @ np.append(stage.solids[draw.solid].positions.max(0), 1))[2]
        for draw in draws
        if draw.owner == "peltier"
    )
    assert top == pytest.approx(float(session.state["finger.plate_top"]), abs=1e-3)


def test_temperature_colours_tell_objects_apart(tmp_path, session):
    stage = SceneGraph(session.model)
    plain = {draw.owner: draw.colour for draw in stage.draws(session.state)}
    thermal = {draw.owner: draw.colour for draw in stage.draws(session.state, thermal=True)}
    assert plain["wood"] != plain["pyrex"]
    assert thermal["wood"] == thermal["pyrex"] == stage.range.colour(296.15)
    assert {draw.finish for draw in stage.draws(session.state, thermal=True)} == {0}  # colour alone tells there


def test_a_direction_that_is_none_has_a_frame_that_is_not_turned():
    frame = along(np.zeros(3), np.array([0.1, 0.2, 0.3]))
    assert frame[:3, :3].tolist() == np.eye(3).tolist() and frame[:3, 3].tolist() == [0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("unit sphere", -np.ones(3), np.ones(3)), ("unit box", -np.full(3, 0.5), np.full(3, 0.5)),
     ("shaft", (-1.0, -1.0, -0.5), (1.0, 1.0, 0.5)), ("tip", (-1.0, -1.0, 0.0), (1.0, 1.0, 1.0)),
     ("disc", (-1.0, -1.0, 0.0), (1.0, 1.0, 0.0))],
)  # fmt: skip
def test_what_is_drawn_at_any_size_is_a_unit_large_and_stands_at_its_own_origin(session, name, low, high):
    places = SceneGraph(session.model).solids[name].positions
    assert places.min(0) == pytest.approx(low, abs=0.02) and places.max(0) == pytest.approx(high, abs=0.02)


def test_the_force_arrow_has_its_direction_and_grows_with_it():
    assert not list(arrow(np.zeros(3), np.zeros(3)))
    for force in (np.array([1.0, 2.0, -0.5]), np.array([0.0, 0.0, 3.0]), np.array([-1.0, 0.0, 0.0])):
        shaft, tip = arrow(np.array([0.1, 0.2, 0.3]), force)
        end = tip.matrix @ [0, 0, 1, 1]
        way = end[:3] - [0.1, 0.2, 0.3]
        np.testing.assert_allclose(way / np.linalg.norm(way), force / np.linalg.norm(force), atol=1e-9)
        assert np.linalg.norm(way) == pytest.approx(min(0.08, 0.02 * np.linalg.norm(force)))
        assert np.linalg.det(along(force / np.linalg.norm(force), np.zeros(3))[:3, :3]) == pytest.approx(1.0)


def test_the_ring_keeps_ten_seconds_of_what_the_session_measured(session):
    ring = Ring(session.model)
    assert [chart.title for chart in ring.charts] == ["force", "heat flux out of the finger", "current", "temperature"]
    running = itouch.build(SCENES / "four_materials.xml")
    fluxes = {}

    def note() -> None:
        ring.add(running.state)
        fluxes[int(running.state["tick"])] = float(running.state["flux-control.desired"])

    running.run(12.0, each=note)
    chart = ring.charts[1]
    times, values = ring.curves(chart)
    assert times[-1] - times[0] == pytest.approx(10.0, abs=0.02)
    assert (np.diff(times) > 0).all()
    desired = values[[signal.label for signal in chart.signals].index("desired")]
    assert desired.tolist() == [fluxes[round(time * 1000)] for time in times]


def test_a_session_that_begins_again_begins_its_curves_again(session):
    ring = Ring(session.model)
    ring.add(session.state)
    other = itouch.build(SCENES / "four_materials.xml")
    other.run(0.1, each=lambda: ring.add(other.state))
    times, _ = ring.curves(ring.charts[0])
    assert times[0] < 0.02 and len(times) == 10


def test_what_the_machine_does_to_find_its_heights_is_marked(session):
    ring, state = Ring(session.model), session.state.copy()
    for tick in range(0, 14000, 10):
        state["tick"], state["ready"] = tick, not 500 <= tick < 3000
        ring.add(state)
        if tick == 2000:
            assert ring.preparing() == [(0.5, 2.0)]  # under way
        if tick == 9000:
            assert ring.preparing() == [(0.5, 3.0)]
        if tick == 12000:
            assert ring.preparing() == [(2.0, 3.0)]  # the rest of it is too long ago
    assert ring.preparing() == []
    again = Ring(session.model)
    for tick in range(0, 1000, 10):  # the one tick in which a rig without a touch-off says that it is ready
        state["tick"], state["ready"] = tick, tick > 0
        again.add(state)
    assert again.preparing() == []


def test_the_overlay_names_devices_contact_and_faults(session):
    now = SessionStatus("real", tick_us=50.0, overruns=3)
    text = "\n".join(line for line, _ in overlay.status(session.model, session.state, now).lines)
    for part in ("arm: enabled (simulated)", "peltier: plate", "degC", "3 overruns", "1000 Hz", "tick p99 50 us"):
        assert part in text
    now.faults = [{"trip": "over-temperature", "device": "peltier", "cause": "is at 46 degC"}]
    said = overlay.alarm(now, 200)
    assert said is not None
    assert ("FAULT over-temperature: device 'peltier' is at 46 degC", "bad") in said.lines
    assert any("R re-arms" in line for line, _ in said.lines)
    narrow = overlay.alarm(now, 24)
    assert narrow is not None and max(len(line) for line, _ in narrow.lines) <= 24
    assert " ".join(line for line, weight in narrow.lines if weight == "bad") == said.lines[0][0]
    still = overlay.alarm(SessionStatus(faults=now.faults), 200)
    assert still is not None and still.lines[0] == said.lines[0]
    assert not any("R re-arms" in line for line, _ in still.lines)  # nobody can press a key in a picture
    assert overlay.alarm(SessionStatus(), 80) is None


def test_before_the_first_reading_no_temperature_of_a_plate_is_told():
    """As `inspect --picture` draws a scene: until then a reading is 0 K."""
    unread = itouch.build(SCENES / "four_materials.xml")
    text = "\n".join(line for line, _ in overlay.status(unread.model, unread.state, SessionStatus()).lines)
    assert "peltier: open (simulated)" in text and "degC" not in text and "flux-control" not in text
    assert list(temperatures.present(unread.state, unread.model)) == []


def test_properties_of_objects_and_devices(session):
    words = [line for line, _ in overlay.properties(session.model, session.state, "pyrex").lines]
    assert "material: pyrex" in words and "position: -22.0 0.0 9.0 mm" in words
    words = [line for line, _ in overlay.properties(session.model, session.state, "peltier").lines]
    for channel in ("plate_temperature", "skin_temperature", "sink_temperature"):
        celsius = session.state[f"peltier.{channel}"].item() - 273.15
        assert any(line.startswith(f"{channel}: {celsius:.4g} degC (") for line in words)
    place = session.state["table.pose"][:3]
    millimetres = " ".join(f"{1e3 * value:.4g}" for value in place)
    words = [line for line, _ in overlay.properties(session.model, session.state, "table").lines]
    assert any(line.startswith(f"pose: {millimetres} mm") for line in words)


def test_curves_are_of_the_last_ten_seconds_however_few_pictures_there_are(session):
    """A window that draws once in some seconds has samples far apart: what is too old is left out, and cut."""
    ring, state = Ring(session.model), session.state.copy()
    name = "flux-control.desired"
    for second in (0, 4, 8, 12, 13, 30, 33, 41):
        state["tick"], state[name] = second * 1000, float(second)
        ring.add(state)
        chart = ring.charts[1]
        times, values = ring.curves(chart)
        assert times[-1] == second and times[0] >= second - 10.0
        assert values.shape == (len(chart.signals), len(times)) and (np.diff(times) > 0).all()
    desired = values[[signal.label for signal in chart.signals].index("desired")]
    assert times.tolist() == [31.0, 33.0, 41.0]
    assert desired == pytest.approx([31.0, 33.0, 41.0])  # the first is on the line between 30 and 33


def test_a_skin_that_cannot_be_measured_is_shown_as_held(session):
    ring = Ring(session.model)
    (chart,) = [chart for chart in ring.charts if chart.unit == "degC"]
    labels = [signal.label for signal in chart.signals]
    own = next(label for label in labels if f"{label}, held" in labels)
    free, held = (chart.signals[labels.index(label)] for label in (own, f"{own}, held"))
    state = session.state.copy()
    state["peltier.skin_temperature"] = 305.15
    for valid, shown, other in ((1.0, free, held), (0.0, held, free)):
        state["peltier.skin_valid"] = valid
        assert shown.read(state) == pytest.approx(32.0) and np.isnan(other.read(state))
    assert held.dashed and free.colour == held.colour and "last value" in held.doc


def test_the_first_line_says_what_is_felt(session):
    state = session.state.copy()
    state["finger.object"] = session.model.objects.index("wood")
    state["finger.total_force"], state["finger.force"] = 0.9, (0.0, 0.0, 1.85)
    state["peltier.heat_flux"], state["flux-control.desired"] = 827.0, 826.0
    assert overlay.headline(session.model, state) == "finger on wood, 0.9 N felt, 827 W/m2; desired 826"
    state["peltier.heat_flux"] = 500.0
    assert overlay.headline(session.model, state).endswith(", 500 W/m2 (61 %); desired 826")
    index, objects = session.model.objects.index("wood"), session.model.scene.objects
    called = SimpleNamespace(objects=["block"] * len(objects), scene=session.model.scene)
    assert overlay._named(called, index) == "block (wood)"
    words = "\n".join(line for line, _ in overlay.status(session.model, state, SessionStatus()).lines)
    assert "touches wood, 0.90 N felt (1.85 N in the virtual world)" in words
    state["finger.object"], state["finger.near_object"], state["finger.near_distance"] = -1, 0, 0.0123
    assert overlay.headline(session.model, state) == f"finger 12 mm from {session.model.objects[0]}"
    state["finger.near_object"] = -1
    assert overlay.headline(session.model, state) == "finger free"


def test_the_plate_is_seen_through_while_something_is_touched(session):
    state = session.state.copy()
    for touched, opaque in ((-1, True), (1, False)):
        state["finger.object"] = touched
        plates = [draw for draw in SceneGraph(session.model).draws(state) if draw.owner == "peltier"]
        assert plates and all((draw.opacity == 1.0) == opaque for draw in plates)


def test_the_keys_fit_beside_the_scene():
    for width in (40, 55, 120):
        lines = [row.text for row in menu.rows(width=width)]
        assert max(map(len, lines)) <= width
    assert all(any(line.startswith(key) for line in lines) for key in overlay.KEYS)


@pytest.mark.parametrize("playback", [False, True])
@pytest.mark.parametrize("width", [40, 120])
def test_the_menu_presses_every_key_and_no_two_at_once(playback, width):
    listed = menu.rows(playback=playback, width=width)
    by_mouse = {"Drag", "Wheel", "Click", "Point", "Time line"}
    assert {row.keys for row in listed if row.presses} == {row.keys for row in listed} - by_mouse
    area = (700.0, 10.0, 9.0 * width, 900.0)
    found = menu.places(listed, area, 9.0, 8.0)
    assert {place.key for place in found} == {key for row in listed for _, _, key in row.presses}
    for place in found:
        left, bottom, wide, high = place.area
        assert area[0] <= left + 9.0 and left + wide <= area[0] + area[2] + 1e-9
        first = next(first for row in listed for first, _, key in row.presses if key == place.key)
        assert first >= 0, "the first letter of a row is its number 0"
        middle = (left + wide / 2, bottom + high / 2)
        assert {one.key for one in found if one.holds(*middle)} == {place.key}


def contrast(one, other):
    def light(colour):
        parts = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in colour[:3]]
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]

    low, high = sorted((light(one), light(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("shown", [colours.DARK, colours.LIGHT], ids=["dark", "light"])
def test_words_and_curves_are_read_on_light_and_on_dark_ground(shown):
    """Contrasts of WCAG 2.1: words 4.5, lines 3 (yellow on white, made darker, among them)."""
    for weight in ("plain", "quiet", "good", "warn", "bad"):
        assert contrast(shown.tint(weight), shown.panel) >= 4.5, weight
    for colour in colours.CURVES:
        assert contrast(shown.drawn(colour), shown.panel) >= 3.0, colour


@pytest.mark.parametrize("count", [0, 1, 4, 9])
@pytest.mark.parametrize("area", [(900.0, 8.0, 370.0, 700.0), (8.0, 8.0, 1264.0, 270.0), (8.0, 8.0, 380.0, 330.0)])
def test_charts_stand_in_their_area_and_none_on_another(count, area):
    left, bottom, width, height = area
    places = chart_layout.arranged(count, area, 8.0)
    assert min(count, 1) <= len(places) <= count
    for index, ((x, y, w, h), foot) in enumerate(places):
        assert (
            x >= left - 1e-9 and y >= bottom - 1e-9 and x + w <= left + width + 1e-9 and y + h <= bottom + height + 1e-9
        )
        assert h >= chart_layout.LEAST_HEIGHT * 8.0 * 0.9 and foot in (0.0, 2.4 * 8.0)
        for (u, v, wide, high), _ in places[:index]:
            assert x >= u + wide or u >= x + w or y >= v + high or v >= y + h
    columns = {x for (x, *_), _ in places}
    lowest = {x: min(y for (u, y, *_), _ in places if u == x) for x in columns}
    assert all((foot > 0.0) is (y == lowest[x]) for (x, y, *_), foot in places)  # each column has its time axis once


def test_keys_tell_the_sample_at_the_cursor_or_the_newest():
    times = np.array([3.0, 3.5, 4.0, 4.5])
    assert chart_layout.sample(times, None) == 3
    assert chart_layout.sample(times, -0.5) == 2
    assert chart_layout.sample(times, -0.6) == 2
    assert chart_layout.sample(times, 0.0) == 3
    assert chart_layout.sample(times, -1.6) == 4  # nothing is known of then
    assert chart_layout.sample(times[:0], -1.0) == -1
    assert chart_layout.told(times, ".1f", 4) == chart_layout.told(times[:0], ".1f", -1) == "--"
    assert chart_layout.told(times, ".1f", 1) == "3.5"


def test_what_stands_below_leaves_the_scene_the_rest():
    camera = Camera(under=0.4)
    below, plain = camera.projection(1.5), Camera().projection(1.5)
    assert below[1, 2] == -0.4 and plain[1, 2] == 0.0
    low, high = np.full(3, -0.05), np.full(3, 0.05)
    camera.frame(low, high, 1.5)
    corners = [np.array([x, y, z]) for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
    found = [camera.project(corner, 1500, 1000) for corner in corners]
    assert all(place is not None and place[1] > 400.0 for place in found)


def test_a_curve_is_called_as_its_field_says(session):
    force = next(chart for chart in Ring(session.model).charts if chart.title == "force")
    assert [(signal.label, signal.dashed) for signal in force.signals] == [("virtual", True), ("felt", False)]
    warm = next(chart for chart in Ring(session.model).charts if chart.unit == "degC")
    assert ("skin on the object", True) in [(signal.label, signal.dashed) for signal in warm.signals]
