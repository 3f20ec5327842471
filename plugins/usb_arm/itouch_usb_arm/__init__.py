"""A USB haptic arm as a device plugin."""

from itouch_usb_arm.arm import UsbArm, UsbArmParams, UsbArmTwin

__all__ = ["UsbArm", "UsbArmParams", "UsbArmTwin"]
