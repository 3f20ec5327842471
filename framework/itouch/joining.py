"""Compiled functions joined into chains: Python runs several calls, whose arguments never change, by a single one.

A tick consists of many small compiled functions on views of State.  When Python calls one of them, dispatching on its
argument types and unpacking its arrays costs more than the computation.  Here the arrays are unpacked once, and a
``Chain`` runs the calls one after the other, by their addresses.

Data passes from one call to the next through the arrays.  A function returns 0, or another number to hand over to
Python: the chain stops there, and can go on with the call after it.  Several calls can form one step: ``SKIP`` leaves
out the rest of the step.  What a function raises ends the chain, which raises it in Python and notes which call it was.
Where functions cannot be joined, Python calls the same function with the same arguments by itself: there is one
implementation.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import inspect
import os
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from typing import Any, Protocol

import numba
import numpy as np
from llvmlite import ir
from numba import int64, types
from numba.core import cgutils
from numba.extending import intrinsic as _intrinsic
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import from_dtype
from numpy.typing import NDArray

from itouch.compiling import addressed_kernel, nogil_kernel, part_of_its_caller
from itouch.reference_counting import know

_SIGNATURE = int64(int64)
#: What a call returns to leave out the remaining calls of its step.
SKIP = 1 << 40
#: The numbers that describe where a chain is in memory (``Chain._about``), and how many they are.
_COUNT, _ENTRIES, _WORDS, _ENDS, _STEPS, _CLOCK, _MEMORY, _CALLED, _ABOUT = range(9)
#: Element types that arrays may have.
_KINDS = (
    np.float64, np.float32, np.int64, np.int32, np.int16, np.int8, np.uint64, np.uint32, np.uint16, np.uint8,
)  # fmt: skip
#: What a single number that is bound may be: one with a fraction, and one without.
_REAL, _WHOLE = (float, np.floating), (int, np.integer, np.bool_)
#: The compiled entries of this process, by function, body and the named tuples in the body.
_made: dict[tuple[Any, ...], Any] = {}
#: Their addresses, by function and kinds of arguments: a session has dozens of them, and a sweep ten thousand sessions.
_addresses: dict[tuple[Any, ...], int] = {}
#: Entries that are only listed and not compiled yet, inside ``listing``; else None.
_listed: dict[tuple[Any, ...], Any] | None = None
_untyped: Any = numba  # it exports no types
intrinsic: Any = _intrinsic
carray, config = _untyped.carray, _untyped.config
know(carray, unowned=True)


@intrinsic
def _pointer(typing: Any, address: Any) -> Any:
    """Turn a number into a pointer."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), generate


def _word(context: Any, builder: Any, words: Any, number: Any) -> Any:
    place = builder.inttoptr(words, ir.IntType(64).as_pointer())
    return builder.load(builder.gep(place, [number]))


@intrinsic
def _integer(typing: Any, words: Any, number: Any) -> Any:
    """Return word ``number`` of those at the address ``words``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _word(context, builder, *arguments)

    return types.int64(types.int64, types.int64), generate


@intrinsic
def _real(typing: Any, words: Any, number: Any) -> Any:
    """Return a word as the float whose bits it holds."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(_word(context, builder, *arguments), ir.DoubleType())

    return types.float64(types.int64, types.int64), generate


