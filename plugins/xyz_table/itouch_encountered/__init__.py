"""The encountered surface: the flat top of what a device carries waits where a finger meets the virtual surface."""

from itouch_encountered.modality import Encountered, EncounteredModel, EncounteredParams

__all__ = ["Encountered", "EncounteredModel", "EncounteredParams"]
