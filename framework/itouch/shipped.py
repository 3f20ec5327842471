"""Kernels shipped with the program: whether they fit this machine, and whether each file is the one that was shipped.

They are in the package's folder ``compiled``.  ``.ci/compile_kernels.py`` makes them, for a processor level that most
machines have, so that a first start is as quick as later ones.  If others can write to the folder, if a file's digest
differs from the manifest's, or if Python, Numba or the processor does not fit, kernels are compiled here instead.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from functools import cache
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "compiled"
MANIFEST = "manifest.json"
#: Environment variable that is set while kernels are compiled for shipping: the folder to write them to.
MAKING = "ITOUCH_SHIP_KERNELS"
#: Features that x86-64-v3 needs of a processor: the name in /proc/cpuinfo -> the name in LLVM.
NAMES = {
    "avx": "avx", "avx2": "avx2", "bmi1": "bmi", "bmi2": "bmi2", "f16c": "f16c", "fma": "fma", "abm": "lzcnt",
    "movbe": "movbe", "xsave": "xsave",
}  # fmt: skip
V3 = frozenset(NAMES)
BASELINE = "x86-64-v3"
#: Features that the processor itself reports as missing though the system lists them.
_lacking: frozenset[str] = frozenset()


def choose_processor() -> None:
    """Let Numba compile for the processor level of the shipped kernels, if they fit; call before importing Numba."""
    if fits() and "NUMBA_CPU_NAME" not in os.environ and "NUMBA_CPU_FEATURES" not in os.environ:
        os.environ["NUMBA_CPU_NAME"], os.environ["NUMBA_CPU_FEATURES"] = BASELINE, ""


def confirm_processor() -> None:
    """Ask the processor itself too, and undo the choice if it lacks a feature; call before kernels are compiled.

    Under emulation, /proc/cpuinfo may describe the host machine.  LLVM asks the processor, but is slow to load; where
    kernels are compiled it is needed anyway.
    """
    if not fits() or not (lacks := V3 - asked_flags()):
        return
    global _lacking
    _lacking = lacks
    fits.cache_clear()
    why_not.cache_clear()
    if os.environ.get("NUMBA_CPU_NAME") == BASELINE:
        for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):  # a user may have set the first alone
            os.environ.pop(name, None)
    if "numba" in sys.modules:  # a plugin may have imported it already
        sys.modules["numba"].config.reload_config()


@cache
def fits() -> bool:
    """Tell whether there are shipped kernels that may be used here."""
    return not why_not() if (FOLDER / MANIFEST).exists() else False


@cache
def why_not() -> str:
    """Return why shipped kernels cannot be used here (there may be none), or an empty string if they can."""
    try:
        manifest = _manifest()
        status = FOLDER.stat()
        here = made_with()
    except (OSError, ValueError) as error:
        return f"there are none ({type(error).__name__})"
    differs = [
        f"{name} {manifest.get(name)!r}, not {value!r}" for name, value in here.items() if manifest.get(name) != value
    ]
    if differs:
        return f"they were made with {'; '.join(differs)}"
    if sys.platform != "win32" and (status.st_uid not in (0, os.geteuid()) or status.st_mode & 0o022):
        return f"others can write '{FOLDER}'"
    lacks = sorted(_lacking or V3 - processor_flags())
    return f"this processor has no {', '.join(lacks)}" if lacks else ""


def left_out() -> str:
    """Return a sentence that says why kernels that came with the program are not used; "" if they are, or none came."""
    why = why_not() if (FOLDER / MANIFEST).exists() else ""
    return f"the compiled kernels that came with the program are not used: {why}" if why else ""


def made_with() -> dict[str, str]:
    """Return what shipped kernels depend on besides the processor level and what their cache keys contain."""
    from importlib.metadata import version

    flags = getattr(sys, "abiflags", "")  # without the lock of the interpreter, its objects have another layout
    python = f"{sys.implementation.name} {sys.version_info[0]}.{sys.version_info[1]}{flags}"
    versions = {name: version(name) for name in ("numba", "llvmlite", "numpy")}
    return {"python": python, "machine": platform.machine(), "system": platform.system(), **versions}


def processor_flags() -> frozenset[str]:
    """Return the processor's features as listed in /proc/cpuinfo; an empty set where there is no such file."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return frozenset()
    return next((frozenset(line.split(":")[1].split()) for line in text.splitlines() if line.startswith("flags")),
                frozenset())  # fmt: skip


def asked_flags() -> frozenset[str]:
    """Return which of the needed features the processor itself reports (through LLVM), by their /proc/cpuinfo names."""
    from llvmlite.binding import get_host_cpu_features

    try:
        found = get_host_cpu_features()
    except RuntimeError:  # LLVM does not know it
        return frozenset()
    return frozenset(name for name, of_llvm in NAMES.items() if found.get(of_llvm))


def sound(path: Path) -> bool:
    """Tell whether a shipped file has the digest that the manifest lists."""
    try:
        known = _manifest()["files"].get(path.relative_to(FOLDER).as_posix())
        return known is not None and hashlib.sha256(path.read_bytes()).hexdigest() == known
    except (OSError, ValueError, KeyError, AttributeError):
        return False


@cache
def _manifest() -> dict[str, Any]:
    content = json.loads((FOLDER / MANIFEST).read_text(encoding="utf-8"))
    if not isinstance(content, dict) or not isinstance(content.get("files"), dict):
        raise ValueError("not a manifest")
    return content


def write_manifest(folder: Path) -> int:
    """Write the manifest of the kernels that were compiled into a folder; return how many kernels there are."""
    paths = sorted(path for path in folder.rglob("*") if path.suffix in (".nbi", ".nbc"))
    files = {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in paths}
    content = {**made_with(), "processor": BASELINE, "files": files}
    (folder / MANIFEST).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return sum(name.endswith(".nbc") for name in files)
