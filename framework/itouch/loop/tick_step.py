"""The class of a step of the tick: its name, what it calls, and which fields of State it reads and writes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from itouch.joining import SKIP
from itouch.plugin import Bound

#: What a step calls, with the number of the tick and whether the rig is calibrated so that scripts go on.
Work = Callable[[int, bool], None]

#: What Python calls for what a compiled step leaves to it: with the step's code, and the same two arguments.
Answer = Callable[[int, int, bool], None]

#: What raises the fault for an error of a plugin's compiled function, with the error, which of the step's calls has
#: failed, and the number of the tick.  If it returns, the rest of the step is skipped.
Failed = Callable[[Exception, int, int], None]

#: What a step runs as: compiled code, Python that calls compiled functions, or Python alone.
COMPILED, CALLS_KERNELS, PYTHON = "compiled", "calls kernels", "Python"


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the plan.

    ``reads`` and ``writes`` name fields of State; a name that ends or begins with ``*`` stands for all that begin or
    end so; ``reads`` is None where a plugin does not say.  ``every``: the step runs in one tick of this many.
    ``amends`` names commands that another step writes and that this one may overrule.

    A step with ``bounds`` is joined with its neighbours that have some: together they are one call from Python.  What
    it leaves to Python, ``answer`` does; the bounds of the step that have not run by then are skipped.  ``failed``
    blames the plugin whose compiled function has raised something; it is None where the functions are the framework's.
    """

    name: str
    work: Work
    reads: tuple[str, ...] | None = ()
    writes: tuple[str, ...] = ()
    every: int = 1
    code: str = PYTHON
    bounds: tuple[Bound, ...] = ()
    answer: Answer | None = None
    amends: tuple[str, ...] = ()
    failed: Failed | None = None

    @property
    def bound(self) -> Bound | None:
        """The call of a step that is a single call; else None."""
        return self.bounds[0] if len(self.bounds) == 1 else None

    def fitted(self, fields: Iterable[str]) -> Step:
        """Return the step with only those names in ``reads`` and ``writes`` that match any of these fields."""
        listed = tuple(fields)
        reads = None if self.reads is None else _fitting(self.reads, listed)
        return replace(self, reads=reads, writes=_fitting(self.writes, listed))

    def written(self, fields: Iterable[str]) -> Iterator[str]:
        """Yield those of these fields that the step writes."""
        return matching(self.writes, fields)


def joinable(
    name: str, bound: Bound | Sequence[Bound], reads: tuple[str, ...] | None, writes: tuple[str, ...],
    answer: Answer | None = None, failed: Failed | None = None,
) -> Step:  # fmt: skip
    """Return a compiled step; its ``work`` does the same where calls can't be joined."""
    bounds = (bound,) if isinstance(bound, Bound) else tuple(bound)

    def work(tick: int, ready: bool) -> None:
        for which, one in enumerate(bounds):
            try:
                code = one()
            except Exception as error:
                if failed is None:
                    raise
                failed(error, which, tick)
                return
            if code == SKIP:
                return
            if code:
                if answer is not None:
                    answer(code, tick, ready)
                return

    return Step(name, work, reads, writes, 1, COMPILED, bounds, answer, failed=failed)


@lru_cache(maxsize=4096)
def _fitting(patterns: tuple[str, ...], fields: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(pattern for pattern in patterns if any(True for _ in matching((pattern,), fields))))


def matching(patterns: tuple[str, ...], fields: Iterable[str]) -> Iterator[str]:
    """Yield the fields that match any of the patterns, in their order."""
    exact = {pattern for pattern in patterns if "*" not in pattern}
    begins = tuple(pattern[:-1] for pattern in patterns if pattern.endswith("*"))
    ends = tuple(pattern[1:] for pattern in patterns if pattern.startswith("*"))
    return (field for field in fields if field in exact or field.startswith(begins) or field.endswith(ends))
