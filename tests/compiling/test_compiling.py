"""What is kept of compiled functions is never older than what they were compiled from."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import campaign
import pytest

KERNELS = """
from itouch.compiling import kernel
import helpers as at
from helpers import inner, plain

@kernel
def outer(x):
    return inner(x) + plain(x) + at.SHIFT + at.deeper(x)
"""
HELPERS = """
import numpy as np
from numba import njit
from numba.extending import register_jitable
from deepest import TABLE, power

SHIFT = 0.0

@njit
def inner(x):
    return {factor} * x

@register_jitable
def plain(x):
    return {more}

@njit
def deeper(x):
    return TABLE[1] * power(x)
"""
DEEPEST = """
import numpy as np
from numba import njit
TABLE = np.array([0.0, {entry}])

@njit
def power(x, n={power}):
    return x ** n
"""
RUN = """
import kernels
print(kernels.outer(2.0), sum(kernels.outer.stats.cache_hits.values()))
"""


def write(folder: Path, *, factor: str = "1.0", more: str = "0.0", entry: str = "0.0", power: str = "1") -> None:
    """Write the modules, all with the time and, with parts of equal length, the size that they had before."""
    texts = {"kernels": KERNELS, "helpers": HELPERS.format(factor=factor, more=more)}
    texts["deepest"] = DEEPEST.format(entry=entry, power=power)
    for name, text in texts.items():
        path = folder / f"{name}.py"
        path.write_text(text, encoding="utf-8")
        os.utime(path, (1e9, 1e9))


def run(folder: Path, **more: str) -> tuple[float, int]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONDONTWRITEBYTECODE": "1", **more}
    done = subprocess.run(
        [sys.executable, "-c", RUN],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split()
    return float(value), int(hits)


def test_what_has_changed_in_another_file_is_compiled_again(tmp_path: Path) -> None:
    write(tmp_path)
    assert run(tmp_path) == (2.0, 0)
    assert run(tmp_path, PYTHONHASHSEED="7") == (2.0, 1)  # kept
    write(tmp_path, factor="3.0")
    assert run(tmp_path) == (6.0, 0)  # a compiled function that it calls
    write(tmp_path, factor="3.0", more="0.5")
    assert run(tmp_path) == (6.5, 0)  # a plain function that is compiled into it
    write(tmp_path, entry="2.0")
    assert run(tmp_path) == (6.0, 0)  # a table that a function takes which it calls
    write(tmp_path, entry="2.0", power="2")
    assert run(tmp_path) == (10.0, 0)  # a default of a function that is called by one that it calls
    write(tmp_path, entry="2.0")
    assert run(tmp_path) == (6.0, 1)  # and back again: that is still kept


@pytest.mark.skipif(os.geteuid() == 0, reason="root can write everywhere")
def test_without_a_place_to_keep_anything_it_is_compiled_every_time(tmp_path: Path) -> None:
    write(tmp_path)
    tmp_path.chmod(0o555)
    try:
        assert run(tmp_path, HOME=str(tmp_path / "none"), NUMBA_CACHE_DIR="") == (2.0, 0)
    finally:
        tmp_path.chmod(0o755)


def test_every_kernel_of_the_package_is_kept_with_its_fingerprint() -> None:
    from itouch.compiling import KernelCache, fingerprint
    from itouch.contact.step import step
    from itouch_thermal.flux.observer import observe

    for function in (observe, step):
        compiled = function
        assert isinstance(compiled._cache, KernelCache)
        assert len(fingerprint(compiled.py_func)) == 64


@pytest.mark.parametrize("wrong", campaign.some(["data", "another program's type", "cut", "no pickle"], 2))
def test_what_is_kept_and_cannot_be_read_is_compiled_again(tmp_path: Path, wrong: str) -> None:
    """Once: an index that was damaged, or that names a type which the new version has elsewhere."""
    write(tmp_path)
    first, _ = run(tmp_path)
    indices = sorted((tmp_path / "kept").rglob("*.nbi"))
    assert indices
    for index in indices:
        with index.open("rb") as stream:
            version = pickle.load(stream)
        whole = index.read_bytes()
        if wrong == "data":
            for data in index.parent.glob("*.nbc"):
                data.write_bytes(data.read_bytes()[:40])
        elif wrong == "cut":
            index.write_bytes(whole[: len(whole) // 2])
        elif wrong == "no pickle":
            index.write_bytes(pickle.dumps(version) + b"\x00\x01\x02")
        else:  # a global of a module that is gone, as pickle writes it
            index.write_bytes(pickle.dumps(version) + b"cgone.module\nThing\n.")
    assert run(tmp_path) == (first, 0)
    assert run(tmp_path) == (first, 1)
