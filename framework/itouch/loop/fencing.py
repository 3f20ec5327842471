"""What was written where it should not be, compiled: copies of memory, compared and put back."""

from __future__ import annotations

from typing import Any

from itouch.compiling import kernel


@kernel
def keep(memory: Any, spans: Any, kept: Any) -> int:
    """Copy the spans of memory, begins and ends (n, 2), one after the other; return 0."""
    at = 0
    for k in range(spans.shape[0]):
        begin, size = spans[k, 0], spans[k, 1] - spans[k, 0]
        for i in range(size):
            kept[at + i] = memory[begin + i]
        at += size
    return 0


@kernel
def differ(memory: Any, spans: Any, kept: Any) -> int:
    """Return 1 if the spans of memory are not what was kept, else 0."""
    at = 0
    for k in range(spans.shape[0]):
        begin, size = spans[k, 0], spans[k, 1] - spans[k, 0]
        changed = 0
        for i in range(size):
            changed |= kept[at + i] ^ memory[begin + i]
        if changed != 0:
            return 1
        at += size
    return 0


@kernel
def put_back(memory: Any, spans: Any, kept: Any) -> int:
    """Make the spans of memory what was kept; return 0."""
    at = 0
    for k in range(spans.shape[0]):
        begin, size = spans[k, 0], spans[k, 1] - spans[k, 0]
        for i in range(size):
            memory[begin + i] = kept[at + i]
        at += size
    return 0
