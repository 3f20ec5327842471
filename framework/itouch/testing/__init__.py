"""The conformance suite for plugins: inherit a suite in your tests, or run ``itouch-py test-plugin NAME``.

>>> from itouch.testing import DeviceTests
>>> from itouch_lever import Lever                      # doctest: +SKIP
>>> class TestLever(DeviceTests):                       # doctest: +SKIP
...     device, name = Lever, "lever"
"""

from typing import Any

from itouch.moved import renamed
from itouch.testing.checks import Check, CheckError, CheckResult
from itouch.testing.harness import DeviceHarness
from itouch.testing.scenario import ModalityHarness
from itouch.testing.suites import DeviceTests, EmulatorTests, ModalityTests

__all__ = [
    "Check",
    "CheckError",
    "CheckResult",
    "DeviceHarness",
    "DeviceTests",
    "EmulatorTests",
    "ModalityHarness",
    "ModalityTests",
]

#: Old name -> new name, kept for one version.
_RENAMED = {"DeviceSubject": "DeviceHarness", "Finding": "CheckResult", "ModalitySubject": "ModalityHarness"}


def __getattr__(name: str) -> Any:
    return globals()[renamed(__name__, name, _RENAMED)]
