"""Phantom and Touch arms through OpenHaptics, their maker's library: the device plugin and its driver."""

from itouch_arms.openhaptics.openhaptics_device import OpenHaptics, OpenHapticsParams
from itouch_arms.openhaptics.phantom import Phantom

__all__ = ["OpenHaptics", "OpenHapticsParams", "Phantom"]
