"""The manifest of a snapshot: the version, commit and machine that wrote it, and the digests of its files."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from itouch.plugin.discovery import Catalog
from itouch.session import stored_limits
from itouch.session.paths import without_folders
from itouch.world import Model

#: Version of the snapshot format: 1.0 had no bases, no assets and no digests of layout and model; 1.1 no limits.
FORMAT = "1.2"


def digest(data: bytes) -> str:
    """Return the SHA-256 of some bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def constant_part(
    model: Model, catalog: Catalog, xml: bytes, dtype: np.dtype[Any], before: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return what does not change during a session; ``before``: limits of the stored session from which it goes on."""
    scene = model.scene
    return {
        "format": FORMAT,
        "itouch-py": metadata.version("itouch-py"),
        "plugins": plugin_versions(model, catalog),
        "source": without_folders(scene.source),
        "git": git_revision(),
        "host": host_facts(),
        "twins": {device.name: device.twin for device in scene.devices},
        "layout": digest(repr(dtype.descr).encode()),
        "model": model_digest(model),
        "contact": contact_digest(model),
        "scene": digest(xml),
        "limits": stored_limits.stated(model, before),
        "files": {file.file: file.digest for file in model.files},
    }


def plugin_versions(model: Model, catalog: Catalog) -> dict[str, str]:
    """Return the version of every plugin that the scene uses, also of the modalities that it uses by default."""
    scene = model.scene
    used = {device.plugin for device in scene.devices} | {part.plugin for part in scene.modalities}
    used |= {modality.plugin for modality in model.modalities}
    used |= {part.plugin for material in scene.materials for part in material.parts}
    return {name: version for name in sorted(used) if (version := catalog.version(name))}


@lru_cache(maxsize=1)
def host_facts() -> Mapping[str, str | int | None]:
    """Return what may affect results: system, processor, and the versions of Python, NumPy and Numba."""
    return {
        "system": f"{platform.system()} {platform.release()}",
        "machine": platform.machine(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": metadata.version("numba"),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")


@lru_cache(maxsize=1)
def git_revision() -> str | None:
    """Return the commit of the running program's checkout, or None if it is not in one."""
    for folder in Path(__file__).resolve().parents:
        git = folder / ".git"
        if git.is_dir():
            try:
                return _head(git)
            except OSError:
                return None
    return None


def _head(git: Path) -> str | None:
    head = (git / "HEAD").read_text(encoding="ascii").strip()
    if not head.startswith("ref: "):
        return head
    name = head.removeprefix("ref: ")
    if (git / name).is_file():
        return (git / name).read_text(encoding="ascii").strip()
    packed = (git / "packed-refs").read_text(encoding="ascii").splitlines()
    return next((line.split()[0] for line in packed if line.endswith(" " + name)), None)


def model_digest(model: Model) -> str:
    """Return a digest of the compiled scene; if that of contact is equal, too, a session goes on byte for byte."""
    found = hashlib.sha256()
    _feed(found, [(d.name, d.mount, dict(d.limits.table())) for d in model.devices.values()])
    _feed(found, [model.poses, model.geometry, model.period])
    _feed(found, [(m.name, m.every, m.model) for m in model.modalities])
    return found.hexdigest()


def contact_digest(model: Model) -> str:
    """Return a digest of what `model_digest` leaves out: how probes meet objects, and how hands and objects move.

    It has a place of its own in the manifest, because sessions of earlier versions state the other one only.
    """
    found = hashlib.sha256()
    _feed(found, [model.probes, model.effects, (model.motions.scripts, model.motions.pieces)])
    return found.hexdigest()


def _feed(found: Any, value: Any, depth: int = 0) -> None:
    """Feed a value to a digest: arrays as bytes, containers part by part, plain values as text, else only the type."""
    if isinstance(value, np.ndarray):
        found.update(f"{value.dtype}{value.shape}".encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, (str, int, float, bool, type(None))):
        found.update(repr(value).encode())
    elif depth > 12:
        found.update(type(value).__name__.encode())
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _feed(found, key, depth + 1)
            _feed(found, item, depth + 1)
    elif isinstance(value, (tuple, list)):
        for item in value:
            _feed(found, item, depth + 1)
    elif is_dataclass(value) and not isinstance(value, type):
        for part in fields(value):
            _feed(found, getattr(value, part.name), depth + 1)
    else:
        found.update(type(value).__name__.encode())
