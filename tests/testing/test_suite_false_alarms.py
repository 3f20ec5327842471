"""No good plugin is blamed, however it is written."""

from __future__ import annotations

import pytest
from good_styles import GOOD

from itouch.testing.checks import examine
from itouch.testing.harness import DeviceHarness
from itouch.testing.suites import DEVICE_CHECKS

#: These look at every device in the same way, whatever its style, and start processes for it.
_ALIKE = ("import", "sigterm")


#: Of these each is the only one to show a way of its own through the suite; the others run in the long form.
_ALWAYS = ("BuffersTwinDevice", "ThreadedSlider", "HasNoTwin")


@pytest.mark.parametrize(
    "cls",
    [pytest.param(cls, id=cls.__name__, marks=() if cls.__name__ in _ALWAYS else pytest.mark.long) for cls in GOOD],
)
def test_a_good_plugin_is_not_blamed(cls):
    harness = DeviceHarness(cls, "slider", hardware=not cls.twin_only)
    checks = [check for check in DEVICE_CHECKS if check.name not in _ALIKE]
    blamed = [f"{f.check.name}: {f.note}" for f in examine(checks, harness) if f.outcome == "failed"]
    assert not blamed, "\n".join(blamed)
