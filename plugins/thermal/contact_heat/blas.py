"""One thread for small linear algebra.

NumPy's OpenBLAS starts its threads even for matrices as small as ours; on a busy machine they then wait for one
another a hundred times longer than the work takes.  With another BLAS nothing changes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache

import numpy as np

_PREFIXES = ("scipy_openblas_{}_num_threads64_", "openblas_{}_num_threads64_", "openblas_{}_num_threads")


@lru_cache(maxsize=1)
def _switches() -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """Find the functions that get and set the number of threads in the library that NumPy has loaded."""
    path = getattr(getattr(np.linalg, "_umath_linalg", None), "__file__", None)
    library = ctypes.CDLL(path) if path else None
    for prefix in _PREFIXES:
        if hasattr(library, prefix.format("get")) and hasattr(library, prefix.format("set")):
            return getattr(library, prefix.format("get")), getattr(library, prefix.format("set"))
    return None


@contextmanager
def one_thread() -> Iterator[None]:
    """Use one thread for linear algebra in this block."""
    switches = _switches()
    if switches is None:
        yield
        return
    get, put = switches
    before = get()
    put(1)
    try:
        yield
    finally:
        put(before)
