"""What computes: versions and content of program, plugins and compiler, which must be the same on every worker."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

#: Distributions whose versions determine the numbers that come out.
COMPILERS = ("numba", "llvmlite", "numpy")


def identity(packages: Mapping[str, Iterable[str]]) -> dict[str, str]:
    """Return the version of everything that computes, by name.

    Parameters
    ----------
    packages
        The top-level packages of each distribution: of the program and of the plugins that the runs use.
    """
    found = {"python": platform.python_version()}
    found |= {name: metadata.version(name) for name in COMPILERS}
    for name in sorted(packages):
        found[name] = f"{version_of(name)} ({content_of(tuple(sorted(packages[name])))[:12]})"
    return found


def version_of(distribution: str) -> str:
    """Return the version of a distribution; empty if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""


@lru_cache(maxsize=8)
def content_of(packages: tuple[str, ...]) -> str:
    """Return a digest of the source of packages, which distinguishes two checkouts with the same version number."""
    total = hashlib.sha256()
    for package in packages:
        for name, path in files_of(package):
            total.update(f"\0{name}\0".encode() + path.read_bytes())
    return total.hexdigest()


def files_of(package: str) -> list[tuple[str, Path]]:
    """Return the files of a package, sorted, as (name from the package on, path); without what Python generates."""
    spec = find_spec(package)
    if spec is None:
        return []
    if not spec.submodule_search_locations:
        return [(f"{package}.py", Path(spec.origin))] if spec.origin else []
    found = []
    for folder in spec.submodule_search_locations:
        for path in sorted(Path(folder).rglob("*")):
            inner = path.relative_to(folder)
            if path.is_file() and path.suffix in (".py", ".so", ".pyd") and not _made(inner):
                found.append((f"{package}/{inner.as_posix()}", path))
    return found


def _made(path: Path) -> bool:
    return "__pycache__" in path.parts or path.parts[0] == "compiled"


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[str]:
    """Return sentences on what differs, where ``here`` is what is wanted."""
    found = []
    for name in sorted({*here, *there}):
        wanted, other = here.get(name, ""), there.get(name, "")
        if wanted != other:
            found.append(f"{name} is {other or 'not installed'}, not {wanted or 'wanted'}")
    return found


@lru_cache(maxsize=1)
def cpu_model() -> str:
    """Return the name of the processor: floating point may differ between models."""
    from itouch.session.manifest import host_facts

    return str(host_facts()["processor"] or platform.machine())
