"""Runs the same plugin in another interpreter: with another hash seed, and without anything left over in this one."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

from itouch.scene import loads, write
from itouch.testing.checks import NotApplicableError
from itouch.testing.harness import DeviceHarness

_SCRIPT = """
import sys
sys.path[:0] = {path!r}
import importlib
from itouch.testing import reproducibility
cls = importlib.import_module({module!r})
for part in {qualname!r}.split("."):
    cls = getattr(cls, part)
module, _, function = {work!r}.rpartition(":")
print(getattr(importlib.import_module(module), function)(reproducibility.rebuilt(cls, {name!r}, {scene!r}), *{words!r}))
"""


def script(harness: DeviceHarness, work: str, *words: str) -> list[str]:
    """Return the command that calls ``work`` (module:function) with the same harness in another interpreter.

    Raises
    ------
    NotApplicableError
        If the class cannot be imported there.
    """
    cls = harness.cls
    module = sys.modules.get(cls.__module__)
    found: Any = module
    for part in cls.__qualname__.split("."):
        found = getattr(found, part, None)
    if found is not cls or cls.__module__ == "__main__" or not getattr(module, "__file__", None):
        raise NotApplicableError("the class is not in a module that another process can import")
    text = _SCRIPT.format(
        path=sys.path, module=cls.__module__, qualname=cls.__qualname__, work=work, name=harness.name,
        scene=write(harness.scene()), words=words,
    )  # fmt: skip
    return [sys.executable, "-c", text]


def rebuilt(cls: type, name: str, scene: str) -> DeviceHarness:
    """Return the harness with the parameters in a scene."""
    catalog = DeviceHarness(cls, name, object()).catalog
    device = loads(scene.encode(), catalog).devices[0]
    return DeviceHarness(cls, name, device.parts[0].params if device.parts else None)


def said(command: list[str], *, seed: str | None = None, seconds: float = 60.0) -> str:
    """Run a command for at most ``seconds`` [s], with a hash seed if given; return the last line that it writes.

    Raises
    ------
    NotApplicableError
        If it fails.
    """
    environment = os.environ | ({"PYTHONHASHSEED": seed} if seed else {})
    done = subprocess.run(command, capture_output=True, text=True, timeout=seconds, env=environment)
    if done.returncode:
        told = done.stderr.strip().splitlines()
        raise NotApplicableError(f"it can't be run in another process: {told[-1] if told else done.returncode}")
    return done.stdout.strip().splitlines()[-1] if done.stdout.strip() else ""


def other_seed() -> str:
    """Return a hash seed that differs from the one in force here."""
    return "54321" if os.environ.get("PYTHONHASHSEED") == "12345" else "12345"
