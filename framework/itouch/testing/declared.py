"""Checks of what a device plugin declares: channels, parameters, units, limits, locked axes and documentation."""

from __future__ import annotations

import dataclasses
import math
import sys
from typing import Any

import numpy as np

from itouch.plugin import HOLD, HURTING, ROTATIONS, Channel, Device, Role, Safe
from itouch.plugin.quantity import PLAIN
from itouch.scene import loads, write
from itouch.schema import SceneError
from itouch.schema.fields import PLUGIN_NAMESPACE, Spec, specs, validate, xml_name
from itouch.schema.quantities import format_quantity
from itouch.schema.units import parse_unit
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import DeviceHarness
from itouch.world.limits import WATCHDOG, WATCHDOG_OTHER
from itouch.world.safe_values import acting_at_rest, too_slow


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("declarations", "declared as the contract says")
def declarations(harness: DeviceHarness) -> None:
    """Check ``Params``, ``reads`` and ``commands``."""
    cls = harness.cls
    if not (dataclasses.is_dataclass(getattr(cls, "Params", None)) and cls.Params.__dataclass_params__.frozen):  # type: ignore[attr-defined]
        raise _fail(
            "Params is not a frozen dataclass",
            "@dataclass(frozen=True) is missing",
            "write @dataclass(frozen=True) above Params",
        )
    bare = [f.name for f in dataclasses.fields(cls.Params) if f.name not in specs(cls.Params)]
    if bare:
        raise _fail(
            f"Params has fields that are not schema fields: {', '.join(bare)}",
            "plain defaults instead of schema fields",
            "make them with itouch.plugin.schema: quantity, text, flag, choice, ...",
        )
    reads, commands = cls.channels(harness.require_params())
    for channels in (reads, commands):
        names = [channel.name for channel in channels]
        if len(set(names)) != len(names):
            raise _fail(f"two channels have one name: {names}", "a channel was declared twice", "rename one of them")
    for channel in commands:
        _command(channel)
    for problem in acting_at_rest("unit", commands, None):
        raise _fail(problem.sentence, "the safe value was taken for a value to begin with", problem.advice)
    patience = min((WATCHDOG.get(channel.role, WATCHDOG_OTHER) for channel in commands), default=math.inf)
    if slow := too_slow(cls, patience):
        raise _fail(f"it {slow}", "a period in ms, or a device that is too slow for what it does", "make it faster")
    for text in ("period", "delay"):
        value = getattr(cls, text)
        if not (isinstance(value, (int, float)) and math.isfinite(value) and 0.0 <= value < 10.0):
            raise _fail(f"{text} = {value!r}", f"{text} is in seconds", f"give {text} in seconds, 0 or more")


def _command(channel: Channel) -> None:
    if channel.safe is None:
        raise _fail(
            f"the command '{channel.name}' does not state what is safe",
            "`safe=` was forgotten",
            "give a value, HOLD or RETRACT; zero is safe for a force, not for a pose",
        )
    if not channel.low or not channel.high or any(lo > hi for lo, hi in zip(channel.low, channel.high, strict=True)):
        raise _fail(
            f"the command '{channel.name}' has no limits",
            "`low=` and `high=` were forgotten",
            "give the hardware's ceiling; use wrench(force=...), pose_target(...) or current(limit=...)",
        )
    free = [i for i in range(min(channel.size, 3)) if i not in channel.locked]
    if any(not (math.isfinite(channel.low[i]) and math.isfinite(channel.high[i])) for i in free):
        raise _fail(
            f"the command '{channel.name}' has an endless limit",
            "inf was given for a ceiling",
            "every actuator has a ceiling: give it",
        )
    if isinstance(channel.safe, tuple):
        outside = [i for i, value in enumerate(channel.safe) if not channel.low[i] <= value <= channel.high[i]]
        if outside:
            raise _fail(
                f"the safe value of '{channel.name}' is outside of its own limits",
                "units, or a sign",
                "make low <= safe <= high",
            )
    elif channel.safe is HOLD and channel.role in HURTING - {Role.SURFACE_POSE, Role.TEMPERATURE_TARGET}:
        raise _fail(
            f"the command '{channel.name}', a {channel.role.value}, is held when the device must be safe",
            "HOLD was given for a drive",
            "what acts by its size is safe at 0, or at the least that it can be",
        )
    elif not isinstance(channel.safe, Safe):
        raise _fail(
            f"safe = {channel.safe!r} of '{channel.name}'",
            "neither a value nor HOLD nor RETRACT",
            "give a tuple of numbers, HOLD or RETRACT",
        )


