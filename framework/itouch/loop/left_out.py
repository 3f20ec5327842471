"""Time that no tick stands for: a late loop has left it out, or nothing ran, and hardware has gone on in it."""

from __future__ import annotations

from collections.abc import Sequence

from itouch.loop.events import Events
from itouch.loop.rig import ProbeRig
from itouch.loop.runner import Runner

#: After how long [s] of it nothing is known of how fast a finger moves; until then it is thought to go on.
MOVES_ON = 0.05


def leave_out(
    period: float, runners: Sequence[Runner], rigs: Sequence[ProbeRig], events: Events, seconds: float, tick: int,
    running: bool,
) -> int:  # fmt: skip
    """Let it pass for budgets, for the velocities of fingers, and for what modalities know of fingers and displays.

    Parameters
    ----------
    period
        Of a tick [s].
    seconds, tick
        How long it was [s], and the tick that comes next.
    running
        Whether a loop that was late has left it out: the monitors of twins count it as well then.

    Returns
    -------
    int
        How many periods were left out; 0: it was none, and nothing has changed.

    Raises
    ------
    DeviceFaultError
        If a modality fails.
    """
    periods = round(seconds / period)
    if periods <= 1:
        return 0
    for runner in runners:
        if running or not runner.model.twin:
            runner.leave_out(periods)
    if any(not runner.model.twin for runner in runners):
        for rig in rigs:
            rig.toucher.settle(moves=periods * period < MOVES_ON)
        events.left_out(periods * period, tick)
    return periods
