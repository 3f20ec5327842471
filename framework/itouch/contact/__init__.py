"""Contact of a probe with primitives and meshes: pure geometry and force, arrays in, arrays out."""

from itouch.contact.geometry import Friction, Geometry
from itouch.contact.shapes import Box, Capsule, Cylinder, Plane, Shape, Sphere

__all__ = ["Box", "Capsule", "Cylinder", "Friction", "Geometry", "Plane", "Shape", "Sphere"]
