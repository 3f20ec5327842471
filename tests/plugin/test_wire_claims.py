"""Who holds a wire: a session that begins waits for the guardian of one that has ended, and not for ever."""

from __future__ import annotations

import sys

import pytest
from requirements import meant

from itouch.plugin import wire_claims


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason=meant("guardians hold wires on Linux only"))
@pytest.mark.parametrize(("patience", "held_for", "waits"), [(60.0, 3, True), (0.0, 1000, False)])
def test_a_guardian_is_waited_for_until_it_lets_go_or_it_has_taken_too_long(
    patience: float, held_for: int, waits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    holders = iter([*[4711] * held_for, None])
    monkeypatch.setattr(wire_claims, "_PATIENCE", patience)
    monkeypatch.setattr(wire_claims, "_LOOK", 0.001)
    monkeypatch.setattr(wire_claims, "_holder", lambda name: next(holders))
    if waits:
        wire_claims._await_guardian("name", "/dev/ttyACM0")
        assert next(holders, "over") == "over"
    else:
        with pytest.raises(wire_claims.WireHeldError, match="'/dev/ttyACM0' is in use by .*the guardian"):
            wire_claims._await_guardian("name", "/dev/ttyACM0")
