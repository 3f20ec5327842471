"""Folders of starts that were killed while they compiled: a later start removes them, and no others."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from itouch.servo import prepare


def test_a_start_removes_the_folders_of_those_that_were_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    killed = subprocess.Popen([sys.executable, "-c", ""])
    killed.wait()
    left = tmp_path / f"itouch-compiling-{killed.pid}-abc"
    left.mkdir()
    (left / "claim").touch()
    others = [tmp_path / f"itouch-compiling-{os.getpid()}-abc", tmp_path / "itouch-compiling-words-abc",
              tmp_path / f"itouch-{killed.pid}-abc"]  # fmt: skip
    for other in others:
        other.mkdir()
        (other / "claim").touch()
    link = tmp_path / f"itouch-compiling-{killed.pid}-link"
    link.symlink_to(others[2])
    with prepare._Companion([]):
        pass
    assert not left.exists()
    assert link.is_symlink()
    assert all((other / "claim").exists() for other in others)


def test_the_folder_of_a_start_is_removed_once_that_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its name says whose it is."""
    (tmp_path / "tmp").mkdir()
    script = (
        "import os\nimport itouch.compiling\nfrom itouch.servo import prepare\n"
        "prepare.cores = lambda: 2\nprepare.subprocess.Popen = lambda *_, **__: None\n"
        "companion = prepare._Companion([])\ncompanion._start()\nprint(companion._folder, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp")}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    left = Path(done.stdout.strip())
    assert done.returncode == -9
    assert left.is_dir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    prepare.sweep()
    assert not left.exists()


@pytest.mark.parametrize("what", ["tempfile.mkdtemp", "subprocess.Popen"])
def test_a_start_that_gets_no_help_compiles_alone(
    what: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where no folder can be made or no process started, nothing is raised in the thread that starts them."""

    def refused(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(f"itouch.servo.prepare.{what}", refused)
    monkeypatch.setattr(prepare, "cores", lambda: 2)
    monkeypatch.setattr(prepare, "_COMPANIONS", 1)
    with prepare._Companion([]) as companion:
        companion._start()
        assert not companion._processes
    assert "compiling the kernels" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
