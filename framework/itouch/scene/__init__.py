"""The XML of a scene, and the frozen description that is read from it."""

from itouch.scene.description import Scene
from itouch.scene.elements import PluginPart
from itouch.scene.extensions import Extensions
from itouch.scene.loader import load, loads, read_scene
from itouch.scene.places import Places
from itouch.scene.writer import write

__all__ = ["Extensions", "Places", "PluginPart", "Scene", "load", "loads", "read_scene", "write"]
