"""Kernels as the Python that they are written in, for tests for which nothing is to be compiled."""

from __future__ import annotations

from typing import Any


def python_of(kernel: Any) -> Any:
    """Return the function that a kernel is compiled from; what is only part of its callers is one itself."""
    return getattr(kernel, "py_func", kernel)