@cache
def _array(kind: type, dimensions: int, read_only: bool) -> Any:
    """Return what makes an array of such a kind from its address and shape, which are the words from ``number`` on.

    It is of the type that Numba gives such an array of Python's: for another one, all that a function calls would be
    compiled again.  What ``carray`` makes of words that are read one by one is the same; compiled for each of the
    hundred arrays of a long step, it was a good part of a first start.
    """
    made = types.Array(from_dtype(np.dtype(kind)), dimensions, "C", readonly=read_only)

    def of_words(typing: Any, words: Any, number: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            words, first = arguments
            word = partial(context.get_constant, types.intp)
            address, *shape = (
                _word(context, builder, words, builder.add(first, word(i))) for i in range(1 + dimensions)
            )
            element = context.get_data_type(made.dtype)
            size = stride = word(context.get_abi_sizeof(element))
            strides: list[Any] = []
            for extent in reversed(shape):
                strides.insert(0, stride)
                stride = builder.mul(stride, extent)
            array = context.make_array(made)(context, builder)
            data = builder.inttoptr(address, element.as_pointer())
            populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
            return array._getvalue()  # noqa: SLF001

        return made(types.int64, types.int64), generate

    found = intrinsic(of_words)
    know(found, unowned=True)
    return found


@intrinsic
def _call(typing: Any, address: Any, words: Any) -> Any:
    """Call the compiled function at an address with one number, and return the number that it returns.

    It is called as Numba's functions call one another: what it raises, the caller raises, too.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        called, conventions = builder.function.function_type, context.call_conv
        kind = conventions.get_function_type(types.int64, (types.int64,))
        result = cgutils.alloca_once_value(builder, ir.Constant(ir.IntType(64), 0))
        raised = cgutils.alloca_once(builder, called.args[1].pointee)
        entry = builder.inttoptr(arguments[0], kind.as_pointer())
        code = builder.call(entry, [result, raised, arguments[1]])
        status = conventions._get_return_status(builder, code, builder.load(raised))  # noqa: SLF001
        with cgutils.if_unlikely(builder, status.is_error):
            conventions.return_status_propagate(builder, status)
        return builder.load(result)

    return types.int64(types.int64, types.int64), generate


@intrinsic
def _read_clock(typing: Any, address: Any, which: Any, memory: Any) -> Any:
    """Call ``clock_gettime`` at its address, for the clock ``which``; the result is written to ``memory``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [ir.IntType(32), ir.IntType(64)])
        which_clock = builder.trunc(arguments[1], ir.IntType(32))
        found = builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), [which_clock, arguments[2]])
        return builder.sext(found, ir.IntType(64))

    return types.int64(types.int64, types.int64, types.int64), generate


@nogil_kernel
def run_chain(about: int, begin: int) -> int:
    """Run the calls from ``begin`` on; return -1, or index * 2**32 + code of the call that hands over to Python.

    ``about``: the address of the chain's description (``Chain.place``).  Plain numbers are the quickest arguments to
    pass from Python.
    """
    chain = carray(_pointer(about), _ABOUT, int64)
    count = chain[_COUNT]
    entries, words = carray(_pointer(chain[_ENTRIES]), count, int64), carray(_pointer(chain[_WORDS]), count, int64)
    ends = carray(_pointer(chain[_ENDS]), count, int64)
    i = begin
    while i < count:
        chain[_CALLED] = i
        code: int = _call(entries[i], words[i])
        if code != 0 and code != SKIP:
            return (i << 32) | code
        i = i + 1 if code == 0 else ends[i]
    return -1


@nogil_kernel
def _run_one(entry: int, words: int) -> int:
    """Run one call, by its entry and the address of its argument words; return what it returns."""
    code: int = _call(entry, words)
    return code


@nogil_kernel
def _run_timed(about: int, begin: int, stamps: Any, first: int) -> int:
    """Do what ``run_chain`` does, and write the host time [s] after step i to ``stamps[first + i]``."""
    chain = carray(_pointer(about), _ABOUT, int64)
    count = chain[_COUNT]
    entries, words = carray(_pointer(chain[_ENTRIES]), count, int64), carray(_pointer(chain[_WORDS]), count, int64)
    ends, steps = carray(_pointer(chain[_ENDS]), count, int64), carray(_pointer(chain[_STEPS]), count, int64)
    memory = carray(_pointer(chain[_MEMORY]), 2, int64)
    i = begin
    while i < count:
        chain[_CALLED] = i
        code: int = _call(entries[i], words[i])
        if code != 0 or i + 1 == ends[i]:
            _read_clock(chain[_CLOCK], 1, chain[_MEMORY])
            stamps[first + steps[i]] = memory[0] + 1e-9 * memory[1]
        if code != 0 and code != SKIP:
            return (i << 32) | code
        i = i + 1 if code == 0 else ends[i]
    return -1


@nogil_kernel
def host_time(about: int) -> float:
    """Return the host's time [s] by the clock of a chain (of its place), which is that of ``time.perf_counter``."""
    chain = carray(_pointer(about), _ABOUT, int64)
    memory = carray(_pointer(chain[_MEMORY]), 2, int64)
    _read_clock(chain[_CLOCK], 1, chain[_MEMORY])
    return float(memory[0] + 1e-9 * memory[1])


@nogil_kernel
def _repeat(entries: Any, words: Any, ends: Any, tick: Any, rounds: int) -> int:
    """Run all calls ``rounds`` times, a tick later each time; return how often a call handed over to Python."""
    left = 0
    for _ in range(rounds):
        i = 0
        while i < entries.shape[0]:
            code: int = _call(entries[i], words[i])
            left += code != 0 and code != SKIP
            i = i + 1 if code == 0 else ends[i]
        tick[0] += 1
    return left


