"""Looking at what a person sees and hears: display, OpenGL, sound."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from itouch_tools.cli.doctor.finding import Finding

#: Asks for OpenGL in a process of its own: a broken driver may take its process with it.
_ASK = """
from itouch_tools.viewer import offscreen
offscreen.open_context(64, 64)
from pyglet.gl import gl_info
print(gl_info.get_renderer(), "|", gl_info.get_version_string())
"""
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")


def display() -> Finding:
    """Whether a window can be shown."""
    wayland, x11 = os.environ.get("WAYLAND_DISPLAY"), os.environ.get("DISPLAY")
    if wayland or x11:
        return Finding("display", "ok", f"WAYLAND_DISPLAY={wayland}" if wayland and not x11 else f"DISPLAY={x11}")
    advice = "log in on the machine's screen, or use ssh -X; without one, --screenshot and --film still draw"
    return Finding("display", "lack", "none: sessions run without a window", advice)


def graphics() -> Finding:
    """Which OpenGL draws."""
    words = [sys.executable, "-P", "-c", _ASK]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
    except subprocess.TimeoutExpired:
        return Finding("graphics", "lack", "OpenGL does not answer", "update the graphics driver")
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no OpenGL 3.3"])[-1]
        return Finding(
            "graphics", "lack", said, "install a driver with OpenGL 3.3, for example libgl1-mesa-dri, libegl1"
        )
    found = done.stdout.strip()
    if any(word in found.lower() for word in _SOFTWARE):
        return Finding("graphics", "note", f"{found}: drawn by the processor", "the loop needs priority beside it")
    return Finding("graphics", "ok", found)


def sound() -> Finding:
    """Whether something can be heard."""
    cards = Path("/proc/asound/cards")
    listed = [line for line in cards.read_text().splitlines() if "[" in line] if cards.exists() else []
    runtime = Path(os.environ.get("XDG_RUNTIME_DIR", "/nonexistent"))
    servers = [name for name in ("pipewire-0", "pulse/native") if (runtime / name).exists()]
    if listed or servers:
        found = ", ".join([f"{len(listed)} cards"] * bool(listed) + servers)
        return Finding("sound", "ok", found)
    return Finding("sound", "lack", "no card and no sound server", "sessions run silently; plug in a headset or a card")
