"""The stiffness that can be rendered: K <= 2 (b - B) / T and K <= the device's own; B is lowered before K."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.world.virtual_coupling import stable

positive = st.floats(1e-3, 1e5)


@given(positive, st.floats(0, 100), st.floats(0, 50), positive, st.sampled_from([5e-4, 1e-3, 2e-3]))
def test_what_is_rendered_is_stable_and_never_more_than_asked(
    stiffness: float, material: float, damping: float, ceiling: float, period: float
) -> None:
    coupling = stable(stiffness, material, damping, ceiling, period)
    assert coupling.stiffness <= min(stiffness, ceiling) * (1 + 1e-12)
    assert 0.0 <= coupling.damping <= material
    assert coupling.stiffness <= 2 * (damping - coupling.damping) / period * (1 + 1e-9) + 1e-9


def test_damping_gives_way_first() -> None:
    assert stable(2000.0, 2.0, 5.0, 1e9, 1e-3) == (2000.0, 2.0)
    assert stable(8000.0, 2.0, 5.0, 1e9, 1e-3) == (8000.0, 1.0)
    assert stable(12000.0, 2.0, 5.0, 1e9, 1e-3) == pytest.approx((10000.0, 0.0))
    assert stable(12000.0, 2.0, 5.0, 3000.0, 1e-3) == (3000.0, 2.0)
