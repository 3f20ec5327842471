"""The reason of an error in a sentence."""

from __future__ import annotations

from itouch.schema.diagnostics import reason


def test_an_error_without_a_message_is_named_by_its_class() -> None:
    assert reason(OSError("the disk is full")) == "the disk is full"
    assert reason(EOFError()) == "EOFError"