class Call(Protocol):
    """A compiled function, and the arguments that it is always called with."""

    @property
    def function(self) -> Callable[..., int]:
        """What is called."""

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Contiguous arrays, named tuples of them, and numbers."""


class Chain:
    """Calls that run one after the other; of no use where compiling is switched off.

    ``sizes`` gives the number of calls in each step; default: each call is a step of its own.
    """

    def __init__(self, calls: Sequence[Call], sizes: Sequence[int] = ()) -> None:
        self.calls = tuple(calls)
        counts = tuple(sizes) or (1,) * len(self.calls)
        if sum(counts) != len(self.calls) or min(counts, default=1) < 1:
            raise ValueError(f"steps of {counts} calls are not {len(self.calls)} calls")
        #: The step of each call, and the first call after that step.
        self.steps = np.repeat(np.arange(len(counts), dtype=np.int64), counts)
        self.ends = np.repeat(np.cumsum(counts, dtype=np.int64), counts)
        self._words = [np.array(_words(call.arguments), np.int64) for call in calls]
        self._entries = np.array([_entry(call) for call in calls], np.int64)
        self._blocks = np.array([words.ctypes.data for words in self._words], np.int64)
        self._memory = np.zeros(2, np.int64)
        arrays = (self._entries, self._blocks, self.ends, self.steps)
        addresses = [array.ctypes.data for array in arrays]
        #: What compiled code needs to know of the chain: the number of calls, and the addresses of the arrays (entries,
        #: argument words, ends, steps), of the clock's function and of the memory for its result; at the end stands
        #: which call was the last.
        count = len(calls) if _listed is None else 0  # entries that are only listed cannot be run
        self._about = np.array([count, *addresses, _clock_address(), self._memory.ctypes.data, 0], np.int64)
        #: The address of ``_about``.
        self.place = int(self._about.ctypes.data)

    @property
    def called(self) -> int:
        """The call that was run last: the one that has failed, if the chain has raised something."""
        return int(self._about[_CALLED])

    def run(self, begin: int = 0) -> int:
        """Run the calls from ``begin`` on; return -1, or index * 2**32 + code of the call that hands over to Python.

        What a call raises is raised here, too.
        """
        return run_chain(self.place, begin)

    def warm_up(self) -> None:
        """Compile, or load from the cache, the functions that run chains; none of the calls is run."""
        self.run(len(self.calls))
        self.run_timed(np.zeros(1), 0, len(self.calls))

    def repeat(self, rounds: int, tick: NDArray[np.int64]) -> int:
        """Run all calls ``rounds`` times in one compiled loop, for measurements; ``tick`` (1,), a count, grows by 1.

        When a call hands over to Python, that work and the remaining calls of its step are left out.  Returns how often
        this happened.
        """
        return _repeat(self._entries, self._blocks, self.ends, tick, rounds)

    def run_timed(self, stamps: NDArray[np.float64], first: int, begin: int = 0) -> int:
        """Do what ``run`` does; ``stamps`` (n,): the host time [s] after step i is written to ``stamps[first + i]``."""
        return _run_timed(self.place, begin, stamps, first)


def can_join() -> bool:
    """Tell whether functions can be joined here: the compiler is on, and compiled code can read Python's clock."""
    return (
        not config.DISABLE_JIT
        and _clock_address() != 0
        and time.get_clock_info("perf_counter").implementation == ("clock_gettime(CLOCK_MONOTONIC)")
    )


def runner(calls: Sequence[Call]) -> Callable[[], int]:
    """Return a function that runs the calls one after the other, joined where that is possible.

    It returns what ``Chain.run`` does.  The calls are compiled here, and in their joined form alone.
    """
    if can_join():
        chain = Chain(calls)
        chain.warm_up()
        return chain.run
    return in_python(calls)


def caller(call: Call) -> Callable[[], int]:
    """Return a function that makes a call, in its joined form where that is possible, and returns what it returns.

    Raises
    ------
    ValueError
        As of `prepare`.
    """
    if not can_join() or not hasattr(call.function, "py_func"):
        return partial(call.function, *call.arguments)
    numbers, entry = _words_and_entry(call)
    words = np.array(numbers, np.int64)
    if _listed is not None:  # an entry that is only listed cannot be run
        return lambda: 0
    run: Any = partial(_one_call(), entry, int(words.ctypes.data))
    run.kept = words, call.arguments  # the memory of which compiled code knows the addresses
    return run  # type: ignore[no-any-return]


