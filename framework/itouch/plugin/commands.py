"""What a plugin's command or bench needs: the whole framework, a layer above the plugins, and one way to judge figures.

A device or a modality must not use it: it is itself run by the framework.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any


def framework() -> Any:
    """Return the module ``itouch``, whose functions load and build scenes, as in a user's script.

    It is imported here and no earlier, because the framework imports a plugin's module before it is complete itself.
    """
    return import_module("itouch")


def judged(holds: bool | None) -> str:
    """Return the word beside a figure that keeps its bound, or does not; of one without a bound nothing."""
    return "" if holds is None else "ok" if holds else "MISSED"


def exit_code(verdicts: Iterable[bool | None]) -> int:
    """Return the exit code of a command that judges figures: 1 if one of them misses its bound, else 0.

    Parameters
    ----------
    verdicts
        Of each figure, whether it keeps its bound; None: it has none.
    """
    return int(any(holds is not None and not holds for holds in verdicts))
