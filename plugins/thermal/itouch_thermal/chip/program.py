"""The reference display's firmware and the simulated chip, compiled from the sources that come with this package."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from itouch.plugin import DeviceError

#: Programs needed to compile, and the Debian packages that contain them and the simulator.
TOOLS = ("make", "cc", "avr-gcc", "avr-size")
PACKAGES = "make gcc gcc-avr avr-libc arduino-core-avr libsimavr-dev libelf-dev"
_HEADERS = ("/usr/include/simavr/sim_avr.h", "/usr/include/libelf.h")
_DEFINE = re.compile(r"^#define (\w+) (-?[\d.e+]+)[fUL]*(?: .*)?$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Built:
    """The compiled files: the firmware, the simulated chip, and the flash and RAM that the firmware takes [bytes]."""

    program: Path
    chip: Path
    flash: int
    ram: int


def sources() -> Path:
    """Return the folder of the sources, in a checkout or in the installed package."""
    package = Path(__file__).parents[1]
    places = (package / "firmware", package.parent / "firmware")
    return next(place for place in places if (place / "Makefile").exists())


def missing() -> list[str]:
    """Return the tools and headers that are missing."""
    tools = [tool for tool in TOOLS if shutil.which(tool) is None]
    return tools + [header for header in _HEADERS if not Path(header).exists()]


@cache
def config(changes: str = "") -> Mapping[str, float]:
    """Return the constants of ``config.h`` by name, with changes such as ``NTC_LAG_S=0.3,SINK_HOT_C=50``."""
    text = (sources() / "itouch_display" / "config.h").read_text(encoding="utf-8")
    found = {name: float(value) for name, value in _DEFINE.findall(text)}
    for change in filter(None, changes.split(",")):
        name, _, value = change.partition("=")
        if name not in found:
            raise ValueError(f"config.h has no number '{name}'")
        found[name] = float(value)
    return found


def built(*, arduino: bool = False) -> Built:
    """Return the compiled firmware and chip; compiled once for these sources and stored in the user's cache.

    Raises
    ------
    DeviceError
        If a tool is missing (the message says what to install) or the sources do not compile.
    """
    lacking = missing()
    if lacking:
        raise DeviceError(f"the simulated chip needs {', '.join(lacking)}: apt-get install {PACKAGES}")
    folder = _cache() / _digest()
    name = "arduino" if arduino else "display"
    program, chip = folder / f"{name}.elf", folder / "chip.so"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "lock").open("w") as lock:
            import fcntl  # the compiler and the simulator are for systems that have it

            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (program.exists() and chip.exists()):
                _make(folder, "arduino" if arduino else "all", "chip")
    except OSError as error:
        raise DeviceError(f"{error.filename}: {error.strerror}: the simulated chip is compiled there") from error
    return Built(program, chip, *_sizes(program))


def _make(folder: Path, *targets: str) -> None:
    made = subprocess.run(
        ["make", "-s", "-C", str(sources()), f"OUT={folder}", *targets], capture_output=True, text=True, check=False
    )
    if made.returncode:
        raise DeviceError(f"the display's program does not compile:\n{made.stderr.strip()}")


def _sizes(program: Path) -> tuple[int, int]:
    """Return the bytes of flash and of RAM that a program takes."""
    lines = subprocess.run(["avr-size", str(program)], capture_output=True, text=True, check=True).stdout.splitlines()
    text, data, zeroed = (int(word) for word in lines[1].split()[:3])
    return text + data, data + zeroed


def _digest() -> str:
    digest = hashlib.sha256(sys.platform.encode())
    for path in sorted(path for path in sources().rglob("*") if path.is_file()):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:24]


def _cache() -> Path:
    given = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(given) if os.path.isabs(given) else Path("~/.cache").expanduser()
    usable = root.is_absolute() and os.access(root if root.exists() else root.parent, os.W_OK)
    return (root if usable else Path(tempfile.gettempdir())) / "itouch-py" / "firmware"
