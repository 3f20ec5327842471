"""Phantom and Touch arms through OpenHaptics: the device plugin and its driver, if the maker's library is there."""

from itouch_arms.openhaptics.openhaptics_device import OpenHaptics, OpenHapticsParams
from itouch_arms.openhaptics.phantom import Phantom

__all__ = ["OpenHaptics", "OpenHapticsParams", "Phantom"]
