"""A study begun by `new-study` is right, and goes from there to its page by the tutorial's commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from itouch.plugin.discovery import Catalog
from itouch_tools.cli import main
from itouch_tools.study.reading import load_study
from itouch_tools.study.trials import trials_of


def test_a_new_study_is_right_and_stays_what_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new-study", "my-panel", "--folder", str(tmp_path)]) == 0
    study = tmp_path / "my-panel" / "my-panel.xml"
    assert main(["study", "check", str(study)]) == 0
    out = capsys.readouterr().out
    assert "12 trials of identify (3 of practice before them)" in out
    file = load_study(study, Catalog())
    assert file.name == "my-panel"
    assert len(trials_of(file, "P01")) == 15
    assert "Touch now" in "\n".join(file.instructions())
    assert main(["new-study", "my-panel", "--folder", str(tmp_path)]) == 2
    assert main(["new-study", "My Panel", "--folder", str(tmp_path)]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_the_same_time_is_asked_of_every_display(tmp_path: Path) -> None:
    main(["new-study", "my-panel", "--folder", str(tmp_path)])
    file = load_study(tmp_path / "my-panel" / "my-panel.xml", Catalog())
    for material in ("metal", "glass", "wood"):
        scene, problems = file.scene({"material": material}, Catalog())
        assert not problems
        control = next(part.params for part in scene.modalities if hasattr(part.params, "equalise"))
        assert control.equalise
        assert control.preset_time == pytest.approx(8.0)


def test_instructions_that_are_not_there_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["new-study", "my-panel", "--folder", str(tmp_path)])
    (tmp_path / "my-panel" / "instructions.md").unlink()
    assert main(["study", "check", str(tmp_path / "my-panel" / "my-panel.xml")]) == 2
    assert "cannot read the instructions" in capsys.readouterr().err


@pytest.mark.long
def test_a_session_on_the_thermal_twins(tmp_path: Path) -> None:
    main(["new-study", "my-panel", "--folder", str(tmp_path)])
    home = tmp_path / "my-panel"
    (home / "answers.txt").write_text("metal\nglass\nwood\n" * 10)
    argv = ["study", "run", str(home / "my-panel.xml"), "--participant", "P01", "--answers", str(home / "answers.txt")]
    assert main(argv) == 0
    assert main(["study", "report", str(home / "my-panel.xml"), str(home / "my-panel.data")]) == 0
    assert (home / "my-panel.data" / "report.html").stat().st_size > 2000
