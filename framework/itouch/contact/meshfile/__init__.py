"""Mesh files: read with bounds, checked, mended, and kept for the next time."""

from itouch.contact.meshfile.faults import Finding, MeshError
from itouch.contact.meshfile.load import LoadedMesh, load_mesh, load_source
from itouch.contact.meshfile.mend import MeshFacts
from itouch.contact.meshfile.source import KINDS, MeshFile, read_mesh_file

__all__ = [
    "KINDS",
    "Finding",
    "LoadedMesh",
    "MeshError",
    "MeshFacts",
    "MeshFile",
    "load_mesh",
    "load_source",
    "read_mesh_file",
]