@cache
def _one_call() -> Any:
    """Return what runs one call, compiled or loaded before the first call, and only once for every `Bound`."""
    one: Any = _run_one
    one.compile((int64, int64))
    return one


def in_python(calls: Sequence[Call]) -> Callable[[], int]:
    """Return a function that calls from Python what `runner` joins, and returns the same; each is compiled by itself.

    That is for where functions cannot be joined.
    """

    def run() -> int:
        for index, call in enumerate(calls):
            code = call.function(*call.arguments)
            if code:
                return (index << 32) | code
        return -1

    return run


@contextlib.contextmanager
def listing() -> Iterator[Callable[[float], None]]:
    """Inside the context, only list the entries that chains need instead of compiling them; such chains run nothing.

    Yields a function that compiles the entries listed so far, the last one first, so that it meets another process that
    builds the same engine, and compiles from the front, halfway.  Its argument, from 0 to 1, is the share of the list
    that it skips at first, counted from the end, and compiles last.  What another process has compiled meanwhile is
    loaded.
    """
    global _listed
    before, found = _listed, dict[tuple[Any, ...], Any]()
    _listed = found

    def compile_them(part: float = 0.0) -> None:
        last_first = list(found.values())[::-1]
        begin = int(part * len(last_first))
        for made in last_first[begin:] + last_first[:begin]:
            made.compile(_SIGNATURE)

    try:
        yield compile_them
    finally:
        _listed = before


def listed() -> tuple[Any, ...]:
    """Return the entries that have been listed so far, inside ``listing``."""
    return tuple((_listed or {}).values())


def prepare(call: Call) -> None:
    """Make the entry by which a call is joined, so that what is wrong with it is known before it is part of a chain.

    Raises
    ------
    ValueError
        If the function is not compiled, or cannot be for these arguments, or one of these cannot be bound.
    """
    if not can_join():
        return
    if not hasattr(call.function, "py_func"):
        raise ValueError(f"'{_name(call)}' is bound, which is not compiled: write @kernel above it")
    _words_and_entry(call)


def _words_and_entry(call: Call) -> tuple[list[int], int]:
    """Return the argument words of a call, and its entry.

    Raises
    ------
    ValueError
        If the function cannot be compiled for these arguments, or one of these cannot be bound.
    """
    try:
        return _words(call.arguments), _entry(call)
    except numba.core.errors.NumbaError as error:
        why = _why(str(error))
        raise ValueError(f"'{_name(call)}' can't be compiled for what is bound to it: {why}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"'{_name(call)}' can't be called with what is bound to it: {error}") from error


def _name(call: Call) -> str:
    return getattr(call.function, "__name__", repr(call.function))


def _why(text: str) -> str:
    """Return what Numba says against a function, in one line."""
    if "Function(int64)" in text and "(none)" in text:  # its result is made an int64
        return "it returns nothing, where 0 or another number is wanted"
    lines = [line.strip() for line in text.splitlines()[1:]]
    return next((line for line in lines if line), text)[:300]


def is_newest(cls: type, joined: str, alone: str) -> bool:
    """Tell whether the method ``joined`` may stand in for ``alone``: no class further down overrides ``alone`` only."""
    ancestry = cls.__mro__
    owners = [next(i for i, base in enumerate(ancestry) if name in vars(base)) for name in (joined, alone)]
    return owners[0] <= owners[1]


@cache
def _clock_address() -> int:
    function = getattr(ctypes.CDLL(None), "clock_gettime", None) if os.name == "posix" else None
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0) if function is not None else 0


def _words(arguments: Sequence[Any]) -> list[int]:
    """Return arguments as 64-bit words: for an array its address and shape, for a number its bits."""
    words: list[int] = []
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            if not argument.flags.c_contiguous:
                raise ValueError("an array that is bound must be contiguous")
            if not argument.dtype.isnative:
                raise ValueError(f"an array of {argument.dtype.str} has its bytes in the other order")
            if argument.dtype not in _KINDS:  # an int64 may be a longlong, too: another type of the same numbers
                allowed = ", ".join(kind.__name__ for kind in _KINDS)
                raise ValueError(f"an array that is bound is of one of {allowed}, not of {argument.dtype}")
            words += [argument.ctypes.data, *argument.shape]
        elif isinstance(argument, tuple):
            words += _words(argument)
        elif argument is None:
            continue
        elif isinstance(argument, _REAL):
            words.append(int(np.float64(argument).view(np.int64)))
        else:
            words.append(_whole(argument))
    return words


