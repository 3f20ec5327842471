"""Why no HJIF file (ISO/IEC 23090-31) is written: its schema can't be followed from what is public."""

from __future__ import annotations

from typing import NoReturn

from itouch.recording.errors import RecordingError
from itouch.recording.recording import Recording

REASON = (
    "no HJIF file is written: the schema of ISO/IEC 23090-31 is not among the files of MPEG's public reference "
    "software, whose build fetches it from a server of MPEG's, so that a file could not be checked against it; "
    "--csv, --parquet and --bids keep all channels with their units"
)


def export_hjif(recording: Recording, target: str) -> NoReturn:
    """Say why it can't be done.

    Raises
    ------
    RecordingError
        Always.
    """
    raise RecordingError(REASON)
