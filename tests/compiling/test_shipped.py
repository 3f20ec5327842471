"""Kernels that come with the program are used where they fit, and only if they are what was shipped."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from requirements import need_program

from itouch import shipped
from itouch.servo import prepare

KERNELS = """
from itouch.compiling import kernel

@kernel
def outer(x):
    return {factor} * x + 1.0
"""
RUN = """
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from itouch import shipped
if sys.argv[1] != "make":
    shipped.FOLDER = Path(sys.argv[2])
    shipped.processor_flags = lambda: shipped.V3 - {os.environ.get("SYSTEM_LACKS")}
    if os.environ.get("PROCESSOR_LACKS") != "what it says":
        shipped.asked_flags = lambda: shipped.V3 - {os.environ.get("PROCESSOR_LACKS")}
import kernels
print(kernels.outer(2.0), sum(kernels.outer.stats.cache_hits.values()))
if sys.argv[1] == "make":
    shipped.write_manifest(Path(sys.argv[2]))
"""


def run(folder: Path, *words: str, kept: str = "kept", command: Sequence[str] = (), **more: str) -> tuple[float, int]:
    """Return what the kernel gives, and how often it was loaded instead of compiled."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment = {**plain, "NUMBA_CACHE_DIR": str(folder / kept), "PYTHONDONTWRITEBYTECODE": "1", **more}
    words = (words[0], str(folder / "compiled"), *words[1:])
    done = subprocess.run(
        [*command, sys.executable, "-c", RUN, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split()
    return float(value), int(hits)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program of one kernel, and that kernel compiled to come with it."""
    folder = tmp_path_factory.mktemp("program")
    (folder / "kernels.py").write_text(KERNELS.format(factor=2.0), encoding="utf-8")
    assert run(folder, "make", **shipping(folder)) == (5.0, 0)
    return folder


def shipping(folder: Path) -> dict[str, str]:
    """Return the environment in which kernels are compiled for shipping."""
    return {shipped.MAKING: str(folder / "compiled"), "NUMBA_CPU_NAME": shipped.BASELINE, "NUMBA_CPU_FEATURES": ""}


@pytest.fixture
def program(made: Path, tmp_path: Path) -> Path:
    """A copy of the program, installed elsewhere at another time, on which nothing was ever run."""
    shutil.copyfile(made / "kernels.py", tmp_path / "kernels.py")
    shutil.copytree(made / "compiled", tmp_path / "compiled", copy_function=shutil.copyfile)
    os.utime(tmp_path / "kernels.py", (1e9, 1e9))
    (tmp_path / "compiled").chmod(0o755)
    return tmp_path


def test_the_first_start_compiles_nothing(program: Path) -> None:
    assert run(program, "use") == (5.0, 1)
    assert not list((program / "kept").rglob("*.nbc"))


def test_a_kernel_that_was_kept_is_shipped_without_compiling_it_again(tmp_path: Path) -> None:
    (tmp_path / "kernels.py").write_text(KERNELS.format(factor=2.0), encoding="utf-8")
    for loaded in (0, 1):
        assert run(tmp_path, "make", **shipping(tmp_path)) == (5.0, loaded)
        (tmp_path / "compiled").chmod(0o755)
        assert run(tmp_path, "use", kept=f"other{loaded}") == (5.0, 1)
        shutil.rmtree(tmp_path / "compiled")


def test_changed_code_is_compiled_instead_of_loaded(program: Path) -> None:
    (program / "kernels.py").write_text(KERNELS.format(factor=3.0), encoding="utf-8")
    assert run(program, "use") == (7.0, 0)
    assert run(program, "use") == (7.0, 1)  # and kept, beside what was shipped


@pytest.mark.parametrize("kind", [".nbi", ".nbc"])
@pytest.mark.parametrize("how", ["changed", "cut", "absent"])
def test_a_file_that_is_not_the_one_that_was_shipped_is_not_read(program: Path, kind: str, how: str) -> None:
    (path,) = (program / "compiled").rglob(f"*{kind}")
    sound = path.read_bytes()
    path.write_bytes(sound[: len(sound) // 2] + (bytes([sound[len(sound) // 2] ^ 1]) if how == "changed" else b""))
    if how == "changed":
        path.write_bytes(path.read_bytes() + sound[len(sound) // 2 + 1 :])
    elif how == "absent":
        path.unlink()
    assert run(program, "use") == (5.0, 0)


def test_a_processor_that_lacks_something_compiles_for_itself(program: Path) -> None:
    assert run(program, "use", SYSTEM_LACKS="avx2") == (5.0, 0)


def test_a_processor_that_lacks_what_the_system_says_it_has_compiles_for_itself(program: Path) -> None:
    """An emulator passes on what the system says of the machine below it."""
    assert run(program, "use", PROCESSOR_LACKS="fma", kept="another") == (5.0, 0)
    assert run(program, "use", PROCESSOR_LACKS="fma", kept="named", NUMBA_CPU_NAME=shipped.BASELINE) == (5.0, 0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "hits"),
    [("Haswell", 1), ("Skylake-Client", 1), ("EPYC-Rome", 1), ("SandyBridge", 0), ("IvyBridge", 0), ("Opteron_G5", 0)],
)
def test_older_emulated_processors_compile_for_themselves(program: Path, model: str, hits: int) -> None:
    """What was compiled on this machine is loaded on another model, or compiled there if that one is too old for it."""
    emulator = need_program("qemu-x86_64", package="qemu-user")
    assert run(program, "use", PROCESSOR_LACKS="what it says", kept=model, command=(emulator, "-cpu", model)) == (
        5.0,
        hits,
    )


def test_a_folder_that_others_can_write_is_not_used(program: Path) -> None:
    (program / "compiled").chmod(0o777)
    assert run(program, "use") == (5.0, 0)


def test_a_manifest_that_does_not_fit_or_is_none_is_not_used(program: Path) -> None:
    path = program / "compiled" / shipped.MANIFEST
    content = json.loads(path.read_text(encoding="utf-8"))
    for wrong in (json.dumps({**content, "numba": "0.1"}), json.dumps({**content, "files": {}}), "[]", "{", ""):
        path.write_text(wrong, encoding="utf-8")
        assert run(program, "use", kept=f"kept{len(wrong)}") == (5.0, 0)


@pytest.mark.parametrize(
    "first", ["itouch_tools.cli.live", "itouch.contact", "itouch.joining", "itouch.plugin", "itouch.loop"]
)
def test_the_cpu_is_chosen_before_numba_is_imported(first: str, tmp_path: Path) -> None:
    """As from a wheel that brings kernels: a copy of the program with a manifest that fits."""
    package = tmp_path / "itouch"
    package.mkdir()
    for path in Path(shipped.__file__).parent.iterdir():
        if path.name not in ("compiled", "__pycache__"):
            (package / path.name).symlink_to(path)
    (package / "compiled").mkdir(mode=0o755)
    manifest = {**shipped.made_with(), "processor": shipped.BASELINE, "files": {}}
    (package / "compiled" / shipped.MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import {first}, contact_heat.live\n"
        "from numba.core import config\nimport itouch\nprint(config.CPU_NAME, itouch.__file__)"
    )
    clean = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CPU")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=clean, check=False)
    fits = not shipped.V3 - shipped.processor_flags()
    wanted = shipped.BASELINE if fits else "None"
    assert done.stdout.split() == [wanted, str(package / "__init__.py")], done.stderr


def test_this_checkout_ships_none_unless_they_were_made() -> None:
    made = (shipped.FOLDER / shipped.MANIFEST).exists()
    assert shipped.fits() in ((True, False) if made else (False,))
    assert made or shipped.why_not().startswith("there are none")


def _forget() -> None:
    for one in (shipped._manifest, shipped.why_not, shipped.fits):
        one.cache_clear()


@pytest.fixture
def brought(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the manifest of kernels that came with the program, as if they fitted here."""
    folder = tmp_path / "compiled"
    folder.mkdir(mode=0o755)
    manifest = folder / shipped.MANIFEST
    content = {**shipped.made_with(), "processor": shipped.BASELINE, "files": {}}
    manifest.write_text(json.dumps(content), encoding="utf-8")
    monkeypatch.setattr(shipped, "FOLDER", folder)
    monkeypatch.setattr(shipped, "processor_flags", lambda: shipped.V3)
    _forget()
    yield manifest
    _forget()


def test_who_has_to_compile_is_told_why_what_came_with_the_program_is_not_used(
    brought: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    companion = prepare._Companion([])
    monkeypatch.setattr(prepare, "cores", lambda: 1)  # nobody is there to help
    companion._start()
    assert "came with the program" not in capsys.readouterr().err, "they fit: a plugin's own kernel is compiled"
    content = json.loads(brought.read_text(encoding="utf-8"))
    brought.write_text(json.dumps({**content, "numba": "0.1"}), encoding="utf-8")
    _forget()
    companion._start()
    told = capsys.readouterr().err.splitlines()
    assert told[0].startswith("preparing: the compiled kernels that came with the program are not used: ")
    assert "numba '0.1'" in told[0]
    brought.unlink()
    _forget()
    companion._start()
    assert "came with the program" not in capsys.readouterr().err, "none came, as in a checkout"
