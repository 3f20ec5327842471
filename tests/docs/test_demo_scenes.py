"""The shipped scenes can be had in any folder: tutorials begin with them."""

from __future__ import annotations

from pathlib import Path

import pytest
from shipped import SCENES

from itouch_tools.cli import main


def test_all_scenes_are_written_and_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--scenes", "scenes"]) == 0
    written = {path.relative_to("scenes") for path in Path("scenes").rglob("*") if path.is_file()}
    shipped = {
        path.relative_to(SCENES) for path in SCENES.rglob("*") if path.is_file() and "__pycache__" not in path.parts
    }
    assert written == shipped
    assert main(["scenes/first_touch.xml", "--headless"]) == 0
    capsys.readouterr()
    assert main(["demo", "--scenes", "scenes"]) == 2
    assert "is there already" in capsys.readouterr().err
    assert main(["demo", "--scenes", "scenes/first_touch.xml/x"]) == 2
    assert "cannot write" in capsys.readouterr().err


def test_a_scene_is_run_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "first_touch", "--headless", "--seed", "3"]) == 0
    assert "block" in capsys.readouterr().out
    assert main(["demo", "first_tuch"]) == 2
    assert "did you mean 'first_touch'?" in capsys.readouterr().err
    assert main(["demo", "--headless", "--for", "50ms"]) == 0
