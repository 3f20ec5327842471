"""Kernels as the Python that they are written in, for tests that compile nothing; parts of kernels, compiled alone."""

from __future__ import annotations

from typing import Any


def python_of(kernel: Any) -> Any:
    """Return the function that a kernel is compiled from; what is only part of its callers is one itself."""
    return getattr(kernel, "py_func", kernel)


def kernel_of(part: Any) -> Any:
    """Return what is only part of its callers as a kernel by itself, compiled as it is within them."""
    from itouch.compiling import kernel

    return kernel(part)
