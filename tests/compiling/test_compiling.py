"""What is kept of compiled functions is never older than what they were compiled from."""

from __future__ import annotations

import gc
import itertools
import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import campaign
import pytest
from numba import njit
from numba.core import errors, event
from requirements import meant

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


def run(folder: Path, program: str = RUN, **more: str) -> tuple[float, int]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONDONTWRITEBYTECODE": "1", **more}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
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


PARTS = """
from typing import NamedTuple

class Inner(NamedTuple):
    {first}: float
    {second}: float

class Outer(NamedTuple):
    inner: Inner
    more: int
"""
READS_PARTS = """
from itouch.compiling import kernel
from parts import Inner, Outer

@kernel
def outer(x):
    return x.inner.plus

def made():
    return Outer(Inner(2.0, 3.0), 1)
"""


def test_what_has_other_parts_under_the_same_name_is_compiled_again(tmp_path: Path) -> None:
    """A named tuple whose fields have changed places has the same types as before."""
    (tmp_path / "kernels.py").write_text(READS_PARTS, encoding="utf-8")
    shown = "import kernels; print(kernels.outer(kernels.made()), sum(kernels.outer.stats.cache_hits.values()))"
    steps = (("plus", "minus", (2.0, 0)), ("minus", "plus", (3.0, 0)), ("plus", "minus", (2.0, 1)))
    for first, second, found in steps:
        (tmp_path / "parts.py").write_text(PARTS.format(first=first, second=second), encoding="utf-8")
        assert run(tmp_path, shown) == found


def test_what_is_compiled_for_given_types_is_kept_too(tmp_path: Path) -> None:
    write(tmp_path)
    shown = "import kernels; from numba import float64; kernels.outer.compile(float64(float64)); "
    shown += "print(kernels.outer(2.0), sum(kernels.outer.stats.cache_hits.values()))"
    assert run(tmp_path, shown) == (2.0, 0)
    assert run(tmp_path, shown) == (2.0, 1)


@pytest.mark.skipif(os.geteuid() == 0, reason=meant("root can write everywhere"))
def test_without_a_place_to_keep_anything_it_is_compiled_every_time(tmp_path: Path) -> None:
    write(tmp_path)
    tmp_path.chmod(0o555)
    try:
        assert run(tmp_path, HOME=str(tmp_path / "none"), NUMBA_CACHE_DIR="") == (2.0, 0)
    finally:
        tmp_path.chmod(0o755)


def shared(folder: Path, **more: str) -> tuple[float, int]:
    """Run with what all copies of the sources share; the modules are those of ``folder``."""
    return run(folder, **{"NUMBA_CACHE_DIR": "", "ITOUCH_KERNELS": str(folder.parent / "shared"), **more})


def test_what_one_copy_of_the_sources_compiled_serves_another(tmp_path: Path) -> None:
    """A new environment, a second checkout, a branch and back: the fingerprint decides, not places and times."""
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        folder.mkdir()
        write(folder)
    assert shared(one) == (2.0, 0)
    assert shared(other) == (2.0, 1)
    os.utime(other / "kernels.py", (2e9, 2e9))
    assert shared(other) == (2.0, 1)
    write(other, factor="3.0")
    assert shared(other) == (6.0, 0)
    assert shared(one) == (2.0, 1)  # each goes on finding its own
    assert shared(other) == (6.0, 1)
    assert not list(one.rglob("*.nbc")) + list(other.rglob("*.nbc"))
    (tmp_path / "shared").chmod(0o777)  # others could have put it there
    write(other)
    assert shared(other) == (2.0, 0)
    assert list(other.rglob("*.nbc"))  # where Numba would keep it


NAMED = {
    "constant": "0.0", "member": "0", "arguments": "x, y", "body": "y - x", "default": "1", "alpha": "0.0", "type": "f8",
    "words": '"""A docstring."""',
}  # fmt: skip
NAMING = """
import enum
import numpy as np
from numba import types
class Kind(enum.IntEnum):
    LOW = {member}
CONSTANT, ROW, KIND = {constant}, np.dtype([("a", "{type}")]), types.float64 if "{type}" == "f8" else types.float32
def inner({arguments}, *, more={default}):
    return ({body}) * more
def outer(x):
    {words}
    return inner(x=x, y=Kind.LOW) + CONSTANT + package.module.ALPHA + np.zeros(1, ROW)[0].a + KIND(1.0)
"""


@pytest.mark.parametrize("change", [
    {"constant": "1.5"}, {"member": "7"}, {"arguments": "y, x", "body": "x - y"}, {"default": "2"}, {"alpha": "3.0"},
    {"type": "f4"},
], ids=lambda change: next(iter(change)))  # fmt: skip
def test_whatever_a_function_names_is_in_its_fingerprint(change: dict[str, str]) -> None:
    """Constants, members of an enumeration, names of arguments, what is named through two modules, dtypes."""
    from itouch.fingerprint import fingerprint

    def found(words: dict[str, str]) -> str:
        package, module = ModuleType("package"), ModuleType("package.module")
        package.module, module.ALPHA = module, float(words["alpha"])  # type: ignore[attr-defined]
        space = {"__name__": "naming", "package": package}
        exec(NAMING.format(**words), space)
        return fingerprint(space["outer"])

    assert found(NAMED) == found(NAMED)
    assert found(NAMED | {"words": '"""Another docstring."""'}) == found(NAMED)
    assert found(NAMED | change) != found(NAMED)


