"""A twin draws the same noise in Python and compiled."""

from __future__ import annotations

import numpy as np
import pytest

from itouch.plugin import Field, Record, gaussian
from itouch.plugin.kernels import gaussian as compiled_gaussian


@pytest.mark.parametrize("seed", [0, 1, 12345, (1 << 63) - 1, (1 << 64) - 1])
def test_compiled_noise_is_that_of_python(seed: int) -> None:
    state = Record.of([Field("noise", "u8"), Field("words", "u8", 1)])
    state["noise"] = state["words"] = np.uint64(seed)
    drawn = [(gaussian(state, "noise"), compiled_gaussian(state["words"])) for _ in range(1000)]
    assert all(one == other for one, other in drawn)
    assert state["noise"].item() == state["words"].item() != seed
    values = np.array(drawn)[:, 0]
    assert abs(values.mean()) < 0.15
    assert 0.85 < values.std() < 1.15
