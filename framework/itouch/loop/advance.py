"""A whole tick as one compiled call: the joined plan, the clock readings before and after it, and the tick counts."""

from __future__ import annotations

from typing import Any

from itouch.compiling import kernel
from itouch.joining import host_time, run_chain
from itouch.loop.timing import count

#: Codes for what is left to Python: the whole tick, or its rest from where the plan has stopped, which is in ``left``.
PYTHON, STOPPED = 1, 2


@kernel
def advance(
    chain: int, tick: Any, ready: Any, sampled: int, stamps: Any, told: Any, counts: Any, greatest: Any, left: Any
) -> int:  # fmt: skip
    """Run a plan's only chain, count the tick, and record how long it took; scalars have shape (1,).

    Parameters
    ----------
    chain
        Address of what describes the chain (`Chain.place`).
    tick, ready
        Fields of State: the number of the tick, and whether the rig is calibrated; until it is, Python runs the ticks.
    sampled
        One tick in this many is left to Python, which times its parts.
    stamps
        Host time [s], the first entry at the start of the tick and the last at its end; written.
    told, counts, greatest
        The number of ticks timed, their histograms, and the greatest times; written.
    left
        Where the plan has stopped, if a step has left something to Python; written.

    Returns
    -------
    int
        0: the tick is done; else PYTHON or STOPPED.
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
