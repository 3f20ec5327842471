"""The dead-man's switch of a stored session is nobody's: who restores it on hardware must hold it anew."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_hardware import catalog
from test_latched import SCENE, pad, stored

import itouch
from itouch.plugin import Record


@pytest.mark.parametrize("by", ["word", "device"])
@pytest.mark.parametrize("form", ["itouch", "xml"])
def test_a_switch_that_was_held_when_a_session_was_stored_is_not_held_when_it_goes_on(
    tmp_path: Path, by: str, form: str
) -> None:
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    cls = pad()
    held = [1.0 if by == "device" else 0.0]

    def read(self, reading: Record) -> bool:  # type: ignore[no-untyped-def]
        self.count += 1
        reading["deadman"] = held[0]
        reading["plate_temperature"] = 303.15 + 1e-6 * (self.count % 7)
        return True

    cls.read = read
    session = itouch.build(tmp_path / "scene.xml", catalog=catalog(cls))
    session.hold(by == "word")
    session.enable()
    session.run(0.02)
    path = stored(session, form, tmp_path)
    held[0] = 0.0
    again = itouch.restore(path, catalog=catalog(cls))
    cls.sent.clear()
    with pytest.raises(itouch.ItouchError, match="switch"):
        again.enable()
        again.tick()
    assert not any(cls.sent)
    assert again.status("pad").name != "ENABLED"
    assert not again.held
    again.close()
