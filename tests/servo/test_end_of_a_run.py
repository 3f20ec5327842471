"""How the loop of a servo process ends: as it was asked to, or with what its session met."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from itouch.loop import DeviceFaultError
from itouch.monitors import Trip
from itouch.servo import control_block as at
from itouch.servo import serve


@pytest.mark.parametrize("met", [False, True])
def test_a_run_that_is_asked_to_stop_ends_well_unless_its_session_has_met_a_fault(met: bool) -> None:
    fault = DeviceFaultError("arm", 7, Trip.NONE, "was unplugged") if met else None
    session = SimpleNamespace(
        ticks=0, scripted=False, taps=[], loss_hooks=[], on=SimpleNamespace(waiting=[]), fault=fault
    )
    served: Any = object.__new__(serve.Servo)
    served.session, served._config, served.words = session, {"seconds": None}, {at.STOP: 1}
    served._follow_once = lambda: None
    if met:
        with pytest.raises(DeviceFaultError, match="unplugged"):
            served._run()
    else:
        served._run()
    assert served.words[at.PHASE] == at.RUNNING
