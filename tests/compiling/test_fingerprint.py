"""The fingerprint of a kernel is another one when anything that is compiled into it is another, however that was made."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from test_compiling import run

from itouch.fingerprint import fingerprint

#: What a module has beside a kernel ``outer`` that uses ``it``, with ``?`` for what changes: this, then that.
PARTS = {
    "a function under another name": ("from math import ? as it", "sin", "cos"),
    "a universal function under another name": ("from numpy import ? as it", "sin", "cos"),
    "a function of NumPy under another name": ("from numpy import ? as it", "mean", "median"),
    "a function of Python under another name": ("it = ?", "min", "max"),
    "a module under another name": ("import ? as it", "math", "numpy"),
    "a member of an enumeration": (
        "from enum import Enum\nclass Way(Enum):\n    UP = 1\n    DOWN = 2\nit = Way.?", "UP", "DOWN"),
    "a named tuple": ("from collections import namedtuple\nit = namedtuple('Pair', '?')(1.0, 2.0)", "a b", "b a"),
    "a slice": ("it = slice(?, 3)", "0", "1"),
    "an array in another order": ("import numpy as np\nit = np.as?array(np.ones((2, 2)))", "contiguous", "fortran"),
    "options of what is compiled with its caller": (
        "from numba.extending import register_jitable\n@register_jitable(error_model='?')\ndef it(x):\n    return 1.0 / x",
        "numpy", "python"),
    "whether it is inlined": (
        "from numba.extending import register_jitable\n@register_jitable(inline='?')\ndef it(x):\n    return 1.0 / x",
        "never", "always"),
    "what stands in for a function": (
        "from numba.extending import overload\ndef it(x):\n    return x\n@overload(it)\ndef other(x):\n"
        "    return lambda x: x * ?", "2.0", "3.0"),
    "a constant of what stands in for a function": (
        "from numba.extending import overload\nK = ?\ndef it(x):\n    return x\n@overload(it)\ndef other(x):\n"
        "    return lambda x: x * K", "2.0", "3.0"),
    "a universal function": ("from numba import vectorize\n@vectorize\ndef it(x):\n    return x * ?", "2.0", "3.0"),
    "the start of a reduction": (
        "from numba import vectorize\n@vectorize(['float64(float64, float64)'], identity=?)\n"
        "def it(x, y):\n    return x + y", "0", "1"),
    "a generalized universal function": (
        "from numba import guvectorize\n@guvectorize(['float64[:], float64[:]'], '(n)->(n)')\ndef it(x, y):\n"
        "    y[0] = x[0] * ?", "2.0", "3.0"),
    "a stencil": ("from numba import stencil\n@stencil\ndef it(x):\n    return x[0] * ?", "2.0", "3.0"),
    "the border of a stencil": ("from numba import stencil\n@stencil(cval=?)\ndef it(x):\n    return x[0]", "2.0", "3.0"),
    "a method of a class": (
        "from numba import float64\nfrom numba.experimental import jitclass\n@jitclass([('v', float64)])\nclass it:\n"
        "    def __init__(self, v):\n        self.v = v\n    def get(self):\n        return self.v * ?", "2.0", "3.0"),
    "a field of a class": (
        "from numba import float32, float64\nfrom numba.experimental import jitclass\n@jitclass([('v', ?)])\nclass it:\n"
        "    def __init__(self, v):\n        self.v = v", "float32", "float64"),
    "the type of a variable": (
        "from numba import float32, float64, njit\n@njit(locals={'y': ?})\ndef it(x):\n    y = x / 3.0\n    return y",
        "float32", "float64"),
    "the types that it is compiled for": (
        "from numba import njit\n@njit('float64(?)')\ndef it(x):\n    return x / 3.0", "float32", "float64"),
}  # fmt: skip
OUTER = "\nfrom itouch.compiling import kernel\n@kernel\ndef outer(x):\n    return it(x)\n"


@pytest.fixture
def read(request: pytest.FixtureRequest) -> Callable[[str], ModuleType]:
    """Return a function that makes a module of a text, always under the same name."""

    def make(text: str) -> ModuleType:
        sys.modules["with_parts"] = module = ModuleType("with_parts")
        exec(compile(text, __file__, "exec"), vars(module))
        return module

    request.addfinalizer(lambda: sys.modules.pop("with_parts", None))
    return make


@pytest.mark.parametrize("what", PARTS)
def test_a_kernel_with_another_part_has_another_fingerprint(read: Callable[[str], ModuleType], what: str) -> None:
    text, this, that = PARTS[what]
    modules = [read(text.replace("?", word) + OUTER) for word in (this, that, this)]
    first, other, again = (fingerprint(module.outer) for module in modules)
    assert first == again != other


OVERLOADED = """
import numpy as np
from math import {name} as it
from numba import types
from numba.extending import overload, overload_attribute, overload_method
from itouch.compiling import kernel

