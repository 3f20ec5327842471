"""What a command or a bench of a plugin needs of the whole framework, which stands above the plugins.

A device or a modality must not reach for it: it is run by what stands here.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


def framework() -> Any:
    """Return what users write ``import itouch`` for: its functions load and build scenes, as in a script of theirs.

    It is loaded when it is asked for: a plugin's module is read by the framework itself, before all of that is there.
    """
    return import_module("itouch")
