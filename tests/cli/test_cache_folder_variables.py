"""Environment variables that name cache folders: a relative path makes no folder wherever the program is started."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from itouch import caches, compiling
from itouch.contact.meshfile import cache as meshes
from itouch.plugin import result_cache
from itouch_tools.cli import main


def test_the_switches_are_those_of_the_caches() -> None:
    assert caches.SWITCHES == (compiling.SWITCH, result_cache.SWITCH, meshes.SWITCH)


@pytest.mark.parametrize("given", ["kernels", "./kernels", "~/kernels", ".", " "])
def test_a_relative_folder_is_ignored_with_one_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], given: str
) -> None:
    """It was made in the folder in which the program was started: `~/kernels` as a folder named `~`."""
    for switch in caches.SWITCHES:
        monkeypatch.delenv(switch, raising=False)
    usual = [caches.folder("kernels", switch) for switch in caches.SWITCHES]
    monkeypatch.setenv(caches.SWITCHES[0], given)
    monkeypatch.setenv(caches.SWITCHES[1], "off")
    monkeypatch.setenv(caches.SWITCHES[2], os.fspath(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert [caches.folder("kernels", switch) for switch in caches.SWITCHES] == [usual[0], None, tmp_path]
    assert main(["explain", "bad-value"]) == 0
    said = capsys.readouterr().err
    assert said == f"note: ITOUCH_KERNELS is ignored: it must be a full path, or off, not '{given}'\n"
    assert main(["explain", "bad-value", "-q"]) == 0
    assert capsys.readouterr().err == ""
