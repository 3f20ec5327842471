"""The error of sessions."""

from itouch.schema import ItouchError


class SessionError(ItouchError):
    """A snapshot that can't be written, read, or used here, or a session whose process has ended before it."""
