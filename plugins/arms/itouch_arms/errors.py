"""Errors of arms that are driven through their makers' software: one class for each cause."""

from __future__ import annotations

from itouch.plugin import DeviceError


class ArmError(DeviceError):
    """The arm, or the software that drives it, is missing, refuses, or has failed."""


class NotFound(ArmError):  # noqa: N818
    """The software does not answer, is not installed, or has no such arm."""


class Disconnected(ArmError):  # noqa: N818
    """The arm, or the connection to its software, is gone; open it again when it is back."""


class Timeout(ArmError, TimeoutError):  # noqa: N818
    """No answer came in time."""


class ProtocolError(ArmError):
    """A message contradicts the protocol's documentation, or a position is impossible."""


class NotCalibrated(ArmError):  # noqa: N818
    """The arm is not calibrated: its positions mean nothing, and no force may be sent."""


class Refused(ArmError):  # noqa: N818
    """The arm is present but cannot give forces: it has no power, a fault, or settings made by another program."""
