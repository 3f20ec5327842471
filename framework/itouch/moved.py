"""Old names, kept for one version: importing a module that has moved warns, and passes on to the new one.

Listed are only names that the documentation, a shipped scene or an entry point told users to import.  Methods that have
another name now have both for as long (``have_both_names``).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, cast

#: Old name -> new name, also for submodules.  They are strings, imported only when a user imports an old name: the core
#: itself imports nothing from the tools or the evidence.
PLACES = {
    "itouch.bench": "itouch_evidence",
    "itouch.report": "itouch_tools.report",
    "itouch.study": "itouch_tools.study",
    "itouch.sweeps": "itouch_tools.sweeps",
    "itouch_thermal.identify.command": "itouch_thermal.identify.estimate",
}


def renamed(module: str, name: str, names: Mapping[str, str]) -> str:
    """Return the new name of what a module does not have, and warn: the ``__getattr__`` of a module asks for it.

    Parameters
    ----------
    module, name
        The module that is asked, and for what.
    names
        Its old names and their new ones.

    Raises
    ------
    AttributeError
        If it never had that name.
    """
    if name not in names:
        raise AttributeError(f"module '{module}' has no attribute '{name}'")
    said = f"'{module}.{name}' is '{names[name]}' now: import that"
    warnings.warn(said, DeprecationWarning, stacklevel=3)
    return names[name]


class _Alias:
    """Loader of a module that passes on what another one has."""

    def __init__(self, to: str) -> None:
        self._to = to

    def create_module(self, spec: ModuleSpec) -> None:
        """Leave making the module to Python."""

    def exec_module(self, module: ModuleType) -> None:
        """Pass on the other module's attributes; warn if this is the module that was moved, not a submodule of it."""
        if module.__name__ in PLACES:
            said = f"'{module.__name__}' is '{self._to}' now: import from there"
            warnings.warn(said, DeprecationWarning, stacklevel=2)
        real = import_module(self._to)
        module.__doc__ = real.__doc__
        module.__dict__["__getattr__"] = lambda name: getattr(real, name)


class _Moved:
    """Finder of old names; last in ``sys.meta_path``, so it is asked only for modules that no other finder knows."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Return the spec for loading an old name; None for any other name."""
        old = next((old for old in PLACES if name == old or name.startswith(f"{old}.")), None)
        if old is None:
            return None
        alias = _Alias(PLACES[old] + name.removeprefix(old))
        # Python's own base class of loaders is slow to import
        return ModuleSpec(name, cast(Any, alias), is_package=True)


MOVED = _Moved()


def have_both_names(cls: type, old: str, new: str) -> str:
    """Let the two names of a method mean the same in a new class; return who overrides it by the old name.

    A class overrides a method under one name, and the class below it may be written with the other: a call of
    ``super()`` must reach the parent's own method in either case.  So each class gets the name that it lacks, and that
    name never leads to a class further down.

    Parameters
    ----------
    cls
        The class that is being made; its bases have been here before.
    old, new
        The method's names.

    Returns
    -------
    str
        The name of the class that has it by its old name only; empty: there is nothing to tell.
    """
    by_old, by_new = (next(kind for kind in cls.__mro__ if name in vars(kind)) for name in (old, new))
    if by_old is by_new:  # inherited with both names, or written for both versions
        return ""
    if cls.__mro__.index(by_old) < cls.__mro__.index(by_new):
        setattr(cls, new, vars(by_old)[old])
        return by_old.__name__
    setattr(cls, old, _OldName(by_new, old, new))
    return ""


class _OldName:
    """A method under its old name: a call of it warns, and is one of the method that a class has by the new name."""

    def __init__(self, owner: type, old: str, new: str) -> None:
        self._owner, self._old, self._new = owner, old, new

    def __get__(self, instance: Any, kind: type) -> Any:
        method = vars(self._owner)[self._new].__get__(instance, kind)

        def called(*given: Any, **named: Any) -> Any:
            warnings.warn(f"'{self._old}' is '{self._new}' now: call that", DeprecationWarning, stacklevel=2)
            return method(*given, **named)

        return called
