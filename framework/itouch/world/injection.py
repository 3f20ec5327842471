"""The faults that a scene injects into the twin of a device; on hardware there are none."""

from __future__ import annotations

import math
from collections.abc import Sequence

from itouch.faults import FOREVER, Injection, Kind
from itouch.plugin import Channel
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement, Fault
from itouch.schema import Problem
from itouch.schema.diagnostics import did_you_mean
from itouch.schema.quantities import QuantityError, parse_quantity


def injections(
    scene: Scene, device: DeviceElement, channels: Sequence[Channel], problems: list[Problem]
) -> tuple[Injection, ...]:
    """Return the faults to inject into a device, in file order; what is wrong with them becomes problems."""
    found = []
    for fault in scene.faults:
        if fault.device != device.name:
            continue
        if not device.twin:
            sentence = f"device '{device.name}' is hardware: a fault can only be injected into a twin"
            advice = "remove the fault, or run with --twin all"
            problems.append(Problem("fault-on-hardware", sentence, scene.places.of(fault, "device"), advice))
            continue
        found.append(injection(scene, fault, channels, problems))
    return tuple(found)


def injection(scene: Scene, fault: Fault, channels: Sequence[Channel], problems: list[Problem]) -> Injection:
    """Return one fault to inject; what is wrong with it becomes a problem."""
    rate = scene.rates.servo
    begin = round(fault.at * rate)
    end = FOREVER if fault.for_ is None else begin + max(1, round(fault.for_ * rate))
    amount = math.nan
    channel = next((channel for channel in channels if channel.name == fault.channel), None)
    if channel is None and fault.channel:
        names = [channel.name for channel in channels]
        sentence = f"device '{fault.device}' has no channel '{fault.channel}'"
        place = scene.places.of(fault, "channel")
        problems.append(Problem("missing-channel", sentence, place, did_you_mean(fault.channel, names, "it has")))
    elif channel is not None and fault.amount:
        amount = _amount(scene, fault, channel, problems)
    kind, where = Kind.of(fault.kind), fault.channel if channel is not None else ""
    try:
        return Injection(kind, begin, end, where, amount)
    except ValueError as error:
        place = scene.places.of(fault, "amount")
        problems.append(Problem("bad-value", f"<fault amount>: {error}", place, "remove it, or choose another kind"))
        return Injection(kind, begin, end, where)


def _amount(scene: Scene, fault: Fault, channel: Channel, problems: list[Problem]) -> float:
    try:
        value = parse_quantity(fault.amount, channel.unit)
    except QuantityError as error:
        problems.append(Problem("bad-value", f"<fault amount>: {error}", scene.places.of(fault, "amount")))
        return math.nan
    return value[0]
