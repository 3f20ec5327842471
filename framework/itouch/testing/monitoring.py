"""Checks that a monitor watches what a device can do to a person, and that monitors respect their contract."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from itouch.monitors import own_monitors
from itouch.plugin import Moment, Monitor, Record, Watched
from itouch.plugin.record import Field
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import DeviceHarness
from itouch.world.limits import DeviceLimits, ceilings
from itouch.world.supervision import monitors_of, supervision_problems, watched

#: Number of readings that a monitor is given.
SHOWN = 400


def _seen(harness: DeviceHarness) -> Watched:
    params = harness.require_params()
    channels = harness.cls.channels(params)
    limits = DeviceLimits(**{name: value for name, (value, _) in ceilings(*channels).items()})
    return watched(harness.name, harness.name, params, channels, limits, twin=False)


@check("watched", "what can hurt is watched by a monitor")
def drives(harness: DeviceHarness) -> str:
    """Check that there is a monitor for each command that can hurt."""
    seen = _seen(harness)
    monitors = monitors_of(seen, harness.catalog.monitors())
    for problem in supervision_problems(seen, monitors, None):
        raise CheckError(
            problem.sentence, cause="a role is missing, or the reading of the effect", advice=problem.advice
        )
    return ", ".join(monitor.name for monitor in monitors)


@check("monitors", "the plugin's monitors keep to their contract")
def contract(harness: DeviceHarness) -> str:
    """Give the monitors that plugins offer for this device all kinds of readings, at irregular times."""
    seen = _seen(harness)
    offered = [one for kind in harness.catalog.monitors() for one in kind.of(seen)]
    if not offered:
        raise NotApplicableError("no distribution offers a monitor for it")
    own = {monitor.name for monitor in own_monitors(seen)}
    for monitor in offered:
        if monitor.name in own:
            raise CheckError(
                f"a monitor is named '{monitor.name}' like one of the framework's", cause="a copy", advice="rename it"
            )
        examine(monitor)
    return ", ".join(monitor.name for monitor in offered)


def examine(monitor: Monitor) -> None:
    """Check that a monitor returns a share or a trip, keeps its memory in State only, and has words for each trip.

    Raises
    ------
    CheckError
        If it does not; says what it does.
    """
    device, generator = monitor.device, np.random.default_rng(7)
    state = Record.of(monitor.fields()) if monitor.fields() else Record(np.dtype([]))
    reading, sent = (Record.of(Field.of(c) for c in channels) for channels in (device.reads, device.commands))
    monitor.reset(state)
    kept, moment = dict(vars(monitor)), Moment()
    for index in range(SHOWN):
        seconds = float(generator.choice((0.0, 0.001, 0.007, 0.01, 0.5)))
        moment.now, moment.seconds, moment.fresh = moment.now + seconds, seconds, bool(index % 3)
        moment.time, moment.touched = moment.now, bool(generator.integers(2))
        for record, channels in ((reading, device.reads), (sent, device.commands)):
            for channel in channels:
                low, high = (_end(channel.low, -1.0), _end(channel.high, 1.0))
                record[channel.name] = generator.uniform(low, high, channel.size)
        before = reading.tobytes(), sent.tobytes()
        found: Any = monitor.check(state, reading, sent, moment)
        _judge(monitor, found, state, reading, moment)
        if (reading.tobytes(), sent.tobytes()) != before:
            raise CheckError(
                f"the monitor '{monitor.name}' changes what it looks at",
                cause="it writes into the reading or the command", advice="a monitor writes its own fields only",
            )  # fmt: skip
    changed = [name for name, value in vars(monitor).items() if name not in kept or kept[name] is not value]
    if changed:
        raise CheckError(
            f"the monitor '{monitor.name}' keeps '{changed[0]}' in an attribute",
            cause="its memory would be lost with a saved session", advice="declare a field for it",
        )  # fmt: skip


def _end(bounds: tuple[float, ...], otherwise: float) -> float:
    found = bounds[0] if bounds else otherwise
    return found if math.isfinite(found) else otherwise


def _judge(monitor: Monitor, found: Any, state: Record, reading: Record, moment: Moment) -> None:
    share = isinstance(found, (int, float)) and 0.0 <= found <= 1.0
    code = -int(found) if isinstance(found, (int, float)) and math.isfinite(found) and found < 0.0 else 0
    if not share and (code not in monitor.trips or code != -found):
        raise CheckError(
            f"the monitor '{monitor.name}' returns {found!r}",
            cause="it would loosen a limit, or trips with a code that it does not declare",
            advice="return a share, 0 to 1, or minus one of the codes in `trips`",
        )
    if share:
        return
    number = monitor.rule(code, reading)
    if not monitor.sentence(code, state, reading, moment):
        raise CheckError(f"'{monitor.name}' trips without a word", cause="no sentence", advice="override `sentence`")
    if not any(number in (rule.number, rule.quantity) and rule.trip for rule in monitor.rules()):
        raise CheckError(
            f"the trip '{monitor.trips[code]}' of the monitor '{monitor.name}' belongs to none of its rules",
            cause="`rule` returns no number or quantity of `rules`",
            advice="check, safety report and fault are made from `rules`",
        )
