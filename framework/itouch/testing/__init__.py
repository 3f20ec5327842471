"""The conformance suite for plugins: inherit a suite in your tests, or run ``itouch-py test-plugin NAME``.

>>> from itouch.testing import DeviceTests
>>> from itouch_lever import Lever                      # doctest: +SKIP
>>> class TestLever(DeviceTests):                       # doctest: +SKIP
...     device, name = Lever, "lever"
"""

from itouch.testing.checks import Check, CheckError, Finding
from itouch.testing.harness import DeviceSubject
from itouch.testing.scenario import ModalitySubject
from itouch.testing.suites import DeviceTests, EmulatorTests, ModalityTests

__all__ = [
    "Check",
    "CheckError",
    "DeviceSubject",
    "DeviceTests",
    "EmulatorTests",
    "Finding",
    "ModalitySubject",
    "ModalityTests",
]
