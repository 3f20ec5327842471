"""What compiling a scene has found is kept on disk; what is damaged, forged or of other code is as good as none."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some
from hypothesis.extra import numpy as arrays
from requirements import meant
from shipped import SCENES

import itouch
from itouch import compiling
from itouch.plugin import bases, result_cache
from itouch.plugin.bases import Bases, keeping, kept
from itouch_tools.cli import main
from itouch_tools.cli.doctor import disk_caches
from itouch_tools.cli.doctor.diagnosis import Diagnosis
from itouch_tools.cli.doctor.disk_caches import compile_cache, kept_meshes, kept_results

Array = bases.Array
GIVEN = ("content", 1.5)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ITOUCH_KEPT", str(tmp_path / "found"))
    monkeypatch.setattr(result_cache, "_code", lambda package: f"code of {package}")
    return tmp_path / "found"


class Solver:
    """Counts how often it solves."""

    def __init__(self) -> None:
        self.solved = 0

    def __call__(self, content: object = GIVEN) -> Array:
        def make() -> Array:
            self.solved += 1
            return np.arange(6.0).reshape(2, 3)

        def load(stored: tuple[Array, ...]) -> Array:
            if len(stored) != 1 or stored[0].shape != (2, 3):
                raise ValueError("does not fit")
            return stored[0]

        with keeping(Bases()):
            return kept(content, make, lambda a: (a,), load)


@pytest.fixture
def solve() -> Solver:
    return Solver()


def only(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_another_session_takes_what_one_has_found(solve: Solver, folder: Path) -> None:
    first, second = solve(), solve()
    assert solve.solved == 1
    assert first.tobytes() == second.tobytes()
    second[0, 0] = 7.0  # what is loaded is the session's own
    assert solve()[0, 0] == 0.0
    assert only(folder).stat().st_mode & 0o077 == 0


def test_other_content_and_other_code_are_other_entries(solve: Solver, monkeypatch: pytest.MonkeyPatch) -> None:
    solve()
    solve(("content", 1.5000000000000002))
    assert solve.solved == 2
    monkeypatch.setattr(result_cache, "_code", lambda package: "code after an upgrade")
    solve()
    assert solve.solved == 3
    monkeypatch.setattr(result_cache, "_machine", lambda: ("another processor",))
    solve()
    assert solve.solved == 4
    monkeypatch.setattr(result_cache, "_code", lambda package: None)  # nobody can say which code it is
    solve()
    solve()
    assert solve.solved == 6


def test_each_byte_counts(solve: Solver, folder: Path) -> None:
    """Every single changed byte, and every cut, makes an entry void; the next build puts a sound one there."""
    solve()
    path = only(folder)
    sound = path.read_bytes()
    for at in range(len(sound)):
        path.write_bytes(sound[:at] + bytes([sound[at] ^ 0x40]) + sound[at + 1 :])
        assert result_cache.read(path.stem) is None, at
        path.write_bytes(sound[:at])
        assert result_cache.read(path.stem) is None, at
    path.write_bytes(sound + b"\0")
    assert result_cache.read(path.stem) is None
    solve()
    assert solve.solved == 2
    assert path.read_bytes() == sound


def test_an_entry_under_another_name_is_none(solve: Solver, folder: Path) -> None:
    solve()
    path = only(folder)
    path.rename(folder / f"{'0' * 40}.arrays")
    assert result_cache.read("0" * 40) is None


def test_a_whole_entry_that_does_not_fit_is_solved_anew(solve: Solver, folder: Path) -> None:
    solve()
    result_cache.write(only(folder).stem, (np.zeros(3),))
    assert solve().shape == (2, 3)
    assert solve.solved == 2


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_can_write_is_not_read(solve: Solver, folder: Path, mode: int) -> None:
    solve()
    folder.chmod(mode)
    solve()
    assert solve.solved == 2


@pytest.mark.skipif(os.geteuid() != 0, reason=meant("only root can give folders away"))
def test_a_folder_of_somebody_else_is_not_read(solve: Solver, folder: Path) -> None:
    solve()
    os.chown(folder, 12345, 12345)
    solve()
    assert solve.solved == 2


@pytest.mark.parametrize("mode", [0o666, 0o620])
def test_an_entry_that_others_can_write_is_solved_anew(solve: Solver, folder: Path, mode: int) -> None:
    solve()
    only(folder).chmod(mode)
    solve()
    assert solve.solved == 2
    solve()
    assert solve.solved == 2


@pytest.mark.parametrize("make", [os.mkfifo, None], ids=["pipe", "link"])
def test_what_is_no_file_is_neither_waited_for_nor_read(
    solve: Solver, folder: Path, tmp_path: Path, make: Callable[[Path], None] | None
) -> None:
    solve()
    path = only(folder)
    path.rename(tmp_path / "elsewhere")
    if make is None:
        path.symlink_to(tmp_path / "elsewhere")
    else:
        make(path)
    solve()
    assert solve.solved == 2
    solve()
    assert solve.solved == 2


@pytest.mark.parametrize("spoil", [
    lambda folder: folder.write_text("a file"), lambda folder: folder.symlink_to("/proc/nowhere"),
    lambda folder: folder.symlink_to(folder),
])  # fmt: skip
def test_without_a_folder_each_session_solves(solve: Solver, folder: Path, spoil: Callable[[Path], object]) -> None:
    spoil(folder)
    solve()
    solve()
    assert solve.solved == 2


def test_it_can_be_switched_off(solve: Solver, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ITOUCH_KEPT", "off")
    solve()
    solve()
    assert solve.solved == 2
    assert not folder.exists()


def test_the_folder_is_bounded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(result_cache, "CAPACITY", 10_000)
    for number in range(40):
        result_cache.write(f"{number:040}", (np.full(100, float(number)),))
        result_cache.read(f"{0:040}")  # what is used stays
    assert sum(path.stat().st_size for path in folder.iterdir()) <= 10_000
    assert result_cache.read(f"{39:040}") is not None
    assert result_cache.read(f"{1:040}") is None
    result_cache.write("f" * 40, (np.zeros(5_000_000),))  # larger than an entry may be
    assert result_cache.read("f" * 40) is None


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(some.lists(arrays.arrays(np.float64, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0)), max_size=4))
def test_arrays_come_back_bit_for_bit(given_arrays: list[Array]) -> None:
    result_cache.write("e" * 40, tuple(given_arrays))
    found = result_cache.read("e" * 40)
    assert found is not None
    assert [(a.shape, a.tobytes()) for a in found] == [(a.shape, a.tobytes()) for a in given_arrays]


def test_code_that_changed_since_the_process_began_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After an upgrade in place the code in memory is not the code on disk."""
    monkeypatch.undo()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "guest.py").write_text("def make():\n    return 1\n", encoding="utf-8")
    text = (
        "import pathlib, sys, time\n"
        "from itouch.plugin import result_cache\n"
        "import guest\n"
        "if sys.argv[1] == 'upgraded':\n"
        "    time.sleep(0.05)\n"
        "    pathlib.Path(guest.__file__).write_text('def make():\\n    return 2\\n')\n"
        "print(result_cache.key('content', guest.make))\n"
    )
    found = [
        subprocess.run([sys.executable, "-c", text, how], capture_output=True, text=True, check=True).stdout.strip()
        for how in ("as it was", "as it was", "upgraded", "as it is now")
    ]
    assert found[0] == found[1] != "None"
    assert found[2] == "None"
    assert found[3] not in ("None", found[0])


