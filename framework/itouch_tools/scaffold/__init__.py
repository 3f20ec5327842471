"""Beginnings: a plugin as a distribution of its own with numbered steps, and a scene to start from."""

from itouch_tools.scaffold.plugin import make_plugin
from itouch_tools.scaffold.scene import make_scene

__all__ = ["make_plugin", "make_scene"]
