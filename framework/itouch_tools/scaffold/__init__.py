"""Templates to start from: a plugin as a distribution of its own with numbered steps, a scene, and a study."""

from itouch_tools.scaffold.files import make_scene, make_study
from itouch_tools.scaffold.plugin_distribution import make_plugin

__all__ = ["make_plugin", "make_scene", "make_study"]
