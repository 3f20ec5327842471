"""Time that no tick stands for: a late loop left it out, or nothing ran; hardware went on meanwhile."""

from __future__ import annotations

from collections.abc import Sequence

from itouch.loop.events import Events
from itouch.loop.rig import ProbeRig
from itouch.loop.runner import Runner

#: Left-out time [s] from which on a finger's velocity is taken to be unknown; for less it is taken to go on.
MOVES_ON = 0.05


def leave_out(
    period: float, runners: Sequence[Runner], rigs: Sequence[ProbeRig], events: Events, seconds: float, tick: int,
    running: bool,
) -> int:  # fmt: skip
    """Count left-out time in the monitors of devices, and tell touchers and modalities of it.

    Touchers and modalities are told only with hardware in the rig: no finger's velocity is taken across the gap then.

    Parameters
    ----------
    period
        Of a tick [s].
    runners, rigs, events
        The devices and probes of the engine, and what calls its modalities.
    seconds, tick
        How long it was [s], and the tick that comes next.
    running
        Whether a loop that was late has left it out: then the monitors of twins count it as well.

    Returns
    -------
    int
        How many periods were left out; 0: it was at most one, and nothing has changed.

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
            runner.gate.leave_out(periods)
    if any(not runner.model.twin for runner in runners):
        for rig in rigs:
            rig.toucher.settle(moves=periods * period < MOVES_ON)
        events.left_out(periods * period, tick)
    return periods
