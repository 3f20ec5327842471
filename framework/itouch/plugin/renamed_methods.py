"""Methods that have another name now: for one version, each class has them under both names."""

from __future__ import annotations

import warnings
from typing import Any


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
