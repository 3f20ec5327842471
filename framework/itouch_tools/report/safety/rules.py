"""What trips at which value, as in force in one scene (rules T, K and W of the reference of the limits)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from itouch.plugin import Role
from itouch.world import Model
from itouch.world.limits import DEFAULT, HOLD, REARMS
from itouch.world.supervision import rules as rules_of

K0 = 273.15


class Rule(NamedTuple):
    """One limit: its number, the device, what is limited, from where, what trips, the absolute limit, who set it."""

    number: str
    device: str
    quantity: str
    limit: str
    trip: str
    absolute: str
    source: str


def rules(model: Model) -> Iterator[Rule]:
    """Yield every limit in force in a scene: those of its monitors, device by device, then those that hold for all."""
    for device in model.devices.values():
        for rule in rules_of(device.monitors):
            yield Rule(rule.number, device.name, rule.quantity, rule.limit, rule.trip, rule.absolute, rule.source)
    yield from _all(model)


def alone(model: Model) -> Iterator[str]:
    """Yield the names of hardware that takes commands and has no watchdog of its own that its driver knows of."""
    for device in model.devices.values():
        if not device.twin and device.commands and device.cls.watchdog_for(device.params) is None:
            yield device.name


def without_force_reading(model: Model) -> Iterator[str]:
    """Yield the names of devices that carry a surface to a finger and measure no force."""
    for device in model.devices.values():
        carries = any(channel.role is Role.SURFACE_POSE for channel in device.commands)
        if carries and not any(channel.role is Role.CONTACT_FORCE for channel in device.reads):
            yield device.name


def _all(model: Model) -> Iterator[Rule]:
    dies = "outputs safe within 200 ms, by the guardian process or the device's own watchdog"
    yield Rule("W2", "all", "death of the servo process", "", dies, "", DEFAULT)
    for name in without_force_reading(model):
        watched = "nothing: no limit of force watches it"
        yield Rule(
            "K4", name, "force of the surface on the finger", "unknown: the device measures none", watched, "", ""
        )
    for name in alone(model):
        only = "outputs safe within 200 ms, by the guardian process alone: it runs with guardian and hold-to-run only"
        yield Rule("W2", name, "death of the servo process", "no watchdog of its own is known", only, "", DEFAULT)
    hardware = any(not device.twin for device in model.devices.values())
    source = "hold-to-run of the scene" if model.scene.safety.hold_to_run else DEFAULT
    asked = hardware or model.scene.safety.hold_to_run
    silent = f"no word for {HOLD * 1e3:g} ms"
    switch = f"letting go, or {silent}: retracts in the same tick" if asked else "not asked for on twins"
    yield Rule("W3", "all", "hold-to-run", "", switch, "", source)
    often = f"more than {REARMS} times a minute"
    yield Rule(
        "W4", "all", "re-arming", "by an operator only, from the measured state, with a ramp", often, "", DEFAULT
    )
