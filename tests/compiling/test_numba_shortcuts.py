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
