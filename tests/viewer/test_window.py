"""The window itself, on a virtual screen: every key, the mouse, resizing, closing; frames are driven by hand."""

from __future__ import annotations

import pytest
from shipped import SCENES
from windows import asked, drive, scripts_of

SCRIPTS = scripts_of("window")


@pytest.fixture(scope="module")
def said(request, screen, tmp_path_factory):
    folder = tmp_path_factory.mktemp("window")
    words = [str(SCENES / "four_materials.xml"), str(folder / "saved.itouch")]
    return drive(asked(request, SCRIPTS), words, screen, folder)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_of_window_events_runs_without_an_error(name: str, said):
    assert not said[name], said[name]
