"""A simulated Falcon, from its mechanics to its bytes, against which the driver is tested."""

from itouch_usb_arm.virtual.backend import VirtualBackend
from itouch_usb_arm.virtual.faults import Faults
from itouch_usb_arm.virtual.hand import Hand, Rest
from itouch_usb_arm.virtual.times import HostTime, VirtualTime
from itouch_usb_arm.virtual.virtual_falcon import VirtualFalcon

__all__ = ["Faults", "Hand", "HostTime", "Rest", "VirtualBackend", "VirtualFalcon", "VirtualTime"]
