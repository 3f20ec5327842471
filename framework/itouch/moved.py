"""Old names, kept for one version: importing a module that has moved warns, and passes on to the new one.

Listed are only names that the documentation, a shipped scene or an entry point told users to import.  Members of
classes that have another name now have both for as long (`HasOldNames`, `with_old_fields`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import FunctionType, ModuleType
from typing import Any, ClassVar, TypeVar, cast

T = TypeVar("T")

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
    """Let the two names of a member mean the same in a new class; return who overrides it by the old name.

    A class overrides a member under one name, and the class below it may be written with the other: a call of
    ``super()`` must reach the parent's own method in either case.  So each class gets the name that it lacks, and that
    name never leads to a class further down.

    Parameters
    ----------
    cls
        The class that is being made; its bases have been here before.
    old, new
        The member's names.

    Returns
    -------
    str
        The name of the class that has it by its old name only; empty: there is nothing to tell.
    """
    by_new = next(kind for kind in cls.__mro__ if new in vars(kind))
    mine = (kind for kind in cls.__mro__ if not isinstance(vars(kind).get(old, _PASSED_ON), OldName))
    by_old = next(mine, None)  # whoever has only passed on the new name has not defined the old one
    if by_old is by_new:  # inherited with both names, or written for both versions
        return ""
    if by_old is not None and cls.__mro__.index(by_old) < cls.__mro__.index(by_new):
        member = vars(by_old)[old]
        setattr(cls, new, member)
        if not isinstance(member, _METHODS):  # what an instance sets under one name, it must read under the other
            setattr(cls, old, OldName(cls, old, new))
        return by_old.__name__
    setattr(cls, old, OldName(by_new, old, new))
    return ""


class HasOldNames:
    """Base of classes from which plugins derive, and whose members had other names in the version before.

    Whoever overrides, calls, reads or sets a member by its old name does so with the member of the new name.
    """

    #: Old name -> new name, of the members that a class defines itself.
    _OLD_NAMES: ClassVar[Mapping[str, str]] = {}

    #: What it declares in an outdated way, one sentence each.
    deprecations: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        for old, new in vars(cls).get("_OLD_NAMES", {}).items():
            setattr(cls, old, OldName(cls, old, new))
        told = [
            f"'{old}' of {older} is '{new}' now: rename it"
            for kind in cls.__mro__[1:]
            for old, new in vars(kind).get("_OLD_NAMES", {}).items()
            if (older := have_both_names(cls, old, new))
        ]
        cls.deprecations = (*cls.deprecations, *told)


def with_old_fields(**names: str) -> Callable[[type[T]], type[T]]:
    """Return the decorator of a class of named values, each ``old="new"`` of which is understood under both names.

    Old names are accepted as keywords of the constructor, and as attributes; each use warns.
    """

    def decorated(cls: type[T]) -> type[T]:
        for which in ("__new__", "_replace") if issubclass(cls, tuple) else ("__init__",):
            setattr(cls, which, _understanding(getattr(cls, which), cls.__name__, names))
        for old, new in names.items():
            setattr(cls, old, OldName(cls, old, new))
        return cls

    return decorated


def _understanding(function: Callable[..., Any], owner: str, names: Mapping[str, str]) -> Callable[..., Any]:
    """Return a function that also takes its keywords by their old names."""

    @wraps(function)
    def called(*given: Any, **named: Any) -> Any:
        for old in names.keys() & named.keys():
            said = f"{owner}: '{old}' is '{names[old]}' now: write that"
            warnings.warn(said, DeprecationWarning, stacklevel=2)
            named[names[old]] = named.pop(old)
        return function(*given, **named)

    return called


class OldName:
    """A member under its old name: each use warns, and is one of the member that has the new name."""

    def __init__(self, owner: type, old: str, new: str) -> None:
        self._owner, self._old, self._new = owner, old, new

    def __get__(self, instance: Any, kind: type) -> Any:
        member = vars(self._owner).get(self._new)
        if not isinstance(member, _METHODS):  # a value, which a class further down, or an instance, may have set
            self._warn("use", stacklevel=3)
            return getattr(kind if instance is None else instance, self._new)
        method = member.__get__(instance, kind)

        def called(*given: Any, **named: Any) -> Any:
            self._warn("call", stacklevel=3)
            return method(*given, **named)

        return called

    def __set__(self, instance: Any, value: Any) -> None:
        self._warn("set", stacklevel=3)
        setattr(instance, self._new, value)

    def _warn(self, what: str, *, stacklevel: int) -> None:
        said = f"'{self._old}' is '{self._new}' now: {what} that"
        warnings.warn(said, DeprecationWarning, stacklevel=stacklevel)


#: Stands for an old name that a class does not have.
_PASSED_ON = OldName(object, "", "")
#: What is called on an instance or a class; everything else that a class has is a value.
_METHODS = (FunctionType, classmethod, staticmethod)

# Found by the framework for each class, never declared by a plugin: there is nothing but reading it.
setattr(HasOldNames, "outdated", OldName(HasOldNames, "outdated", "deprecations"))  # noqa: B010
