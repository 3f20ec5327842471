"""Checks of what a plugin says of its numbers: units and sentences for all, and roles that match its behaviour."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Channel, Role
from itouch.plugin.declaration_rules import faults_of
from itouch.plugin.quantity import SIZES
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import PERIOD, DeviceHarness, TwinBench
from itouch.testing.scenario import ModalityHarness

#: Unit of a quantity with a role.
UNITS = {
    Role.TRACKED_POSE: "m", Role.TRACKED_TWIST: "m/s", Role.CONTACT_FORCE: "N", Role.FORCE_ON_OPERATOR: "N",
    Role.SURFACE_POSE: "m", Role.SKIN_CONTACT_TEMPERATURE: "K", Role.SKIN_TEMPERATURE: "K", Role.OTHER_TEMPERATURE: "K",
    Role.HEAT_SINK_TEMPERATURE: "K", Role.TEMPERATURE_TARGET: "K", Role.HEAT_FLUX: "W/m^2", Role.PRESSURE: "Pa",
    Role.DEADMAN: "1", Role.SKIN_VALID: "1", Role.OUTPUT_SWITCH: "1",
}  # fmt: skip
#: Roles of commands; all others but SIGNAL are those of readings.
COMMANDS = frozenset({
    Role.FORCE_ON_OPERATOR, Role.SURFACE_POSE, Role.DRIVE, Role.TEMPERATURE_TARGET, Role.PRESSURE, Role.ELECTRODE,
    Role.ULTRASOUND, Role.OUTPUT_SWITCH,
})  # fmt: skip
#: Roles that both readings and commands may have: what is driven can also be measured.
BOTH = frozenset({Role.SIGNAL, Role.PRESSURE})
#: How long a drive acts [s], and by how much the temperature that it drives must have changed then [K].
DRIVEN, FOLLOWS = 5.0, 0.2


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("meaning", "every number says its unit and what it is")
def meaning(harness: DeviceHarness) -> str:
    """Check the channels, and the State fields of the twin."""
    bench = harness.bench()
    fields = bench.twin.fields()
    _said([*faults_of(bench.reads, "reading"), *faults_of(bench.commands, "command"), *faults_of(fields, "field")])
    return f"{len(bench.reads) + len(bench.commands)} channels, {len(fields)} fields"


@check("meaning", "every number says its unit and what it is")
def fields_meaning(harness: ModalityHarness) -> str:
    """Check the State fields of the modality."""
    engine = harness.engine()
    fields = [field for m in harness.own(engine) for field in m.instance.fields(m.model)]
    _said(list(faults_of(fields, "field")))
    return f"{len(fields)} fields"


def _said(faults: list[str]) -> None:
    if faults:
        raise _fail(
            "; ".join(faults[:4]) + ("; ..." if len(faults) > 4 else ""),
            "unit= or doc= is missing, or the unit is not SI",
            'give every Channel and Field a unit and one sentence: Field("level", unit="Pa", doc="pressure inside")',
        )


@check("roles", "what it calls its channels is what they do")
def roles(harness: DeviceHarness) -> None:
    """Compare roles with units, sizes and direction, and a skin-contact temperature with the effect of the drive."""
    bench = harness.bench()
    named = [channel for channel in (*bench.reads, *bench.commands) if channel.role is not Role.SIGNAL]
    if not named:
        raise NotApplicableError("none of its channels has a role")
    _sides(bench.reads, bench.commands)
    for channel in named:
        unit = UNITS.get(channel.role, channel.unit)
        if channel.unit != unit or SIZES.get(channel.role, channel.size) != channel.size:
            raise _fail(
                f"'{channel.name}' is called a {channel.role.value}, and is {channel.size} x '{channel.unit}'",
                "another role was meant, or another unit",
                f"a {channel.role.value} is {SIZES.get(channel.role, 'any number of')} x {unit}",
            )
    _contact_temperature(bench)


def _sides(reads: Iterable[Channel], commands: Iterable[Channel]) -> None:
    wrong = [c for c in reads if c.role in COMMANDS - BOTH] + [c for c in commands if c.role not in COMMANDS | BOTH]
    if wrong:
        raise _fail(
            f"'{wrong[0].name}' is called a {wrong[0].role.value}, which is the role of "
            f"{'a command' if wrong[0].role in COMMANDS else 'a reading'}",
            "the role was taken from the wrong side",
            "see itouch.plugin.Role: roles of readings come first, those of commands after them",
        )


def _contact_temperature(bench: TwinBench) -> None:
    """Drive what heats, and check that the reading with the role of skin-contact temperature follows."""
    told = [c.name for c in bench.reads if c.role is Role.SKIN_CONTACT_TEMPERATURE]
    drives = [c for c in bench.commands if c.role in (Role.DRIVE, Role.TEMPERATURE_TARGET) and c.low and c.high]
    if not told or not drives:
        return
    true = [f.name for f in bench.twin.fields() if f.role is Role.SKIN_CONTACT_TEMPERATURE]
    bench.step(100, driven=False)
    others = {c.name for c in bench.reads if c.unit == "K"} - set(told)
    before = {name: float(bench.reading[name][0]) for name in (*told, *others)}
    truth = {name: float(np.ravel(bench.state[name])[0]) for name in true}
    for switch in (c for c in bench.commands if c.role is Role.OUTPUT_SWITCH):
        bench.command[switch.name] = 1.0
    for drive in drives:
        bench.command[drive.name] = _heating(drive)
    bench.step(round(DRIVEN / PERIOD), driven=False)
    gone = {name: float(bench.reading[name][0]) - before[name] for name in before}
    moved = {name: abs(change) for name, change in gone.items()}
    plate = max((abs(float(np.ravel(bench.state[name])[0]) - truth[name]) for name in true), default=0.0)
    still = [name for name in told if moved[name] < max(FOLLOWS, 0.3 * plate)]
    if still:
        other = max(others, key=lambda name: moved[name], default="")
        hint = (
            f"'{other}' changes by {moved[other]:.1f} K" if other and moved[other] > FOLLOWS else "the sensor of a room"
        )
        raise _fail(
            f"'{still[0]}' is called the skin-contact temperature and changes by {moved[still[0]]:.2f} K in "
            f"{DRIVEN:g} s under its drive{f', the plate of its twin by {plate:.1f} K' if true else ''}",
            f"it is the temperature of something else: {hint}",
            "give the role SKIN_CONTACT_TEMPERATURE to the sensor of what the skin touches, and to no other",
        )
    for name in (name for name in told if gone[name] < 0.0):
        raise _fail(
            f"'{name}' is called the skin-contact temperature and falls by {moved[name]:.1f} K in {DRIVEN:g} s under a "
            f"drive that heats",
            "the sensor is connected the wrong way round, or the drive cools where it should heat",
            "a current that is positive cools, unless its range begins at 0: then it is a heater's; turn the sign in "
            "the plugin",
        )


def _heating(drive: Channel) -> NDArray[np.float64]:
    """Return a command that heats: the highest target, half of a heater's range, half of the lowest current."""
    high = np.array(drive.high, np.float64)
    if drive.role is Role.TEMPERATURE_TARGET:
        return high
    return 0.5 * (high if min(drive.low) >= 0.0 else np.array(drive.low, np.float64))
