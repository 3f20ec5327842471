"""Processes that compile for one start: each kernel is compiled by one of them, from either end of a list."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core.errors import TypingError
from requirements import meant

from itouch import compiling
from itouch.compiling import compile_together, kernel
from itouch.joining import can_join

KERNELS = """
import os, signal, sys
from pathlib import Path
from itouch.compiling import KernelCache, compile_together, kernel
from itouch.joining import Chain, listing
from itouch.plugin import Bound
import numpy as np

@kernel
def inner(x):
    total = 0.0
    for i in range(x.shape[0]):
        for j in range(i):
            total += {more}
    return total

@kernel
def first(x, y):
    y[0] = inner(x) + 1.0
    return 0

@kernel
def last(x, y):
    y[0] = inner(x) - 1.0
    return 0

x, y = np.arange(4.0), np.zeros(1)
"""
BOTH = """
from kernels import *
compile_together(Path(sys.argv[1]))
for function in {"forwards": (first, last), "backwards": (last, first)}[sys.argv[2]]:
    function(x, y)
print(KernelCache.missed)
"""
KILLED = """
from kernels import *
from numba.core import event

class Ends(event.Listener):
    def on_start(self, seen):
        if seen.data["dispatcher"].py_func.__name__ == "inner":
            os.kill(os.getpid(), signal.SIGKILL)
    def on_end(self, seen):
        pass

event.register("numba:compile", Ends())
compile_together(Path(sys.argv[1]))
first(x, y)
"""
LISTED = """
from kernels import *
with listing() as compile_listed:
    chain = Chain([Bound(first, x, y), Bound(last, x, y)])
    chain.warm_up()
    assert chain.run() == -1 and y[0] == 0.0
    missed = KernelCache.missed
    compile_listed(0.5)
    assert KernelCache.missed == missed + 3  # two entries, with what they are the entries of, and what both call
Chain([Bound(first, x, y)]).run()
assert y[0] == first.py_func.__globals__["inner"](x) + 1.0
assert KernelCache.missed <= missed + 4  # the entries are there: inner alone, as Python calls it
"""


def begin(folder: Path, script: str, *words: str, more: str = "x[i] * x[j]") -> subprocess.Popen[str]:
    (folder / "kernels.py").write_text(KERNELS.format(more=more), encoding="utf-8")
    environment = {**os.environ, "ITOUCH_KERNELS": str(folder / "kept"), "PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", script, *words]
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def said(process: subprocess.Popen[str]) -> str:
    out, error = process.communicate(timeout=600)
    assert process.returncode == 0, error
    return out


def test_two_processes_compile_each_kernel_once(tmp_path: Path) -> None:
    (tmp_path / "together").mkdir()
    place, long = str(tmp_path / "together"), "np.sort(x)[j] + np.arctan2(x[j], 1.0)"  # takes so long that they meet
    both = [begin(tmp_path, BOTH, place, way, more=long) for way in ("forwards", "backwards")]
    assert sum(int(said(process)) for process in both) == 3


def test_what_a_process_was_at_that_was_killed_is_compiled_by_another(tmp_path: Path) -> None:
    (tmp_path / "together").mkdir()
    killed = begin(tmp_path, KILLED, str(tmp_path / "together"))
    killed.communicate(timeout=600)
    assert killed.returncode == -9
    assert any((tmp_path / "together").iterdir())
    assert said(begin(tmp_path, BOTH, str(tmp_path / "together"), "forwards")) == "3\n"


def test_a_folder_that_has_gone_lets_everybody_compile_alone(tmp_path: Path) -> None:
    assert said(begin(tmp_path, BOTH, str(tmp_path / "gone"), "forwards")) == "3\n"


def test_what_is_listed_is_compiled_and_not_run(tmp_path: Path) -> None:
    said(begin(tmp_path, LISTED))


SUSPENDED = """
from kernels import *
from numba.core import event

class Stops(event.Listener):
    def on_start(self, seen):
        if seen.data["dispatcher"].py_func.__name__ == "inner":  # it holds two claims now
            print("stopped", flush=True)
            os.kill(os.getpid(), signal.SIGSTOP)
    def on_end(self, seen):
        pass

event.register("numba:compile", Stops())
compile_together(Path(sys.argv[1]))
first(x, y)
"""
PATIENT = """
from kernels import *
from itouch import compiling

tried, locks = [], compiling._locks
def counted(file):
    tried.append(os.fstat(file).st_ino)
    return locks(file)

compiling._locks, compiling._LONGEST = counted, 0.5
compile_together(Path(sys.argv[1]))
first(x, y)
last(x, y)
print([tried.count(file) > 1 for file in dict.fromkeys(tried)])
"""


def test_a_suspended_process_is_waited_for_once(tmp_path: Path) -> None:
    """It keeps all of its claims: a kernel and what that calls were waited for one after the other."""
    (tmp_path / "together").mkdir()
    stopped = begin(tmp_path, SUSPENDED, str(tmp_path / "together"))
    try:
        assert stopped.stdout is not None and stopped.stdout.readline() == "stopped\n"
        assert said(begin(tmp_path, PATIENT, str(tmp_path / "together"))) == "[True, False, False]\n"
    finally:
        stopped.kill()
        stopped.communicate()


@pytest.mark.skipif(not can_join(), reason=meant("kernels run as Python here"))
def test_nobody_waits_for_a_kernel_that_could_not_be_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its claim was kept, and who tried it once more, the same process too, waited for two minutes."""

    @kernel
    def wrong(x: Any) -> Any:
        return x.there

    monkeypatch.setattr(compiling, "_LONGEST", 0.3)
    before = compiling._together
    compile_together(tmp_path)
    try:
        for _ in range(2):
            with pytest.raises(TypingError):
                wrong(1.0)
        assert compiling._patient  # it has not waited in vain
        (claim,) = tmp_path.iterdir()
        with claim.open("r+b") as file:
            assert compiling._locks(file.fileno())
    finally:
        compile_together(before)
