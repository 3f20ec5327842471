"""Touches of one object again and again: it keeps the heat, and the plate starts as the object is by then."""

from __future__ import annotations

import re

import pytest
from display_scenes import start_of

import itouch
from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.onset import warmth

ONCE = """
    <to pos="22 0 48 mm" in="0.8 s" hold="2 s"/>
    <to pos="22 0 19 mm" in="0.7 s" hold="3 s"/>
    <to pos="22 0 48 mm" in="0.5 s"/>
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> itouch.Session:
    """Wood, touched seven times, and a short way up between."""
    from shipped import SCENES

    text = (SCENES / "four_materials.xml").read_text()
    text = re.sub("<motion>.*?</motion>", f"<motion>{ONCE * 7}</motion>", text, flags=re.S)
    text = re.sub('file="(materials|rigs)', rf'file="{SCENES}/\1', text)
    folder = tmp_path_factory.mktemp("again")
    for name in ("materials.xml", "rigs/twin.xml"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text((SCENES / name).read_text())
    scene = folder / "scene.xml"
    scene.write_text(text.replace(f"{SCENES}/", ""))
    session = itouch.build(itouch.load(scene))
    session.run(6.0 + 7.0 * 7)
    return session


def flux_model(session: itouch.Session) -> FluxModel:
    return next(part.model for part in session.model.modalities if isinstance(part.model, FluxModel))


def test_the_flux_of_the_last_touch_is_as_right_as_that_of_the_first(session: itouch.Session) -> None:
    touches = [c for c in session.report()["contacts"] if c["plate"]]
    assert len(touches) == 7
    assert touches[-1]["mean_flux_W_m2"] < 0.7 * touches[0]["mean_flux_W_m2"]
    assert max(c["flux_error_rms"] for c in touches) < 0.01


def test_an_object_that_was_touched_is_warmer(session: itouch.Session) -> None:
    model = flux_model(session)
    assert model.preview is not None
    warmed = [
        0.0 if body is None else warmth(body, modes, temperature)
        for body, modes, temperature in zip(
            model.preview.bodies, session.state[model.names.bodies], model.temperatures, strict=True
        )
    ]
    at = model.objects.index("wood")
    assert warmed[at] > 0.5
    assert [part for i, part in enumerate(warmed) if i != at] == [0.0] * (len(warmed) - 1)


def test_finger_and_object_warmer_by_the_same_want_a_plate_warmer_by_that(session: itouch.Session) -> None:
    model = flux_model(session)
    at = model.objects.index("pyrex")
    for skin in (model.skin - 6.0, model.skin - 1.0, model.skin, model.skin + 4.0):
        plain = start_of(model, at, skin)
        assert start_of(model, at, skin + 1.7, 1.7) == pytest.approx(plain + 1.7, abs=1e-9)


def test_a_finger_as_cold_as_the_object_wants_a_plate_that_is_so_too(session: itouch.Session) -> None:
    model = flux_model(session)
    for at, rest in enumerate(model.temperatures):
        assert start_of(model, at, rest) == pytest.approx(rest, abs=1e-6)
        for away in (-3.0, 3.0):  # and nowhere is there a leap
            near = [start_of(model, at, model.skin + away + little) for little in (-1e-6, 1e-6)]
            assert near[0] == pytest.approx(near[1], abs=1e-5)
