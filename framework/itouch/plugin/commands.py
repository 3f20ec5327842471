"""Access to the whole framework for a plugin's command or bench, as the framework is a layer above the plugins.

A device or a modality must not use it: it is itself run by the framework.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


def framework() -> Any:
    """Return the module ``itouch``, whose functions load and build scenes, as in a user's script.

    It is imported here and no earlier, because the framework imports a plugin's module before it is complete itself.
    """
    return import_module("itouch")
