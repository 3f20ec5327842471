"""The error of recordings that cannot be written or read."""

from itouch.schema import ItouchError


class RecordingError(ItouchError):
    """A recording cannot be written or read; the message names file and cause."""
