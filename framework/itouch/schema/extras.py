"""Packages that only some commands need: checked before work begins; the error gives the line that installs them."""

from __future__ import annotations

from importlib.util import find_spec

from itouch.schema.diagnostics import ItouchError

#: Name of an extra -> what it is for, and the modules that it installs.
EXTRAS: dict[str, tuple[str, tuple[str, ...]]] = {
    "report": ("pages", ("jinja2",)),
    "film": ("films", ("av", "PIL")),
    "tables": ("tables of this kind", ("pyarrow",)),
    "plot": ("figures", ("matplotlib",)),
    "bench": ("this", ("scipy",)),
    "study": ("studies", ("scipy", "SweetSpot", "statsmodels")),
    "rerun": ("Rerun", ("rerun",)),
    "web": ("browsers", ("viser",)),
    "ros": ("bags of ROS", ("rosbags",)),
    "ros2": ("ROS 2", ("zenoh_ros2_sdk", "rosbags")),
    "test": ("the conformance suite", ("pytest",)),
    "lsl": ("Lab Streaming Layer", ("pylsl",)),
}


def need(extra: str, what: str = "") -> None:
    """Make sure that the packages of an extra are installed; nothing is imported.

    Parameters
    ----------
    extra
        Its name in ``pip install 'itouch-py[NAME]'``.
    what
        What needs it, for the message; default: what the extra is for.

    Raises
    ------
    ItouchError
        If packages are missing; names them, and the line that installs them.
    """
    usual, modules = EXTRAS[extra]
    missing = [name for name in modules if not _there(name)]
    if missing:
        lack = "a package is missing" if len(missing) == 1 else "packages are missing"
        raise ItouchError(f"{what or usual}: {lack} ({', '.join(missing)})\n  = help: pip install 'itouch-py[{extra}]'")


def _there(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except (ImportError, ValueError):  # blocked, or half installed
        return False
