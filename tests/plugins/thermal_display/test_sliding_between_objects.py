"""A finger that slides from one object onto another: what is desired goes on, and so does the current."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from shipped import SCENES

import itouch

Floats = NDArray[np.float64]

#: Two blocks of a height side by side, the second of another material or of the same.
BLOCKS = (
    '<box name="first" pos="-18 0 6 mm" size="36 60 12 mm" material="aluminium"/>'
    '<box name="second" pos="18 0 6 mm" size="36 60 12 mm" material="{second}"/>'
)
#: A touch of the first one, and a slide from there to places beside and beyond the boundary at 0 [mm].
MOTION = """<motion>
  <to pos="-12 0 44 mm" in="0.3 s" hold="0.4 s"/><to pos="-12 0 16 mm" in="0.5 s" hold="0.4 s"/>{slide}
</motion>"""
#: When the slide begins [s].
SLIDES = 1.6


def run(folder: Path, second: str, slide: str, heat: str, laws: str = "") -> tuple[Floats, Floats]:
    """Return the desired flux [W/m2] and the current [A] in each tick from the slide on."""
    shutil.copytree(SCENES, folder / "scenes", dirs_exist_ok=True)
    text = (SCENES / "four_materials_hurried.xml").read_text(encoding="utf-8")
    text = re.sub(r"<box name=\"aluminium\".*(?=</world>)", BLOCKS.format(second=second), text, flags=re.S)
    text = re.sub(r"<motion>.*</motion>", MOTION.format(slide=slide), text, flags=re.S)
    resistance = "" if laws else 'contact-resistance="0.002 m^2*K/W" '
    text = text.replace('contact-resistance="0.002 m^2*K/W" arterial="37 degC"/>',
                        f'{resistance}arterial="37 degC" {heat}>{laws}</thermal:heat>')  # fmt: skip
    path = folder / "scenes" / "slides.xml"
    path.write_text(text, encoding="utf-8")
    desired, current = [], []
    with itouch.build(path, seed=1) as session:
        session.records = False
        session.run(9.0, until=lambda: bool(session.state["ready"]))
        begun = session.seconds
        while not session.done:
            session.tick()
            if session.seconds > begun + SLIDES:
                assert session.state["heat.in_contact"].item() == 1
                desired.append(session.state["heat.desired"].item())
                current.append(session.state["peltier.sent.current"].item())
    return np.array(desired), np.array(current)


@pytest.mark.parametrize("laws", ["", "<thermal:pressure-resistance/>"])
def test_the_skin_that_was_flattened_on_one_object_stays_so_on_the_next(tmp_path: Path, laws: str) -> None:
    """The press began anew where the contact disc had left the first object: the flux halved from tick to tick."""
    slide = '<to pos="12 0 16 mm" in="0.5 s" hold="0.3 s"/>'
    desired, _ = run(tmp_path, "aluminium", slide, 'press="0.3 s"', laws)
    assert np.abs(np.diff(desired)).max() < 0.1 * desired.max()
    assert desired.min() > 0.7 * desired.max()


def test_the_current_does_not_swing_while_a_finger_rests_on_two_objects(tmp_path: Path) -> None:
    """Every 10 ms the look ahead began anew with the flux of one of them: for a tick, the current heated."""
    slide = '<to pos="-0.5 0 16 mm" in="0.4 s" hold="0.6 s"/>'
    _, current = run(tmp_path, "polystyrene", slide, "", "<thermal:pressure-resistance/>")
    there = np.diff(current[500:])
    swings = (np.abs(there[1:]) > 1.5) & (np.abs(there[:-1]) > 1.5) & (there[1:] * there[:-1] < 0.0)
    assert not swings.any()


def test_a_press_is_looked_ahead_from_when_the_finger_came_to_the_plate(tmp_path: Path) -> None:
    """It began anew with the slide: the law expected nearly no flux, and then one that rises steeply."""
    slide = '<to pos="12 0 16 mm" in="0.4 s" hold="0.3 s"/>'
    laws = "<thermal:pressure-resistance/>"
    pressed = run(tmp_path / "pressed", "aluminium", slide, 'press="0.1 s"', laws)[1]
    alone = run(tmp_path / "alone", "aluminium", slide, "", laws)[1]
    assert np.sqrt(np.mean((pressed - alone) ** 2)) < 0.5
