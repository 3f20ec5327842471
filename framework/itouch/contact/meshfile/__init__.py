"""Mesh files: read within bounds, checked, mended, and cached."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from itouch.contact.meshfile.faults import Finding, MeshError
    from itouch.contact.meshfile.load import LoadedMesh, load_mesh, load_source
    from itouch.contact.meshfile.mend import MeshFacts
    from itouch.contact.meshfile.source import KINDS, MeshFile, read_mesh_file

#: Public name -> the module that has it, imported on first access: a scene without meshes starts without all this.
_HOMES = {
    "KINDS": "source",
    "Finding": "faults",
    "LoadedMesh": "load",
    "MeshError": "faults",
    "MeshFacts": "mend",
    "MeshFile": "source",
    "load_mesh": "load",
    "load_source": "load",
    "read_mesh_file": "source",
}

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


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
