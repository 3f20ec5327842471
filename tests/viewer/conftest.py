"""A virtual screen for windows."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator

import pytest
from requirements import need_program


@pytest.fixture(scope="session")
def screen() -> Iterator[dict[str, str]]:
    """Yield an environment whose display is a virtual screen."""
    xvfb = need_program("Xvfb", package="xvfb")
    read, write = os.pipe()
    server = subprocess.Popen(
        [xvfb, "-displayfd", str(write), "-screen", "0", "1280x800x24", "-nolisten", "tcp"],
        pass_fds=[write], stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(write)
    with os.fdopen(read) as number:
        display = number.readline().strip()
    yield os.environ | {"DISPLAY": f":{display}"}
    server.terminate()
    server.wait()
