"""What Numba is spared, and that it then does what it does by itself."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

KERNELS = """
from itouch.compiling import kernel

@kernel
def product(one, two):
    return one @ two

@kernel
def twice(x):
    return 2.0 * x
"""
RUN = """
import sys
import numpy as np
from kernels import product, twice
said = [twice(1.5), "scipy.linalg" in sys.modules]
one = np.array([[1.0, 2.0], [3.0, 4.0]])
said += [product(one, one).tolist(), "scipy.linalg" in sys.modules, sum(product.stats.cache_hits.values())]
print(said)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kernels")
    (folder / "kernels.py").write_text(KERNELS, encoding="utf-8")
    return folder


def run(folder: Path, before: str = "") -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "ITOUCH_KERNELS": str(folder / "kept"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", before + RUN]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600, check=False
    )


def test_a_kernel_that_multiplies_matrices_finds_its_blas_and_no_other_kernel_looks_for_it(folder: Path) -> None:
    for hits in (0, 1):  # compiled, and loaded by another process
        done = run(folder)
        assert done.stdout == f"[3.0, False, [[7.0, 10.0], [15.0, 22.0]], True, {hits}]\n", done.stderr


@pytest.mark.parametrize("absent", ["scipy", "scipy.linalg.cython_blas"])
def test_without_its_blas_a_kernel_that_multiplies_matrices_is_refused_as_numba_refuses_it(
    absent: str, tmp_path: Path
) -> None:
    """Also where SciPy is there without it: then only Numba's own look, when the kernel is compiled, finds that out."""
    (tmp_path / "kernels.py").write_text(KERNELS, encoding="utf-8")
    done = run(tmp_path, f"import sys\nsys.modules[{absent!r}] = None\n")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == "ImportError: scipy 0.16+ is required for linear algebra"
    assert not done.stdout


COMPILED = """
import re, sys
from itouch import numba_shortcuts
if sys.argv[1] == "without":
    numba_shortcuts.take = lambda: None
import numpy as np
from numba.core.codegen import JITCodeLibrary
texts = []
finish = JITCodeLibrary._finalize_final_module

def told(self):
    # of this process alone: addresses, and how many functions have been compiled before
    text = re.sub(r"\\b[0-9]{12,}\\b", "address", str(self._final_module))
    text = re.sub(r"B[0-9]+v[0-9]+", "version", text)
    texts.append(re.sub(r"@_ZN08NumbaEnv\\S* = common .*\\n", "", text))  # of a copy that nobody calls is only this left
    finish(self)

JITCodeLibrary._finalize_final_module = told
from typing import NamedTuple
from itouch.compiling import inlined, kernel, linked

class Pair(NamedTuple):
    one: np.ndarray
    two: np.ndarray

@linked
def clipped(x, low, high):
    return min(max(x, low), high)

@kernel
def differ(pair, factor):
    total, most, count = 0.0, -1, 0
    for i, (a, b) in enumerate(zip(pair.one, pair.two)):
        if not np.isfinite(a):
            raise ValueError("not finite")
        total += clipped(a - factor * b, -1.0, 1) * abs(i - 3)
        most = max(most, i if a > b else 0)
        count += int(b > 0.0) + min(i, 2)
    return total, most, np.sqrt(max(total, 0)), count

@inlined
def greater(x, y):
    return max(x, y)

@kernel
def inside(x, y):
    return greater(x, y) - min(x, y)

@kernel
def apart(x, y):
    return max(x, y) - min(x, y)

def one_way(**options):
    # a kernel that calls what others call, in a function with other options
    def greatest(x, y):
        return max(x, y) + int(x)

    part = linked(greatest, **options)

    def through(x, y):
        return part(x, y)

    return kernel(through)

ways = [one_way(**options) for options in (
    {}, {"_nrt": False}, {"forceinline": True}, {"error_model": "python"}, {"fastmath": True})]

@kernel
def both(rows, factor):
    kept = [differ(Pair(row, row[::-1]), factor)[0] for row in rows if row.shape[0] > 1]
    return np.array(kept).sum(), max(len(kept), 1), max(1.0, factor), min(factor, 2)

found = both(np.arange(12.0).reshape(3, 4), 0.5), differ(Pair(np.ones(3), np.zeros(3)), 2.0)
print(found, inside(1.0, 2.0), apart(1.0, 2.0), *(way(1.0, 2.0) for way in ways))
print(*texts, sep=chr(0))
"""


def test_what_numba_is_spared_changes_nothing_of_the_code_that_it_makes(tmp_path: Path) -> None:
    """Up to the last instruction, where it depends on the calls typed before which of several functions is meant.

    Compiled with other options, as within ``inlined``, the same function of Numba's own is another one.  What another
    caller has called before is not compiled once more: then it is the same text.
    """
    (tmp_path / "compiled.py").write_text(COMPILED, encoding="utf-8")
    said = []
    for way in ("with", "without"):
        environment = {**os.environ, "ITOUCH_KERNELS": str(tmp_path / way), "PYTHONHASHSEED": "0"}
        done = subprocess.run(
            [sys.executable, "compiled.py", way],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600, check=True,
        )  # fmt: skip
        said.append(done.stdout.split("\0"))
    spared, alone = said
    assert len(set(spared)) > 10 and any("define " in text for text in spared)
    assert set(spared) == set(alone)
    assert len(spared) < len(alone)
