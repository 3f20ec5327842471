"""Errors of arms that their makers' software drives, each with a name of its own."""

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
    """What came is not what the documentation says, or no possible position."""


class NotCalibrated(ArmError):  # noqa: N818
    """The arm does not know where it is: positions mean nothing and no force may be sent."""


class Refused(ArmError):  # noqa: N818
    """The arm is there but cannot give forces: no power, a fault of its own, or another program's settings."""
