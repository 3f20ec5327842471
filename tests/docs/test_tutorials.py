"""The tutorials' scenes do at each step what the text says."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from listings import DOCS, listings
from shipped import SCENES

from itouch_tools.cli import main


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(SCENES, tmp_path / "scenes")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def step(number: int) -> Path:
    path = Path("scenes/blocks.xml")
    shutil.copy(DOCS / "examples" / f"blocks-{number}.xml", path)
    return path


def test_the_world_is_right_but_does_not_move(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(step(1))]) == 0
    page = "docs/tutorials/four-materials.md"
    (shown,) = [one.text for one in listings() if one.page == page and "ok (" in one.text]
    assert capsys.readouterr().out == shown
    assert main([str(step(1)), "--headless"]) == 2
    assert "--for" in capsys.readouterr().err


@pytest.mark.parametrize(("number", "plate", "warm"), [(2, False, False), (3, True, False), (4, True, True)])
def test_each_step_feels_more(
    folder: Path, number: int, plate: bool, warm: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(step(number)), "--headless", "--report", "report.json"]) == 0
    (contact,) = json.loads(Path("report.json").read_text())["contacts"]
    assert contact["object"] == "block"
    assert contact["plate"] is plate
    assert (contact["mean_flux_W_m2"] is not None) is warm
    if plate:
        assert abs(contact["plate_gap_mm"]) < 0.1
    if warm:
        assert 1000 < contact["mean_flux_W_m2"] < 1500
        assert contact["flux_error_rms"] < 0.05
        page = "docs/tutorials/four-materials.md"
        (row,) = [one.text.strip() for one in listings() if one.page == page and one.text.startswith("block   wood")]
        assert row in capsys.readouterr().out


def test_the_first_scene_changed_as_the_tutorial_says(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = Path("scenes/first_touch.xml")
    text = scene.read_text()
    scene.write_text(text.replace('stiffness="1.2 N/mm"', 'stiffness="20 N/mm"'))
    assert main([str(scene), "--headless"]) == 0
    assert "rendering" in capsys.readouterr().err
    scene.write_text(text.replace('stiffness="1.2 N/mm"', 'stifness="20 N/mm"'))
    assert main([str(scene), "--headless"]) == 2
    (shown,) = [
        one.text for one in listings() if one.page == "docs/tutorials/first-touch.md" and "stifness" in one.text
    ]
    assert shown in capsys.readouterr().err
    scene.write_text(text)
    assert main([str(scene), "--headless"]) == 0
    (row,) = [
        one.text.splitlines()[1] for one in listings() if one.page.endswith("first-touch.md") and "peak N" in one.text
    ]
    assert row in capsys.readouterr().out


def test_the_switching_times_are_those_that_the_program_prints(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["thermal", "switching", str(SCENES / "four_materials.xml")]) == 0
    printed = capsys.readouterr().out
    page = "docs/how-to/add-a-material.md"
    (shown,) = [one.text for one in listings() if one.page == page and "from / to" in one.text]
    assert all(line.rstrip() in printed for line in shown.splitlines())
    rows = {line.split()[0]: line.split() for line in printed.splitlines()[1:]}
    text = (DOCS / "explanation" / "thermal-display.md").read_text(encoding="utf-8")
    assert f"{float(rows['aluminium'][-2]):.2f} s between aluminium and pyrex" in text
    assert f"{float(rows['aluminium'][-1]):.2f} s between aluminium and polystyrene" in text
