"""Arrays without reference counting, for the inside of one compiled call.

Every array that a compiled function passes on costs a locked increment and decrement of its reference count; with some
hundred inner calls in a step that is more than the step's own work. The caller holds the arrays for as long as the
step runs, so inside it they can do without a count.
"""

from typing import TYPE_CHECKING, Any, TypeVar

from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic

Thing = TypeVar("Thing")


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Emit code for the same array with neither owner nor parent."""
    array = context.make_array(kind)(context, builder, value)
    array.meminfo = array.meminfo.type(None)
    array.parent = array.parent.type(None)
    return array._getvalue()  # noqa: SLF001 (numba's name for it)


@intrinsic
def _borrowed(typing_context: Any, thing: Any) -> Any:
    """Return an array, or a tuple of arrays, or None, without its reference count; valid while the owner lives."""

    def array_or_tuple(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.args[0]
        if isinstance(kind, types.Array):
            return _without_owner(context, builder, kind, arguments[0])
        items = zip(kind.types, cgutils.unpack_tuple(builder, arguments[0]), strict=True)
        return context.make_tuple(builder, kind, [_without_owner(context, builder, k, v) for k, v in items])

    def nothing(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.get_dummy_value()

    return thing(thing), nothing if isinstance(thing, types.NoneType) else array_or_tuple


@intrinsic
def _lent(typing_context: Any, array: Any) -> Any:
    """Return an array without its reference count, of the type of one that may be written."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _without_owner(context, builder, signature.return_type, arguments[0])

    return array.copy(readonly=False)(array), generate


if TYPE_CHECKING or config.DISABLE_JIT:  # what runs as Python counts as Python does

    def borrowed(thing: Thing) -> Thing:
        """Return an array, or a tuple of arrays, or None, without its reference count; valid while the owner lives."""
        return thing

    def lent(array: Thing) -> Thing:
        """Do what ``borrowed`` does with an array that is only read, whether Python may write to it or not.

        Compiled code tells these two apart: what reads arrays of both kinds, and all that it calls, is compiled twice.
        """
        return array
else:
    borrowed, lent = _borrowed, _lent
