"""Recordings: MCAP files of everything that went into a session and came out of it.

``read`` opens one; a separate process does the writing (``itouch.recording.writing_process``).
"""

from itouch.recording.recording import Recording, read
from itouch.recording.recording_error import RecordingError

__all__ = ["Recording", "RecordingError", "read"]
