"""A fault in words: what followed names every device that one has to look at."""

from __future__ import annotations

from typing import Any

import pytest

from itouch_tools.viewer.fault_messages import outcome


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"safe": {"reached": True}}, ["devices: all have been made safe"]),
        (
            {"safe": {"reached": False, "unsafe": ["table", "plate"]}, "also": {"plate": "silent"}},
            [
                "also:    'plate' (silent)",
                "devices: not all could be seen to be safe ('table', 'plate' could not): look at them before you touch "
                "anything",
            ],
        ),
        (  # of a recording from before its devices were named
            {"safe": {"reached": False}},
            ["devices: not all could be seen to be safe: look at them before you touch anything"],
        ),
        ({}, []),
    ],
    ids=["safe", "two are not", "unnamed", "unknown"],
)
def test_what_followed_a_fault_names_every_unsafe_device(more: dict[str, Any], said: list[str]) -> None:
    assert outcome({"trip": "force", "device": "table", **more}) == said
