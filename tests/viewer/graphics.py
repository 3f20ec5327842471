"""Whether this machine can draw; continuous integration must be able to, and fails where it can't."""

from __future__ import annotations

import functools
import os
import subprocess
import sys

from requirements import missing

_PROBE = "from itouch_tools.viewer.offscreen import open_context; open_context(64, 64).close()"


@functools.cache
def _reason() -> str:
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True, env=environment)
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def need_graphics() -> None:
    """Skip where there is no OpenGL; where ``CI`` is set that is a failure."""
    if _reason():
        missing(f"no OpenGL: {_reason()}")
