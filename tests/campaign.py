"""Campaigns have a short form, which runs by default, and a full one: ``ITOUCH_CAMPAIGN=full pytest FILE -s``."""

from __future__ import annotations

import os

FULL = os.environ.get("ITOUCH_CAMPAIGN") == "full"


def size(short: int, full: int) -> int:
    """Return how many cases to try."""
    return full if FULL else short


def tell(text: str) -> None:
    """Print a line of a full campaign's result."""
    if FULL:
        print("campaign:", text, flush=True)
