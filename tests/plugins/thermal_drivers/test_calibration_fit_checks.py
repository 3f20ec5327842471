"""When a fit is doubted, and when the line of a simulated controller is slow again."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from itouch_thermal.drivers import fits
from itouch_thermal.drivers.virtual import SILENCE, Plate, VirtualMecom


def test_a_controllers_line_stays_fast_as_long_as_it_hears_its_host_often_enough() -> None:
    device = VirtualMecom(Plate(), raised=1_000_000)
    for now, fast in ((1.0, 1_000_000), (SILENCE, 1_000_000), (SILENCE + 1e-3, 0), (SILENCE + 2e-3, 0)):
        device.now = now
        assert device.fast() == fast


@pytest.mark.parametrize(("residual", "swing", "doubted"), [(0.03, 1.0, False), (0.05, 1.0, True), (0.05, 10.0, False)])
def test_a_fit_is_doubted_beyond_a_few_times_the_noise_and_a_part_of_the_change(
    residual: float, swing: float, doubted: bool
) -> None:
    params = SimpleNamespace(plate_noise=0.01, sink_noise=0.01, resistance=2.0)
    found = list(fits._doubts(params, {"resistance": 2.1}, residual, swing))
    assert len(found) == doubted
    assert all("even with the best module the computed response is 0.05 K (rms) off" in said for said in found)
