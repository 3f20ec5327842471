"""Mesh files: read within bounds, checked, repaired, and cached."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from itouch.moved import renamed

if TYPE_CHECKING:
    from itouch.contact.meshfile.faults import MeshError, MeshFinding
    from itouch.contact.meshfile.load import LoadedMesh, load_mesh, load_source
    from itouch.contact.meshfile.mesh_bytes import KINDS, MeshFile, read_mesh_file
    from itouch.contact.meshfile.repair import MeshFacts

#: Public name -> the module that has it, imported on first access: a scene without meshes starts without all this.
_HOMES = {
    "KINDS": "mesh_bytes",
    "MeshFinding": "faults",
    "LoadedMesh": "load",
    "MeshError": "faults",
    "MeshFacts": "repair",
    "MeshFile": "mesh_bytes",
    "load_mesh": "load",
    "load_source": "load",
    "read_mesh_file": "mesh_bytes",
}

__all__ = [
    "KINDS",
    "LoadedMesh",
    "MeshError",
    "MeshFacts",
    "MeshFile",
    "MeshFinding",
    "load_mesh",
    "load_source",
    "read_mesh_file",
]

#: Old name -> new name, kept for one version.
_RENAMED = {"Finding": "MeshFinding"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        return __getattr__(renamed(__name__, name, _RENAMED))
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
