"""A touch of the scene with a display of one's own, as a user runs it, on its simulated chip: what is asked of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from itouch_thermal.chip.program import Built
from itouch_tools.cli.virtual_rig import main

SCENE = Path(__file__).parents[3] / "scenes" / "four_materials_diy.xml"
#: How long the run takes [s], and how long after the first touch, which the plate awaits, it is to be calm [s].
END, CALM = 10.2, 0.465
ASKED = re.compile(r'^[\d.]+ peltier > "I \d+ (?P<current>-?[\d.]+)\*')


@pytest.mark.parametrize("seed", ["0", "2", "3"])
def test_the_current_comes_to_rest_after_the_finger_has_come(program: Built, tmp_path: Path, seed: str) -> None:
    """A loop that asks for more than the driver's slew allows swings by its whole range, for a second or for the touch."""
    trace = tmp_path / "wire.trace"
    words = ["--run", "--only", "peltier", "--for", f"{END}s", "--seed", seed, "--trace", str(trace)]
    assert main([str(SCENE), *words]) == 0
    found = [match for match in map(ASKED.match, trace.read_text(encoding="utf-8").splitlines()) if match]
    asked = np.array([float(match["current"]) for match in found])
    # The trace has the machine's time; in step, each exchange takes the same simulated time, however busy that is.
    times = END * np.arange(1, len(asked) + 1) / len(asked)
    on = asked != 0.0  # at the end the current is set to zero
    late = on & (times > times[on][-1] - 1.3)  # before that the plate is brought to its start temperature
    begun = times[late & (np.abs(asked) > 0.5)][0]
    rest = asked[on & (times > begun + CALM)]
    assert len(rest) > 30
    assert np.ptp(asked) > 1.0, "the touch never asked for much, so nothing was shown"
    assert np.ptp(rest) < 0.5
