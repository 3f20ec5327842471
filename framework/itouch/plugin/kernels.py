"""Compiled functions of a plugin, kept on disk together with a fingerprint of all that they are made of."""

from itouch.compiling import kernel, nogil_kernel

__all__ = ["kernel", "nogil_kernel"]
