"""What a notebook shows of a scene, a session and a recording."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch_tools.report import notebook


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[itouch.Session, itouch.Recording, str]:
    """Return a session that has ended, its recording, and what it said of its progress."""
    import contextlib
    import io

    path = tmp_path_factory.mktemp("notebook") / "touch.mcap"
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(path)
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        session.run(2.0, progress=True)
    session.close()
    return session, itouch.read(path), said.getvalue()


def well_formed(html: str) -> ElementTree.Element:
    """Return the tree of what is shown; void elements are closed first."""
    return ElementTree.fromstring(re.sub(r"<(img|br)([^>]*)>", r"<\1\2/>", html))


def test_a_session_shows_its_contacts_and_its_picture(ran: tuple[itouch.Session, itouch.Recording, str]) -> None:
    html = ran[0]._repr_html_()
    tree = well_formed(html)
    contacts = ran[0].report()["contacts"]
    assert contacts
    cells = [cell.text for cell in tree.iter("td")]
    assert all(contact["object"] in cells for contact in contacts)
    assert "2.000 s" in html
    picture = tree.find(".//img")
    if picture is not None:  # where there is OpenGL
        assert picture.get("src", "").startswith("data:image/png;base64,iVBOR")


def test_a_recording_shows_tracks_curves_and_contacts(ran: tuple[itouch.Session, itouch.Recording, str]) -> None:
    html = ran[1]._repr_html_()
    tree = well_formed(html)
    cells = [cell.text for cell in tree.iter("td")]
    assert set(ran[1]) <= set(cells)
    curves = [svg for svg in tree.iter() if svg.tag.endswith("svg")]
    assert 1 <= len(curves) <= notebook.CURVES
    assert any("[N]" in (svg.get("aria-label") or "") for svg in curves)
    assert len(html) < 300_000


def test_a_scene_shows_what_it_has() -> None:
    scene = itouch.load(SCENES / "first_touch.xml")
    cells = [cell.text for cell in well_formed(scene._repr_html_()).iter("td")]
    assert {each.name for each in (*scene.objects, *scene.devices, *scene.probes)} <= set(cells)


def test_hostile_names_are_shown_and_not_obeyed() -> None:
    scene = replace(itouch.load(SCENES / "first_touch.xml"), source="<script>alert(1)</script>")
    assert "<script" not in notebook._head(scene.source)


def test_a_curve_loses_no_peak_and_has_gaps() -> None:
    times = np.linspace(0.0, 1.0, 10_001)
    values = np.zeros_like(times)
    values[4321] = 7.0
    values[6000:6500] = np.nan
    html = notebook.curve(times, values, "force [N]")
    assert "0 to 7" in html and html.count("<polyline") == 2
    heights = [float(pair.split(",")[1]) for part in re.findall(r'points="([^"]*)"', html) for pair in part.split()]
    assert min(heights) == 2.0 and max(heights) == notebook.HIGH - 2
    assert len(heights) <= notebook.POINTS + 2
    assert notebook.curve(times, np.full_like(times, np.nan), "nothing") == ""


def test_progress_is_told_and_changes_nothing(
    ran: tuple[itouch.Session, itouch.Recording, str], tmp_path: Path
) -> None:
    assert "2.0 of 2.0 s simulated" in ran[2] and ran[2].endswith("\n")
    plain = itouch.build(SCENES / "first_touch.xml")
    counted: list[int] = []
    plain.record(tmp_path / "again.mcap")
    plain.run(2.0, each=lambda: counted.append(plain.ticks), every=500)
    assert bytes(plain.state.tobytes()) == bytes(ran[0].state.tobytes())
    plain.close()
    other = itouch.build(SCENES / "first_touch.xml")
    told: list[int] = []
    other.run(2.0, each=lambda: told.append(other.ticks), every=500, progress=True)
    other.close()
    assert told == counted


@pytest.mark.parametrize("count", [3, notebook.POINTS, 3 * notebook.POINTS, 100_000])
def test_a_long_curve_is_drawn_by_its_extremes_in_few_points(count: int) -> None:
    values = np.random.default_rng(3).normal(size=count)
    chosen = notebook._extremes(values)
    assert len(chosen) <= notebook.POINTS
    assert values[chosen].min() == values.min() and values[chosen].max() == values.max()
    assert (np.diff(chosen) > 0).all()


@pytest.mark.parametrize("span", [1e-3, 1.0, 700.0])
def test_a_curve_goes_from_edge_to_edge_of_its_picture_whenever_it_begins(span: float) -> None:
    times = 12.0 + np.linspace(0.0, span, 9)
    (points,) = re.findall(r'points="([^"]*)"', notebook.curve(times, np.arange(9.0), "force [N]"))
    across, up = np.array([[float(number) for number in pair.split(",")] for pair in points.split()]).T
    assert (across[0], across[-1]) == (1.0, notebook.WIDE - 1.0)
    assert (up[0], up[-1]) == (notebook.HIGH - 2.0, 2.0)


@pytest.mark.parametrize("count", [2, 3, 7, 11])
def test_of_a_pose_the_height_is_drawn_however_few_rows_there_are(count: int) -> None:
    columns = [
        SimpleNamespace(name=name, unit=unit) for name, unit in (("pose", "m"), ("force", "N"), ("current", "A"))
    ]
    rows = np.zeros(count, [("time", "f8"), ("pose", "f8", 7), ("force", "f8", 3), ("current", "f8", (1,))])
    rows["time"], rows["pose"][:, 2], rows["force"] = np.arange(count), 0.25, (0.0, 3.0, 4.0)
    rows["current"] = -1.5

    class Shown:
        tracks: ClassVar[Any] = {"arm": SimpleNamespace(columns=columns)}

        def __getitem__(self, name: str) -> Any:
            return rows

    height, size, current = notebook._curves(Shown())
    assert "height of" in height and "0.25 to 0.25" in height
    assert "size of" in size and "5 to 5" in size
    assert "arm.current [A]: -1.5 to -1.5" in current and "size of" not in current
