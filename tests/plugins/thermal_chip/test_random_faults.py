"""Random faults: whatever happens, the true plate stays within 8 and 45 degC, the soak after it included."""

from __future__ import annotations

import campaign
import pytest

from itouch_thermal.chip import faults
from itouch_thermal.chip.program import Built


@pytest.mark.campaign
def test_no_fault_brings_the_true_plate_where_it_may_not_be(program: Built) -> None:
    chosen = faults.campaign(campaign.size(12, 1000), first=campaign.size(7, 1))
    found = [faults.run_fault(name, seed, program) for name, seed in chosen]
    wrong = [outcome for outcome in found if not outcome.safe]
    assert not wrong
    low, high = min(one.lowest for one in found), max(one.highest for one in found)
    campaign.tell(f"{len(found)} faults in the simulated display: the true plate was at {low:.2f} to {high:.2f} degC")
    assert len({one.state for one in found}) > 3, "protections did act"


def test_without_protection_the_plate_goes_where_it_may_not_be(program: Built) -> None:
    """The judge can say no: a display whose thermistors both stand still does overheat."""
    outcome = faults.run_fault("plate and guard stuck", 3, program)
    assert not outcome.safe
