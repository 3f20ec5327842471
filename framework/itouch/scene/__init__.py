"""The XML of a scene, and the frozen description that is read from it."""

from itouch.scene.canonical_xml import write
from itouch.scene.description import Scene
from itouch.scene.elements import PluginPart
from itouch.scene.extensions import Extensions
from itouch.scene.loader import load, loads, read_scene
from itouch.scene.places import Places

__all__ = ["Extensions", "Places", "PluginPart", "Scene", "load", "loads", "read_scene", "write"]