def _whole(argument: Any) -> int:
    """Return a whole number, for which a word must have room; anything else would arrive as another value."""
    if not isinstance(argument, _WHOLE):
        raise TypeError(f"{argument!r:.60} is bound, which is neither a number, nor an array or a tuple of them")
    number = int(argument)
    if not -(1 << 63) <= number < 1 << 63:
        raise ValueError(f"{number} is bound, which has more than 64 bits with its sign")
    return number


def _entry(call: Call) -> int:
    """Return the address of the call's entry: it takes the address of the argument words, and calls the function."""
    known = (call.function, _kinds(call.arguments))
    if _listed is not None:
        return _written(call)
    if known not in _addresses:
        _addresses[known] = _written(call)
    return _addresses[known]


def _kinds(arguments: Sequence[Any]) -> tuple[Any, ...]:
    """Return what decides how arguments are rebuilt from their words: for an array its type, not its address."""
    return tuple(
        (each.ndim, each.dtype, each.flags.writeable) if isinstance(each, np.ndarray)
        else (type(each), _kinds(each)) if isinstance(each, tuple)
        else type(each)
        for each in arguments
    )  # fmt: skip


def _written(call: Call) -> int:
    writer = _Writer()
    passed = [writer.write(argument) for argument in call.arguments]
    lines = [*writer.lines, f"return int64(function({', '.join(passed)}))"]
    body = "\n    ".join(lines)
    key = (call.function, body, tuple(writer.classes.values()))
    if _listed is not None:
        if key not in _listed:
            _listed[key] = _joined(call.function, body, {**writer.arrays, **writer.classes})
        return 0
    if key not in _made:
        made = _joined(call.function, body, {**writer.arrays, **writer.classes})
        made.compile(_SIGNATURE)  # kept only then: it may be interrupted, and tried again
        _made[key] = made
    made = _made[key].overloads[_SIGNATURE.args]
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


def _joined(function: Callable[..., int], body: str, written: dict[str, Any]) -> Any:
    """Return the entry of a function with this body, not compiled yet; it is cached like the function itself."""
    inner: Any = getattr(function, "py_func", function)
    name = f"{inner.__name__}_{hashlib.sha256(body.encode()).hexdigest()[:12]}"
    names = {
        **written, "integer": _integer, "real": _real, "int64": int64, "function": part_of_its_caller(function),
        "__name__": inner.__module__,
    }  # fmt: skip
    exec(compile(f"def {name}(words):\n    {body}\n", inspect.getfile(inner), "exec"), names)
    return addressed_kernel(names[name])


class _Writer:
    """Writes the code that rebuilds arguments from their words."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        #: What the names mean that it uses: named tuples, and what makes arrays.
        self.classes: dict[str, type] = {}
        self.arrays: dict[str, Any] = {}
        self.count = 0

    def write(self, argument: Any) -> str:
        """Return the expression of an argument."""
        if isinstance(argument, tuple):
            kind = type(argument)
            name = f"of_{kind.__name__}"  # whatever it is called, it is none of the other names
            while self.classes.setdefault(name, kind) is not kind:  # another class of the same name
                name += "_"
            inner = "".join(f"{self.write(item)}, " for item in argument)
            return f"{name}({inner})" if hasattr(kind, "_fields") else f"({inner})"
        if argument is None:
            return "None"
        first, self.count = self.count, self.count + 1
        if isinstance(argument, np.ndarray):
            self.count += argument.ndim
            self.lines.append(f"a{first} = {self._maker(argument)}(words, {first})")
            return f"a{first}"
        if isinstance(argument, bool | np.bool_):
            return f"(integer(words, {first}) != 0)"
        if isinstance(argument, _REAL):
            return f"real(words, {first})"
        return f"integer(words, {first})"

    def _maker(self, argument: NDArray[Any]) -> str:
        """Return the name of what makes such an array."""
        kind, read_only = _KINDS[_KINDS.index(argument.dtype)], not argument.flags.writeable
        name = f"{kind.__name__}_{argument.ndim}{'_only_read' * read_only}"
        make: Any = _array
        self.arrays[name] = make(kind, argument.ndim, read_only)
        return name
