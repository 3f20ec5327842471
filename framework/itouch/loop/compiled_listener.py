"""A listener of ticks in compiled code, which the loop joins with the tick so that many of both run as one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from itouch.joining import Call, Chain, can_join, in_python


class CompiledListener:
    """Calls that follow each tick; what they leave to Python is answered before the next tick begins.

    From Python it is an ordinary listener of `Notifications.tick`.  Where it is the only one, and the whole tick is
    compiled, the engine runs it without Python.

    Parameters
    ----------
    calls
        Run one after the other; they must not raise anything.  The tick and what else they need of the State must be
        bound to them; ``tick`` is that of the next tick, as a listener in Python finds it.
    answer
        Called with the code of the call that has left something to Python, and the number of the tick that is over.
        The calls after that one are left out.
    """

    def __init__(self, calls: Sequence[Call], answer: Callable[[int, int], None]) -> None:
        self._answer = answer
        self._chain = Chain(calls) if can_join() else None
        if self._chain is not None:
            self._chain.warm_up()
        self._run = in_python(calls) if self._chain is None else self._chain.run
        #: The address of the chain of its calls (`Chain.place`); 0 where compiling is switched off.
        self.place = 0 if self._chain is None else self._chain.place

    def __call__(self, tick: int) -> None:
        """Hear that a tick is over."""
        found = self._run()
        if found >= 0:
            self._answer(found & 0xFFFFFFFF, tick)

    def go_on(self, found: int, tick: int) -> None:
        """Answer what the calls left to Python, where compiled code has run them: ``found`` is as of `run_chain`."""
        self._answer(found & 0xFFFFFFFF, tick)

    def repeat(self, rounds: int) -> None:
        """Run the calls in one compiled loop, for measurements; what they leave to Python is left out.

        Raises
        ------
        ValueError
            If compiling is switched off.
        """
        if self._chain is None:
            raise ValueError("there is no compiled code to measure: compiling is switched off")
        self._chain.repeat(rounds, np.zeros(1, np.int64))
