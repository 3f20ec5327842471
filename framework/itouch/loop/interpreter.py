"""What code in this process may have done to Python itself, for everybody: seen, put back, told by name.

The safe sequence is Python.  A plugin that has put something else in the place of ``len`` would stop it in its middle;
so before it is carried out, all is put back as it was when this module was loaded, which is before any plugin is.
"""

from __future__ import annotations

import builtins
import sys
from operator import itemgetter
from typing import Any

#: What programs replace by something that does the same and more, as a notebook does: that harms nobody.
_WRAPPED = frozenset(
    ("print", "open", "input", "help", "exit", "quit", "copyright", "credits", "license", "breakpoint", "__import__")
)
_THERE: dict[str, Any] = vars(builtins)
_OWN = {name: value for name, value in _THERE.items() if name not in _WRAPPED and not name.startswith("_")}
_OWN["__build_class__"] = _THERE["__build_class__"]
_WRAPS = {name: _THERE[name] for name in _WRAPPED if name in _THERE}
_taken, _MISSING, _callable = itemgetter(*_OWN), KeyError, callable
_FUNCTIONS = _taken(_THERE)
#: Any error, where even the name of that may be gone.
ANY_ERROR = BaseException
_DEEP = sys.getrecursionlimit()


def changed() -> bool:
    """Tell whether something else stands in the place of one of Python's own functions."""
    try:
        return bool(_taken(_THERE) != _FUNCTIONS)
    except _MISSING:
        return True


def put_back() -> tuple[str, ...]:
    """Put Python's own functions back, and a limit of recursion that was lowered; return the names of what was not so.

    Until that is done nothing here uses one of them.
    """
    was = _THERE.copy()
    _THERE.update(_OWN)
    for name in _WRAPS:
        if not _callable(was.get(name)):
            _THERE[name] = _WRAPS[name]
    found = [name for name, value in (_OWN | _WRAPS).items() if was.get(name) is not _THERE[name]]
    if sys.getrecursionlimit() < _DEEP:
        sys.setrecursionlimit(_DEEP)
        found.append("sys.setrecursionlimit")
    return tuple(found)


def blamed(names: tuple[str, ...]) -> str:
    """Return what is to be said of things that were put back; empty: nothing was."""
    if not names:
        return ""
    listed = ", ".join(f"'{name}'" for name in names[:3])
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"a plugin had replaced {listed}{more} of Python for the whole program; that was put back"


class LoadedModules:
    """The modules that are loaded now: what a plugin takes away of them, somebody may need at the end of a session."""

    def __init__(self) -> None:
        self._modules = sys.modules.copy()

    def put_back(self) -> None:
        """Put those back that are missing, or that something else stands for."""
        sys.modules.update(self._modules)
