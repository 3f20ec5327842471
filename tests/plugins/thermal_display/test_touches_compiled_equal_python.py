"""A touch begins, slides to another object and ends in compiled code as in Python: the same State, the same report."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.plugin import Contact
from itouch_thermal.flux import onset
from itouch_thermal.flux.modality import FluxControl

#: Three blocks of a height side by side, over which the finger slides; it also lifts for a moment.
BLOCKS = "".join(
    f'<box name="{what}" pos="{x} 0 6 mm" size="36 60 12 mm" material="{what}"/>'
    for what, x in (("aluminium", -36), ("pyrex", 0), ("wood", 36))
)
MOTION = """<motion>
  <to pos="-36 0 44 mm" in="0.3 s" hold="0.4 s"/><to pos="-36 0 16 mm" in="0.5 s" hold="0.3 s"/>
  <to pos="10 0 16 mm" in="0.6 s" hold="0.2 s"/><to pos="10 0 21 mm" in="50 ms"/><to pos="10 0 16 mm" in="50 ms"/>
  <to pos="30 0 16 mm" in="0.4 s" hold="0.2 s"/><to pos="30 0 44 mm" in="0.4 s" hold="0.2 s"/>
</motion>"""
#: The modality's attributes, and the heat's, with what is in it.
WAYS = {
    "as it is": ("", "", ""),
    "a press": ("", 'press="50 ms"', ""),
    "a law of force": ("", 'press="40 ms"', "<thermal:pressure-resistance/>"),
    "equal times": ('equalise="yes" preset-noise="0.1 A"', "", ""),
}


def scene(folder: Path, way: str) -> Path:
    """Write the scene and return its file."""
    own, heat, inside = WAYS[way]
    shutil.copytree(SCENES, folder / "scenes", dirs_exist_ok=True)
    text = (SCENES / "four_materials_hurried.xml").read_text(encoding="utf-8")
    text = re.sub(r"<box name=\"aluminium\".*(?=</world>)", BLOCKS, text, flags=re.S)
    text = re.sub(r"<motion>.*</motion>", MOTION, text, flags=re.S)
    resistance = "" if inside else 'contact-resistance="0.002 m^2*K/W" '
    text = text.replace('contact-resistance="0.002 m^2*K/W" arterial="37 degC"/>',
                        f'{resistance}arterial="37 degC" {heat}>{inside}</thermal:heat>')  # fmt: skip
    text = text.replace('desired-from="heat"', f'desired-from="heat" {own}')
    path = folder / "scenes" / "slide.xml"
    path.write_text(text, encoding="utf-8")
    return path


def told(path: Path, rate: float) -> tuple[list[int], list[dict[str, Any]], set[int]]:
    """Run a scene; return what tells its State after each tick, its contacts, and how many kinds of event a tick had."""
    description = itouch.load(path)
    session = itouch.build(replace(description, rates=replace(description.rates, servo=rate)), seed=1)
    session.records = False
    found: list[int] = []
    session.run(until=lambda: bool(found.append(hash(session.state.tobytes()))) or session.done)
    table = session.state["events.table"][: int(session.state["events.count"])]
    ticks = table["tick"].tolist()
    contacts = session.statistics.contacts
    session.close()
    return found, contacts, {ticks.count(tick) for tick in ticks}


@pytest.mark.parametrize("way", WAYS)
def test_touches_are_the_same_both_ways(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = scene(tmp_path, way)
    compiled = told(path, 1000.0 if way != "a press" else 4000.0)
    left: list[int] = []
    update = FluxControl.update

    def counted(self: FluxControl, model: Any, state: Any, period: float) -> None:
        left.append(1)
        update(self, model, state, period)

    monkeypatch.setattr(FluxControl, "bound_update", lambda *given: ())
    monkeypatch.setattr(FluxControl, "bound_contact", lambda *given: None)
    monkeypatch.setattr(FluxControl, "update", counted)
    python = told(path, 1000.0 if way != "a press" else 4000.0)
    assert len(left) >= len(python[0])  # all was Python
    assert len(compiled[1]) >= 3 and 3 in compiled[2]  # it slid: near, end and begin in one tick
    assert compiled == python


@pytest.mark.parametrize("name", ["four_materials_hurried", "four_materials"])
def test_nothing_of_a_touch_is_left_to_python(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the first object that comes near until the touch has ended."""
    left: list[str] = []
    for method in ("update", "on_contact"):
        own = getattr(FluxControl, method)

        def counted(*given: Any, own: Any = own, method: str = method) -> None:
            left.append(method)
            own(*given)

        monkeypatch.setattr(FluxControl, method, counted)
    session = itouch.build(SCENES / f"{name}.xml", seed=1)
    session.records = False
    session.run(until=lambda: bool(session.state["ready"]))
    session.tick()
    count = session.state["events.count"]
    assert left  # what came before a tick was Python
    left.clear()
    before = int(count)
    session.run(10.0, until=lambda: int(count) >= before + 2)
    kinds = [Contact(kind) for kind in session.state["events.table"]["kind"][before : int(count)].tolist()]
    assert kinds == [Contact.BEGIN, Contact.END]
    assert not left
    session.close()


@pytest.mark.parametrize("rows", [1, 2, 3, 4, 26, 27])
@pytest.mark.parametrize("columns", [1, 4, 45, 46, 47])
def test_a_conversion_is_the_product(rows: int, columns: int) -> None:
    rng = np.random.default_rng(rows * columns)
    matrix, modes, found = rng.standard_normal((rows, columns)), rng.standard_normal(columns + 3), np.zeros(rows)
    onset.converted(matrix, modes, found)
    size = np.abs(matrix) @ np.abs(modes[:columns])
    assert (np.abs(found - matrix @ modes[:columns]) <= 4e-16 * columns * size).all()


def test_the_report_of_a_touch_is_the_same_at_once_and_later() -> None:
    """Its entry is made when it is asked for, of State as it was when it ended."""
    found = []
    for later in (0, 1, 40, 9000):
        session = itouch.build(SCENES / "four_materials_hurried.xml", seed=1)
        session.records = False
        ended = session.state["events.table"]["kind"]
        session.run(until=lambda ended=ended: bool((ended == Contact.END).any()))  # type: ignore[misc]
        for _ in range(later):
            session.tick()
        found.append(session.statistics.contacts)
        session.close()
    assert [len(contacts) for contacts in found] == [1, 1, 1, 1]
    assert found[0] == found[1] == found[2] == found[3]
    (contact,) = found[0]
    assert (contact["object"], contact["plate"], contact["plate_missed"]) == ("aluminium", True, False)
    assert 5.0 < contact["plate_s"] < contact["end_s"] - contact["begin_s"] + 0.1
    assert 0.5 < contact["peak_force_N"] < 3.0 and contact["mean_flux_W_m2"] > 100.0


def test_a_report_in_the_tick_of_a_slide_says_what_a_later_one_says(tmp_path: Path) -> None:
    """The plate was met in the contact before, of which the entry was still to be made: it did not lead by that."""
    session = itouch.build(scene(tmp_path, "as it is"), seed=1)
    session.records = False
    kinds = session.state["events.table"]["kind"]
    session.run(until=lambda: bool((kinds == Contact.END).any()))
    at_once = session.report()["contacts"]
    assert [contact["end_s"] is None for contact in at_once] == [False, True]
    assert at_once[1]["plate"] and at_once[1]["plate_lead_ms"] is None
    session.close()
