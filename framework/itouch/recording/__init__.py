"""Recordings: MCAP files of everything that went into a session and came out of it.

``read`` opens one; the writing is done by a process of its own (``itouch.recording.process``).
"""

from itouch.recording.errors import RecordingError
from itouch.recording.recording import Recording, read

__all__ = ["Recording", "RecordingError", "read"]
