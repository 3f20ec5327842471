"""What only kernels call is optimized and becomes machine code with them alone, and does what it does by itself."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

KERNELS = """
from itouch.compiling import kernel, linked

@linked
def part(x):
    if x > 3.0:
        raise ValueError("too high", x)  # the number reaches Python through the function's environment
    return 2.0 * x

@linked
def above(x):
    return part(x) + 0.5

@kernel
def outer(x):
    return above(x) + part(x)

@kernel
def other(x):
    return 10.0 * part(x)
"""
RUN = """
import sys
from numba.core.codegen import JITCodeLibrary
from kernels import *
finished = []
of_numba = JITCodeLibrary._finalize_final_module
JITCodeLibrary._finalize_final_module = lambda self: finished.append(self.name) or of_numba(self)
for name in sys.argv[1:]:
    kernel = globals()[name]
    print(name, kernel(1.0), sum(kernel.stats.cache_hits.values()))
    try:
        kernel(4.0)
    except ValueError as error:
        print(*error.args)
print(*[name for name in finished if name in ("part", "above", "outer", "other")])
"""


def run(folder: Path, *kernels: str) -> list[str]:
    (folder / "kernels.py").write_text(KERNELS, encoding="utf-8")
    environment = {**os.environ, "ITOUCH_KERNELS": str(folder / "kept"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", RUN, *kernels]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_what_only_kernels_call_becomes_machine_code_with_them_alone_and_its_errors_keep_what_they_say(
    tmp_path: Path,
) -> None:
    assert run(tmp_path, "outer") == ["outer 4.5 0", "too high 4.0", "outer"]
    found = run(tmp_path, "outer", "other")  # one kernel is loaded, the other compiled: both call the same part
    assert found == ["outer 4.5 1", "too high 4.0", "other 20.0 0", "too high 4.0", "outer other"]
