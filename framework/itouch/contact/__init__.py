"""Contact of a probe with primitives and meshes: pure geometry and force, arrays in, arrays out."""

from itouch.contact.geometry_tables import Friction, Geometry
from itouch.contact.mesh_surface import Surface
from itouch.contact.proxy import Proxy
from itouch.contact.shapes import Box, Capsule, Cylinder, Mesh, Plane, Shape, Sphere

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
