"""What the picture says, without drawing it."""

from __future__ import annotations

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.viewer import colours, overlay, solids
from itouch.viewer.camera import VIEWS, Camera
from itouch.viewer.overlay import Situation
from itouch.viewer.signals import Ring
from itouch.viewer.stage import Stage, along, arrow


def volume(solid: solids.Solid) -> float:
    corners = solid.positions.astype(float)[solid.faces]
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


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
    stage = Stage(session.model)
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
    stage = Stage(session.model)
    plain = {draw.owner: draw.colour for draw in stage.draws(session.state)}
    thermal = {draw.owner: draw.colour for draw in stage.draws(session.state, thermal=True)}
    assert plain["wood"] != plain["pyrex"]
    assert thermal["wood"] == thermal["pyrex"] == colours.of_temperature(296.15)


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


def test_the_overlay_names_devices_contact_and_faults(session):
    now = Situation(tick_us=50.0, overruns=3)
    text = "\n".join(line for line, _ in overlay.status(session.model, session.state, now).lines)
    for part in ("arm: enabled (twin)", "peltier: plate", "degC", "3 overruns", "1000 Hz", "tick p99 50 us"):
        assert part in text
    now.faults = [{"trip": "over-temperature", "device": "peltier", "cause": "is at 46 degC"}]
    said = overlay.alarm(now, 200)
    assert said is not None
    assert ("FAULT over-temperature: device 'peltier' is at 46 degC", "bad") in said.lines
    assert any("R re-arms" in line for line, _ in said.lines)
    narrow = overlay.alarm(now, 24)
    assert narrow is not None and max(len(line) for line, _ in narrow.lines) <= 24
    assert " ".join(line for line, weight in narrow.lines if weight == "bad") == said.lines[0][0]
    assert overlay.alarm(Situation(), 80) is None


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