@check("documentation", "class, parameters, module say what they are")
def documentation(harness: DeviceHarness) -> None:
    """Check that there are docstrings, and a ``doc=`` for every parameter."""
    cls = harness.cls
    own = cls.__dict__.get("__doc__")
    if not own or own == Device.__doc__:
        raise _fail("the device class has no docstring", "not written yet", "say in a line what the device is")
    inner = ("child", "children", "plugin")  # these have documented classes of their own
    silent = [xml_name(name) for name, spec in specs(cls.Params).items() if not spec.doc and spec.kind not in inner]
    if silent:
        raise _fail(
            f"parameters without a word: {', '.join(silent)}",
            "`doc=` was forgotten",
            'the reference and the editors show it: write doc="..."',
        )
    module = sys.modules.get(cls.__module__)
    if module is not None and not (module.__doc__ or "").strip():
        raise _fail(f"the module {module.__name__} has no docstring", "not written yet", "say what the module is for")


@check("parameters", "units, ranges and misspellings are checked")
def parameters(harness: DeviceHarness) -> str | None:
    """Load scenes in which each parameter is right, misspelt, out of range, or has a wrong unit."""
    params = harness.require_params()
    catalog, scene = harness.catalog, harness.scene()
    try:
        again = loads(write(scene).encode(), catalog)
    except SceneError as error:
        raise _fail(
            f"its own parameters are refused when they are read back:\n{error}",
            "a default that is outside of its own range",
            "check the ranges of Params",
        ) from error
    if again.devices[0].parts and again.devices[0].parts[0].params != params:
        raise _fail(
            "parameters change when they are written and read again",
            "a value that no unit can carry",
            "use schema.quantity with the SI unit",
        )
    count = 0
    try:
        validate(params)
    except ValueError as error:
        raise _fail(
            f"its own parameters are refused: {error}",
            "a default that is outside of its own range",
            "check low= and high= of Params",
        ) from error
    for name, spec in specs(harness.cls.Params).items():
        _misspelt(harness, name)
        count += 1
        if spec.kind == "quantity" and spec.scalar:
            _ranged(harness, name, spec)
    if not count:
        raise NotApplicableError("it has no parameters")
    return f"{count} parameters"


def _document(harness: DeviceHarness, attributes: dict[str, str]) -> bytes:
    from xml.sax.saxutils import quoteattr

    given = dict(attributes)
    for name in specs(harness.cls.Params):
        label = xml_name(name)
        if label in harness.needed and label not in given:
            given[label] = _written(harness.params, name)
    text = " ".join(f"{key}={quoteattr(value)}" for key, value in given.items())
    return (
        f'<itouch version="1.0" xmlns:p="{PLUGIN_NAMESPACE}{harness.name}"><devices>'
        f'<device name="unit" plugin="{harness.name}"><p:hardware {text}/></device></devices></itouch>'
    ).encode()


def _written(params: Any, name: str) -> str:
    spec, value = specs(type(params))[name], getattr(params, name)
    return format_quantity(value, spec.unit) if spec.kind == "quantity" else str(value)


def _problems(harness: DeviceHarness, attributes: dict[str, str]) -> str:
    try:
        loads(_document(harness, attributes), harness.catalog)
    except SceneError as error:
        return str(error)
    return ""


def _misspelt(harness: DeviceHarness, name: str) -> None:
    wrong = xml_name(name) + "x"
    if wrong in {xml_name(other) for other in specs(harness.cls.Params)}:
        return
    if wrong not in _problems(harness, {wrong: "1"}):
        raise _fail(
            f"the misspelt parameter '{wrong}' is not reported",
            "Params takes anything",
            "declare each parameter as a schema field",
        )


def _ranged(harness: DeviceHarness, name: str, spec: Spec) -> None:
    label, unit = xml_name(name), spec.unit
    for end, beyond in ((spec.low, -1.0), (spec.high, 1.0)):
        if math.isfinite(end):
            value = end + beyond * max(1.0, abs(end))
            if not _problems(harness, {label: f"{value!r} {unit}".strip()}):
                raise _fail(
                    f"{label} = {value:g} {unit} is accepted",
                    "the range is not checked",
                    "give low= and high= to schema.quantity",
                )
    if unit and not _problems(harness, {label: "1 kg*A" if unit != "kg*A" else "1 m"}):
        raise _fail(f"{label} takes a unit of another kind", "the unit is not checked", "use schema.quantity(unit)")


