"""The thermal display and the heat of a touched object."""

from itouch_thermal.heat import Heat

__all__ = ["Heat"]
