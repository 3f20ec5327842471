"""An XYZ table as a device plugin."""

from itouch_xyz_table.table import XyzTable, XyzTableParams
from itouch_xyz_table.twin import XyzTableTwin

__all__ = ["XyzTable", "XyzTableParams", "XyzTableTwin"]