def test_a_session_from_the_shelf_is_the_same(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Start temperatures and modes from disk: the same model to the last bit, and nothing is tried again."""
    from itouch_thermal.flux.start import Trial

    first = itouch.build(SCENES / "four_materials.xml")
    assert len(list(folder.iterdir())) > 5

    def run(*_: object) -> None:
        raise AssertionError("a start temperature was looked for again")

    monkeypatch.setattr(Trial, "run", run)
    second = itouch.build(SCENES / "four_materials.xml")
    for session in (first, second):
        for _ in range(300):
            session.tick()
    assert first.state == second.state
    assert first.snapshot().manifest == second.snapshot().manifest


@pytest.mark.parametrize("words", [["check"], ["run", "--headless", "--for", "0.01s"]], ids=["check", "run"])
def test_no_command_looks_for_a_second_time(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Each start by a command looked for the plate's start temperatures: only sessions built in Python found them kept."""
    from itouch_thermal.flux.start import Trial

    command = [words[0], str(SCENES / "four_materials.xml"), *words[1:]]
    assert main(command) == 0

    def run(*_: object) -> None:
        raise AssertionError("a start temperature was looked for again")

    monkeypatch.setattr(Trial, "run", run)
    assert main(command) == 0


def test_what_a_writer_that_was_killed_has_left_is_removed_by_a_later_one(folder: Path) -> None:
    """Half a file of a writer that still writes is not touched."""
    folder.mkdir(mode=0o700)
    for name, age in ((".left.part", 7200.0), (".now.part", 0.0)):
        (folder / name).touch()
        os.utime(folder / name, (time.time() - age,) * 2)
    result_cache.write("0" * 40, (np.zeros(3),))
    assert sorted(path.name for path in folder.iterdir()) == [".now.part", f"{'0' * 40}.arrays"]


def test_the_doctor_clears_halves_of_kernels_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "folder", lambda: tmp_path / "kernels")
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels" / ".left.part").touch()
    (tmp_path / "kernels" / "notes.txt").touch()
    monkeypatch.setattr(disk_caches, "kernel_folders", lambda: [tmp_path / "kernels"])
    disk_caches.clear_kept()
    assert [path.name for path in (tmp_path / "kernels").iterdir()] == ["notes.txt"]


