"""Contact of a probe with primitives and meshes: pure geometry and force, arrays in, arrays out."""

from itouch.contact.geometry import Friction, Geometry
from itouch.contact.proxy import Proxy
from itouch.contact.shapes import Box, Capsule, Cylinder, Mesh, Plane, Shape, Sphere
from itouch.contact.surface import Surface

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Friction",
    "Geometry",
    "Mesh",
    "Plane",
    "Proxy",
    "Shape",
    "Sphere",
    "Surface",
]
