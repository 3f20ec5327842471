"""What to do if a user may not open a USB device: the one recipe that `doctor`, drivers and templates tell."""

from __future__ import annotations


def permission_advice(vendor: str = "VVVV", product: str = "PPPP") -> str:
    """Return how Linux is told to let whoever sits at the machine open a device; ids as four hexadecimal digits."""
    ids = f'ATTR{{idVendor}}=="{vendor}", ATTR{{idProduct}}=="{product}"'
    rule = f'SUBSYSTEM=="usb", {ids}, MODE="0660", TAG+="uaccess"'
    return (
        f"as root write {rule} to /etc/udev/rules.d/70-itouch.rules, run udevadm control --reload, and plug it in again"
    )