def test_the_doctor_shows_and_clears_what_is_kept(
    solve: Solver, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setenv("ITOUCH_MESH_CACHE", str(tmp_path / "meshes"))
    solve()
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels" / "one.nbi").touch()
    (tmp_path / "kernels" / "one.1.nbc").touch()
    (tmp_path / "kernels" / "notes.txt").touch()
    assert kept_results().found == f"1 result (0.0 MB) in '{folder}'"
    assert kept_meshes().found == f"0 meshes (0.0 MB) in '{tmp_path / 'meshes'}'"
    assert compile_cache().found == "1 kernels in NUMBA_CACHE_DIR"
    assert main(["doctor", "--clear-kept"]) == 0
    assert capsys.readouterr().out.startswith("removed 1 compiled kernels, 1 results and 0 meshes")
    assert list(folder.iterdir()) == []
    assert [path.name for path in (tmp_path / "kernels").iterdir()] == ["notes.txt"]


KEPT = pytest.mark.parametrize(
    ("look", "switch"), [(kept_results, "ITOUCH_KEPT"), (kept_meshes, "ITOUCH_MESH_CACHE")], ids=["results", "meshes"]
)


@KEPT
def test_the_doctor_says_where_nothing_can_be_kept_and_what_to_do(
    look: Callable[[], Diagnosis], switch: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each message names the folder that is meant; a folder that is not there yet, and can be made, is in order."""
    place = tmp_path / "home" / "kept"
    monkeypatch.setenv(switch, str(place))

    def told() -> tuple[str, str, str]:
        found = look()
        return found.status, found.found, found.advice.removesuffix(f", or name another folder by {switch}")

    assert told()[::2] == ("ok", "")
    assert told()[1].endswith(f" (0.0 MB) in '{place}'")
    (tmp_path / "home").touch()
    said = f"nothing is kept: '{place}' can't be made, as '{tmp_path / 'home'}' is not a folder"
    assert told() == ("lack", said, f"make '{tmp_path / 'home'}' a folder")
    (tmp_path / "home").unlink()
    place.mkdir(parents=True, mode=0o700)
    assert told()[0] == "ok"
    place.chmod(0o770)
    assert told() == ("lack", f"nothing is kept: '{place}' is not this user's alone", "make it yours alone (chmod 700)")
    place.rmdir()
    place.symlink_to(tmp_path / "nowhere")
    assert told() == ("lack", f"nothing is kept: '{place}' is not a folder", "remove it")
    monkeypatch.setenv(switch, "off")
    assert told()[:2] == ("note", f"switched off by {switch}")
    assert not look().advice.startswith(";")


@KEPT
def test_the_doctor_says_that_a_home_cannot_be_written(
    look: Callable[[], Diagnosis], switch: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "home" / "kept"
    monkeypatch.setenv(switch, str(place))
    place.mkdir(parents=True, mode=0o700)
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)  # as where it is mounted read-only
    assert look().found == f"nothing is kept: '{place}' can't be written"
    place.rmdir()
    found = look()
    assert found.status == "lack"
    assert found.found == f"nothing is kept: '{place}' can't be made, as '{tmp_path / 'home'}' can't be written"
    assert found.advice == f"make '{tmp_path / 'home'}' writable, or name another folder by {switch}"