@overload(np.gradient)
def gradient(x):
    return lambda x: x * {factor}

@overload_method(types.Float, "itouch_times")
def times(x):
    return lambda x: x * {times}

@overload_attribute(types.Float, "itouch_more")
def more(x):
    return lambda x: x + {more}

@kernel
def outer(x):
    return np.gradient(x) + it(x) + x.itouch_times() + x.itouch_more
"""
RUN = "import kernels; print(kernels.outer(2.0), sum(kernels.outer.stats.cache_hits.values()))"


def test_what_stands_in_for_functions_methods_and_attributes_is_compiled_again_when_it_changes(tmp_path: Path) -> None:
    hits = []
    for name, *numbers in (
        ("floor", 2.0, 2.0, 1.0), ("floor", 3.0, 2.0, 1.0), ("fabs", 3.0, 2.0, 1.0), ("fabs", 3.0, 5.0, 1.0),
        ("fabs", 3.0, 5.0, 4.0), ("floor", 2.0, 2.0, 1.0),
    ):  # fmt: skip
        factor, times, more = numbers
        text = OVERLOADED.format(name=name, factor=factor, times=times, more=more)
        (tmp_path / "kernels.py").write_text(text, encoding="utf-8")
        value, hit = run(tmp_path, RUN, NUMBA_CACHE_DIR="", ITOUCH_KERNELS=str(tmp_path / "kept"))
        assert value == 2.0 * factor + 2.0 + 2.0 * times + 2.0 + more
        hits.append(hit)
    assert hits == [0, 0, 0, 0, 0, 1]


CHECKED = """
from itouch.compiling import kernel
@kernel
def outer(x):
    return x / 3.0
"""


@pytest.mark.parametrize(
    "setting",
    [{"NUMBA_BOUNDSCHECK": "1"}, *(pytest.param({name: value}, marks=pytest.mark.long)
     for name, value in (("NUMBA_OPT", "0"), ("NUMBA_DEBUGINFO", "1")))],
)  # fmt: skip
def test_settings_of_numba_have_their_own_kernels(tmp_path: Path, setting: dict[str, str]) -> None:
    """Who looks for an error with them gets what they ask for, and leaves nothing slow behind."""
    (tmp_path / "kernels.py").write_text(CHECKED, encoding="utf-8")
    assert [run(tmp_path, RUN, **more)[1] for more in ({}, setting, {}, setting)] == [0, 0, 1, 1]


def test_pythons_with_other_objects_have_other_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python without its lock, or built for debugging, has other objects than the same version without that."""
    from itouch import compiling, shipped

    names = set()
    for flags, _ in itertools.product(("", "t", "d"), range(2)):
        monkeypatch.setattr(sys, "abiflags", flags, raising=False)
        names.add((compiling.KernelCache(fingerprint.__wrapped__)._base, shipped.made_with()["python"]))
    assert len(names) == 3 and len({base for base, _ in names}) == len({python for _, python in names}) == 3
