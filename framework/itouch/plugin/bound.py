"""A compiled function bound to its arguments (`Bound`), with which a plugin's step joins the compiled tick.

`bound_once` keeps the calls of a modality for Python, which would else bind them anew in every tick.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from itouch.plugin.record import Record
from itouch.schema.plugin_errors import ReturnedError


def _rows(value: Any) -> Any:
    """Return an argument with each scalar of State as an array of one number, also inside tuples."""
    if isinstance(value, np.ndarray):
        return value.reshape(1) if value.ndim == 0 else value
    if isinstance(value, tuple):
        inner = [_rows(item) for item in value]
        kind: Any = type(value)
        return kind._make(inner) if hasattr(kind, "_fields") else tuple(inner)
    return value


def _copied(value: Any) -> Any:
    """Return an argument whose arrays are copies."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, tuple):
        inner = [_copied(item) for item in value]
        kind: Any = type(value)
        return kind._make(inner) if hasattr(kind, "_fields") else tuple(inner)
    return value


class Bound:
    """A compiled function with arguments that stay the same: views of State, constants, numbers.

    From Python it is an ordinary call; the loop can also run several of them, one after the other, as a single call.

    Parameters
    ----------
    function
        Compiled by ``itouch.plugin.kernels.kernel``; returns 0, or a number from 1 to 2**32 - 1 to hand over to Python.
    arguments
        Contiguous arrays (a scalar of State is an array of one number), named tuples of arrays, and numbers.  Whatever
        changes must be in an array.
    """

    __slots__ = ("_joined", "arguments", "function")

    def __init__(self, function: Callable[..., int], *arguments: Any) -> None:
        self.function = function
        self.arguments = tuple([_rows(value) for value in arguments])
        self._joined: Callable[[], int] | None = None

    def __call__(self) -> int:
        """Call the function from Python in its joined form, so that no other form of it has to be compiled.

        The first call of a `Bound` costs more than the later ones; see `join`.
        """
        return (self._joined or self.join())()

    run = __call__

    def join(self) -> Callable[[], int]:
        """Make the joined form, which the first call would else do, and return what calls it."""
        if self._joined is None:
            from itouch.joining import caller

            self._joined = caller(self)
        return self._joined

    def warm_up(self) -> None:
        """Call the function on copies, so that it is compiled before the first tick."""
        Bound(self.function, *(_copied(value) for value in self.arguments))()


def bound_by(
    method: Callable[..., Any], *arguments: Any, several: bool = False, joins: bool = True
) -> tuple[Bound, ...]:
    """Return the compiled calls that a plugin's ``method`` offers for these arguments; none: it is Python.

    ``joins``: they will be joined, and not called from Python.

    Raises
    ------
    ReturnedError
        If it returns anything else than a `Bound`, or, where ``several`` may come, a tuple of them, or None; or if one
        of them cannot be joined.
    """
    told = method(*arguments)
    if told is None:
        return ()
    calls = told if several and isinstance(told, tuple | list) else (told,)
    if not all(isinstance(call, Bound) for call in calls):
        wanted = "a Bound, a tuple of them" if several else "a Bound"
        raise ReturnedError(method, f"it returned {told!r:.120}; {wanted} or None is wanted")
    from itouch.joining import prepare  # the compiler is loaded when calls are offered, not with every plugin

    for call in calls if joins else ():
        try:
            prepare(call)
        except ValueError as error:
            raise ReturnedError(method, f"its call cannot be joined: {error}") from error
    return tuple(calls)


#: The calls that `bound_once` has bound, by method, its object, model, State and period; these live as long as State.
_once: dict[tuple[Any, ...], tuple[tuple[Bound, ...], Any, Any]] = {}


def bound_once(method: Callable[..., Any], model: Any, state: Record, period: float) -> tuple[Bound, ...]:
    """Return the compiled calls of a modality's ``bound_update``, bound when they are first asked for.

    Binding a call takes longer than running it: an ``update`` that runs the calls of ``bound_update`` takes them from
    here, so that a subclass may call ``super().update`` in every tick.  ``period`` is in [s].  None are there if the
    method offers none; it is asked again then.

    Raises
    ------
    ReturnedError
        As of `bound_by`.
    """
    owner: Any = getattr(method, "__self__", None)
    key = (getattr(method, "__func__", method), id(owner), id(model), id(state), period)
    found = _once.get(key)
    if found is None:
        found = bound_by(method, model, state, period, several=True, joins=False), owner, model
        if found[0]:
            _once[key] = found
            weakref.finalize(state, _once.pop, key, None).atexit = False
    return found[0]
