"""Recordings: MCAP files of everything that went into a session and came out of it.

``read`` opens one; a separate process does the writing (``itouch.recording.process``).
"""

from itouch.recording.errors import RecordingError
from itouch.recording.recording import Recording, read

__all__ = ["Recording", "RecordingError", "read"]
