"""What the twins of a virtual rig know is read in another process without a wait, whole or not at all."""

from __future__ import annotations

import stat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from itouch.exchange import TruthReader, TruthWriter
from itouch.exchange.shared_state import SLOTS
from itouch.plugin import Field, Record


def states() -> dict[str, Record]:
    display = Record.of([Field("true_flux"), Field("plate", "f8", 3), Field("begun", "i8")])
    return {"peltier": display, "arm": Record(np.dtype([]))}


def test_the_newest_is_read_with_its_time(tmp_path: Path) -> None:
    known = states()
    writer = TruthWriter(str(tmp_path / "truth"), known)
    reader = TruthReader(str(tmp_path / "truth"))
    assert not reader.read()
    for number in range(3 * SLOTS + 1):
        known["peltier"]["true_flux"] = 10.0 * number
        known["peltier"]["plate"] = (1.0, 2.0, number)
        known["peltier"]["begun"] = -number
        writer.write(1e-3 * number)
        assert reader.read()
        assert reader.now == 1e-3 * number
        assert reader.states == {"peltier": known["peltier"]}
    assert stat.S_IMODE((tmp_path / "truth").stat().st_mode) == 0o600
    writer.close()
    reader.close()
    with pytest.raises(FileExistsError):
        TruthWriter(str(tmp_path / "truth"), known)


def test_what_was_written_over_while_it_was_read_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The number of records is looked at before and after: by how much it may have grown is what the slots are for."""
    known = states()
    TruthWriter(str(tmp_path / "truth"), known).write(5.0)
    reader = TruthReader(str(tmp_path / "truth"))
    for grown, whole in ((0, True), (SLOTS - 2, True), (SLOTS - 1, False), (3 * SLOTS, False)):
        looks = iter([(1,), (1 + grown,)])
        monkeypatch.setattr(
            "itouch.exchange.shared_state._COUNT", SimpleNamespace(unpack_from=lambda _, looks=looks: next(looks))
        )
        assert reader.read() == whole