@check("units", "channels are in SI units, times in seconds")
def units(harness: DeviceHarness) -> None:
    """Check the unit of every channel, and the times that the class declares."""
    cls = harness.cls
    reads, commands = cls.channels(harness.require_params())
    for channel in (*reads, *commands):
        try:
            unit = parse_unit(channel.unit) if channel.unit and channel.unit not in PLAIN else None
        except ValueError as error:
            raise _fail(
                f"the channel '{channel.name}' is in '{channel.unit}', which is not a unit",
                "a misspelling, or a word",
                "write it as in m/s^2, N*m or W/m^2; a number without a unit has '1'",
            ) from error
        if unit is not None and (unit.factor != 1.0 or unit.offset):
            raise _fail(
                f"the channel '{channel.name}' is in {channel.unit}",
                "the device's own unit",
                "declare the SI unit (m, N, K, A, ...), and convert in read and write",
            )
        if channel.unit == "K" and channel.high and max(channel.high) < 200.0:
            raise _fail(
                f"'{channel.name}' is limited to {max(channel.high):g} K",
                "degrees Celsius",
                "limits are kelvin: add 273.15",
            )
    times = {"period": 2.0, "delay": 2.0, "exchange_time": 2.0, "watchdog": 30.0}
    for name, most in times.items():
        value = getattr(cls, name)
        if isinstance(value, (int, float)) and value > most:
            raise _fail(f"{name} = {value:g} s", "milliseconds", f"give {name} in seconds")


@check("limits-of-params", "a limit among the parameters is kept")
def limits_of_params(harness: DeviceHarness) -> str:
    """Lower each parameter that is named like a limit, and check that the channels with its unit follow."""
    params, seen = harness.require_params(), []
    for name, spec in specs(harness.cls.Params).items():
        called = name.split("_")
        if spec.kind != "quantity" or not spec.scalar or not {"max", "limit", "maximum", "ceiling"} & set(called):
            continue
        given = getattr(params, name)
        low = spec.low if math.isfinite(spec.low) and spec.low > 0.0 else 0.5 * given if given else 0.0
        for channel in harness.cls.channels(params)[1]:
            if channel.unit == spec.unit and channel.high and low:
                lowered = dataclasses.replace(params, **{name: low})
                _follows(harness, channel, lowered, xml_name(name), low)
                seen.append(name)
    if not seen:
        raise NotApplicableError("no parameter is called a limit of a command")
    return ", ".join(sorted(set(seen)))


def _follows(harness: DeviceHarness, channel: Channel, lowered: Any, label: str, value: float) -> None:
    after = next((c for c in harness.cls.channels(lowered)[1] if c.name == channel.name), None)
    free = [i for i in range(min(channel.size, 3)) if i not in channel.locked]
    if after is not None and free and max(after.high[i] for i in free) > value and after.high == channel.high:
        raise _fail(
            f"with {label}=\"{value:g} {channel.unit}\" '{channel.name}' still goes up to {max(after.high):g}",
            "the channels do not depend on the parameter",
            "make them of the parameters: override `channels(cls, params)`",
        )


@check("locked-axes", "readings and commands lock the same axes")
def locked_axes(harness: DeviceHarness) -> None:
    """Compare the locked axes of pose, wrench and pose target."""
    reads, commands = harness.cls.channels(harness.require_params())
    poses = [c for c in reads if c.role is Role.TRACKED_POSE]
    for channel in (*reads, *commands):
        if any(axis not in range(6) for axis in channel.locked):
            raise _fail(
                f"'{channel.name}' locks axes {channel.locked}",
                "axes are numbered 0 to 5",
                "0..2 are x y z, 3..5 the rotations",
            )
    for pose in poses:
        for channel in commands:
            if channel.role not in (Role.FORCE_ON_OPERATOR, Role.SURFACE_POSE):
                continue
            missing = set(pose.locked) - set(channel.locked)
            if missing:
                raise _fail(
                    f"the pose locks axes {sorted(missing)}, '{channel.name}' does not",
                    "locked= was given to one of them only",
                    "give both the same locked axes",
                )
            if channel.role is Role.FORCE_ON_OPERATOR and set(ROTATIONS) <= set(channel.locked) and channel.high:
                torque = np.abs(np.array(channel.high[3:]))
                if torque.any():
                    raise _fail(
                        "a wrench with locked rotations has torque limits",
                        "torque= and locked= disagree",
                        "omit torque=",
                    )
