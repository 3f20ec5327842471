"""What is cached on disk so that a start is quick: compiled kernels, results of compiling scenes, meshes."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from itouch import caches, compiling
from itouch_tools.cli.doctor.diagnosis import Diagnosis

_KERNELS = (".nbi", ".nbc")


def compile_cache() -> Diagnosis:
    """Whether compiled kernels can be cached, and how many are."""
    folders = kernel_folders()
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    count = sum(path.suffix == ".nbi" for path in kernels())
    if not os.access(folders[0], os.W_OK):
        advice = "set NUMBA_CACHE_DIR to a folder that can be written, or every start compiles for some 20 s"
        return Diagnosis("compile cache", "lack", f"'{folders[0]}' can't be written", advice)
    if not count:
        found = "empty: the first start compiles for some 20 s"
        return Diagnosis("compile cache", "note", found, "itouch-py demo fills it")
    where = "NUMBA_CACHE_DIR" if chosen else f"'{folders[0]}'"
    return Diagnosis("compile cache", "ok", f"{count} kernels in {where}")


def kept_results() -> Diagnosis:
    """Describe the cached results of compiling scenes: start temperatures, modal bases."""
    from itouch.plugin import result_cache

    kept = _sum(caches.entries(result_cache.folder(), result_cache.SUFFIX), "result")
    return _kept("kept results", kept, result_cache.folder(), result_cache.SWITCH, "every start finds them again")


def kept_meshes() -> Diagnosis:
    """Describe the cached surfaces of mesh files, each with its hierarchy."""
    from itouch.contact.meshfile import cache as meshes

    kept = _sum(caches.entries(meshes.folder(), ".mesh"), "mesh")
    return _kept("kept meshes", kept, meshes.folder(), meshes.SWITCH, "every start builds them again")


def _kept(name: str, kept: str, place: Path | None, switch: str, otherwise: str) -> Diagnosis:
    if place is None:
        why = f"switched off by {switch}" if os.environ.get(switch) else "nothing is kept: this user has no home folder"
        return Diagnosis(name, "note", why, f"{otherwise}; name a folder by {switch}")
    lack, mend = _lack(place)
    if lack:
        return Diagnosis(name, "lack", f"nothing is kept: {lack}", f"{mend}, or name another folder by {switch}")
    return Diagnosis(name, "ok", f"{kept} in '{place}'")


def _lack(place: Path) -> tuple[str, str]:
    """Return why nothing can be kept in a folder, and what to do about it; two empty words if it can."""
    if os.path.lexists(place):
        if not place.is_dir():
            return f"'{place}' is not a folder", "remove it"
        if not caches.owned(place):
            return f"'{place}' is not this user's alone", "make it yours alone (chmod 700)"
        return ("", "") if os.access(place, os.W_OK | os.X_OK) else (f"'{place}' can't be written", "chmod 700 it")
    there = next(above for above in place.absolute().parents if os.path.lexists(above))
    if not there.is_dir():
        return f"'{place}' can't be made, as '{there}' is not a folder", f"make '{there}' a folder"
    if not os.access(there, os.W_OK | os.X_OK):
        return f"'{place}' can't be made, as '{there}' can't be written", f"make '{there}' writable"
    return "", ""


def clear_kept() -> str:
    """Remove all that is cached, and return a sentence that says what it was."""
    from itouch.contact.meshfile import cache as meshes
    from itouch.plugin import result_cache

    results, built = caches.clear(result_cache.folder(), result_cache.SUFFIX), caches.clear(meshes.folder(), ".mesh")
    caches.clear(compiling.folder(), ".part")  # what writers that were killed have left
    compiled = 0
    for path in kernels():
        with contextlib.suppress(OSError):
            path.unlink()
            compiled += path.suffix == ".nbi"
    return f"removed {compiled} compiled kernels, {results} results and {built} meshes; the next start makes them again"


def kernels() -> list[Path]:
    """Return the files of compiled kernels."""
    paths = (path for folder in kernel_folders() for path in folder.rglob("*.nb[ic]"))
    return sorted(path for path in paths if path.suffix in _KERNELS)


def kernel_folders() -> list[Path]:
    """Return the folders of compiled kernels: ``NUMBA_CACHE_DIR`` alone, or the user's first, then the packages'."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return [Path(chosen)]
    shared = compiling.folder()
    first = [shared] if shared is not None and caches.owned(shared) else []
    places = [spec.submodule_search_locations for name in _packages() if (spec := find_spec(name)) is not None]
    return first + [Path(place) for found in places for place in found or ()]


def _packages() -> list[str]:
    from itouch.plugin.discovery import BENCHES, COMMANDS, DEVICES, MODALITIES, find

    groups = (DEVICES, MODALITIES, COMMANDS, BENCHES)
    named = {
        found.entry.value.partition(".")[0].partition(":")[0] for group in groups for found in find(group).values()
    }
    return ["itouch", *sorted(named | {"itouch_tools"})]


def _sum(entries: Iterable[tuple[float, int, Path]], word: str) -> str:
    sizes = [size for _, size, _ in entries]
    plural = "" if len(sizes) == 1 else "es" if word == "mesh" else "s"
    return f"{len(sizes)} {word}{plural} ({sum(sizes) / 1e6:.1f} MB)"
