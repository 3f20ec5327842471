"""Templates to start from: a plugin as a distribution of its own with numbered steps, a scene, and a study."""

from itouch_tools.scaffold.plugin import make_plugin
from itouch_tools.scaffold.scene import make_scene

__all__ = ["make_plugin", "make_scene"]
