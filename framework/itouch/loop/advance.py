"""A whole tick as one compiled call: the joined plan, the clock before and after it, and counting."""

from __future__ import annotations

from typing import Any

from itouch.compiling import kernel
from itouch.joining import host_time, run_chain
from itouch.loop.timing import count

#: What is left to Python: the tick, or what is in ``left``, where the plan has stopped.
PYTHON, STOPPED = 1, 2


@kernel
def advance(
    chain: int, tick: Any, ready: Any, sampled: int, stamps: Any, told: Any, counts: Any, greatest: Any, left: Any
) -> int:  # fmt: skip
    """Run a plan's only chain, count the tick and how long it took; scalars have shape (1,).

    Parameters
    ----------
    chain
        Where the chain stands.
    tick, ready
        Of State: which tick it is, and whether the rig is calibrated; before it is, ticks are Python's.
    sampled
        Every so many ticks are left to Python, which times their parts.
    stamps
        Host seconds: the first at the start, the last at the end; written.
    told, counts, greatest
        How many ticks there were, their histograms and greatest times.
    left
        Where the plan has stopped, if a step has left something to Python.
    """
    if ready[0] == 0 or tick[0] % sampled == 0:
        return PYTHON
    stamps[0] = host_time(chain)
    found = run_chain(chain, 0)
    if found >= 0:
        left[0] = found
        return STOPPED
    tick[0] += 1
    last = len(stamps) - 1
    stamps[last] = host_time(chain)
    told[0] += 1
    count(counts, greatest, 1, stamps[last] - stamps[0])
    return 0