def test_what_is_kept_is_bounded_and_what_was_used_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch import compiling

    place = tmp_path / "kernels"
    monkeypatch.setattr(compiling, "CAPACITY", 3000)
    for number in range(6):
        store = compiling._SharedStore(str(place), f"function{number}", "stamp")
        store.save(("types", number), b"x" * 900)
        for path in place.glob(f"function{number}.*"):
            os.utime(path, (1e9 + number, 1e9 + number))
        if number == 2:
            first = compiling._SharedStore(str(place), "function0", "stamp")
            assert first.load(("types", 0)) == b"x" * 900  # used now, and therefore kept
    left = sorted(path.name[:9] for path in place.glob("*.nbc"))
    assert "function0" in left and "function5" in left and len(left) == 3
    gone = compiling._SharedStore(str(place), "function1", "stamp")
    assert gone.load(("types", 1)) is None  # listed, and no more there


def test_two_that_compile_at_once_never_take_a_kernel_for_another(tmp_path: Path) -> None:
    """Each has read the list before the other wrote: Numba would call both kernels the first."""
    from itouch import compiling

    class Late(compiling._Store):
        def _load_index(self) -> dict[object, str]:
            return {}

    for kind in (Late, compiling._Store):
        one, other = kind(str(tmp_path), "function", "stamp"), kind(str(tmp_path), "function", "stamp")
        one.save("float", b"of floats")
        other.save("int", b"of integers")
        read = compiling._Store(str(tmp_path), "function", "stamp")
        assert read.load("float") in (None, b"of floats")
        assert read.load("int") == b"of integers"
    assert read.load("float") == b"of floats"


def test_every_kernel_of_the_package_is_kept_with_its_fingerprint() -> None:
    from itouch.compiling import KernelCache, fingerprint
    from itouch.contact.step import step
    from itouch_thermal.flux.flux_tick import prepare

    for function in (prepare, step):
        compiled = function
        assert isinstance(compiled._cache, KernelCache)
        assert len(fingerprint(compiled.py_func)) == 64


@pytest.mark.parametrize("wrong", campaign.some(["data", "another program's type", "cut", "no pickle"], 1))
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


def test_garbage_is_looked_for_seldom_while_something_is_compiled() -> None:
    import itouch.compiling  # noqa: F401  - it is what does so

    class Look(event.Listener):
        def on_start(self, event: object) -> None:
            seen.append(gc.get_threshold())

        def on_end(self, event: object) -> None:
            pass

    seen, before = list[tuple[int, ...]](), gc.get_threshold()
    with event.install_listener("numba:compile", Look()):
        assert njit(lambda x: x + 1)(1) == 2
        assert min(each[0] for each in seen) >= 10_000
        with pytest.raises(errors.TypingError):
            njit(lambda x: x.absent)(1)
        assert gc.get_threshold() == before
        gc.set_threshold(0)
        try:
            seen.clear()
            njit(lambda x: x + 2)(1)
            assert seen[0][0] == gc.get_threshold()[0] == 0
        finally:
            gc.set_threshold(*before)


def test_options_of_two_compilations_are_equal_where_all_of_their_values_are() -> None:
    """They are compared by what is set in them first; what is set to its default is what is not set."""
    from numba.core.compiler import Flags

    every = [Flags() for _ in range(4)]
    every[1].nrt = every[2].nrt = every[3].fastmath = True
    every[2].error_model = "numpy"
    every.append(every[2].copy())
    every.append(Flags())
    every[-1].nrt = Flags.options["nrt"].default
    for one, other in itertools.product(every, repeat=2):
        same = one.values() == other.values()
        assert (one == other) is same
        assert hash(one) == hash(other) or not same
    assert every[0] == every[-1] and every[0] != every[1] and every[2] == every[4] and every[0] != "flags"


CALLERS = """
import numpy as np
from numba import njit
from itouch.compiling import addressed_kernel, inlined, kernel, nogil_kernel

inlines, fast = [], []
"""
#: The same for one kind of kernel, whose name stands in those of the functions: none is taken for another one's.
CALLER = """
@WAY
def summed_WAY(x):
    copy = x.copy()
    total = 0.0
    for i in range(copy.shape[0]):
        total += copy[i] / 3.0
    return total

@inlined
def step_WAY(x):
    return summed_WAY(x)

@njit(fastmath=True, error_model="python")
def others_WAY(x):
    return step_WAY(x)

@kernel
def own_WAY(x):
    return step_WAY(x)

FIRST_WAY(np.ones(64) / 7.0)
code = summed_WAY.inspect_llvm(summed_WAY.signatures[0])
assert "fadd" in code
inlines.append("alwaysinline" in code)
fast.append(" fast " in code or "reassoc" in code)
"""


@pytest.mark.parametrize("first", ["own", "others"])
def test_a_kernel_is_compiled_alike_whoever_calls_it_first(tmp_path: Path, first: str) -> None:
    # what is compiled for a caller takes over the caller's options, unless it has its own: an inlined one has no arrays
    ways = "kernel", "nogil_kernel", "addressed_kernel"
    program = [CALLERS, *(CALLER.replace("WAY", way) for way in ways), "print(float(sum(inlines)), sum(fast))"]
    assert run(tmp_path, "".join(program).replace("FIRST", first)) == (0.0, 0)
