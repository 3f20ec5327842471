"""``itouch-py devices``: the installed device plugins, with channels and limits, and why a plugin failed to load."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from itouch.plugin import Channel, Device, Safe
from itouch.plugin.discovery import Catalog
from itouch.schema.fields import REQUIRED, default_of, specs
from itouch.schema.plugin_errors import error_text
from itouch_tools.cli.arguments import Parser, add_json, as_json


def main(argv: Sequence[str]) -> int:
    """List the device plugins that are installed."""
    parser = Parser(prog="itouch-py devices", description=main.__doc__)
    parser.add_argument("--probe", action="store_true",
                        help="look for what is attached, and say why it cannot be used")  # fmt: skip
    add_json(parser)
    options = parser.parse_args(argv)
    catalog = Catalog()
    if options.json:
        print(as_json({"devices": [_entry(catalog, name, probe=options.probe) for name in catalog.device_names]}))
        return 0
    for name in catalog.device_names:
        print("\n".join(_describe(catalog, name)))
        cls = catalog.device(name) if options.probe else None
        if cls is not None:
            print("\n".join(_probe(cls)))
    if not catalog.device_names:
        print("no device plugin is installed")
    return 0


def _probe(cls: type[Device]) -> list[str]:
    """Return lines that say what is attached; where a plugin fails to look, a line says so and the others go on."""
    try:
        found = cls.discover()
    except Exception as error:  # a plugin may raise anything, and must not hide the others
        return [f"    looking failed: {type(error).__name__}: {error}"]
    if found is None:
        return ["    attached: cannot be looked for"]
    if not found:
        return ["    attached: none"]
    return [f"    attached: {one.where}: {'usable' if one.usable else 'NOT USABLE'}: {one.note}" for one in found]


def _entry(catalog: Catalog, name: str, *, probe: bool) -> dict[str, Any]:
    """Return a device plugin as plain data; infinite bounds are null."""
    found, cls = catalog.found(name), catalog.device(name)
    entry: dict[str, Any] = {"name": name, "distribution": found.distribution, "version": found.version}
    if cls is None:
        return entry | {"failed": catalog.failures[name].cause}
    try:
        reads, commands = _channels(cls)
    except (Exception, SystemExit) as error:  # a plugin may raise anything, and must not hide the others
        return entry | {"failed": error_text(error)}
    entry |= {"twin_only": cls.twin_only, "reads": [*map(_data, reads)], "commands": [*map(_data, commands)]}
    return entry | ({"attached": [line.strip() for line in _probe(cls)]} if probe else {})


def _data(channel: Channel) -> dict[str, Any]:
    def bounds(values: Sequence[float]) -> list[float | None]:
        return [float(value) if math.isfinite(value) else None for value in values]

    return {
        "name": channel.name, "size": channel.size, "unit": channel.unit, "role": channel.role.name.lower(),
        "doc": channel.doc, "low": bounds(channel.low), "high": bounds(channel.high),
        "locked": list(channel.locked),
    }  # fmt: skip


def _describe(catalog: Catalog, name: str) -> list[str]:
    found = catalog.found(name)
    head = f"{name}  ({found.distribution} {found.version})"
    cls = catalog.device(name)
    if cls is None:
        return [f"{head}  FAILED TO LOAD", f"    {catalog.failures[name].cause}"]
    doc = (cls.__doc__ or "").strip().splitlines()[:1]
    lines = [f"{head}{'  twin only' if cls.twin_only else ''}", *(f"    {line}" for line in doc)]
    try:
        reads, commands = _channels(cls)
    except (Exception, SystemExit) as error:  # as above
        return [*lines, f"    FAILS with its default parameters: {error_text(error)}"]
    lines += [_channel("reads", channel) for channel in reads]
    lines += [_channel("obeys", channel) for channel in commands]
    return lines


def _channels(cls: type[Device]) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
    """Return readings and commands with default parameters, or the class's own if a parameter has no default."""
    if any(default_of(cls.Params, field) is REQUIRED for field in specs(cls.Params)):
        return cls.reads, cls.commands
    return cls.channels(cls.Params())


def _channel(verb: str, channel: Channel) -> str:
    parts = [f"    {verb} {channel.name:<18} {channel.size} x {channel.unit or '1'}"]
    if channel.magnitude is not None:
        parts.append(f"at most {channel.magnitude:g} {channel.shown_unit}".rstrip())
    elif channel.high and all(math.isfinite(v) for v in (*channel.low, *channel.high)):
        shown = min(channel.size, 3)
        low, high = (" ".join(f"{v:g}" for v in side[:shown]) for side in (channel.low, channel.high))
        parts.append(f"{low} to {high} {channel.shown_unit}".rstrip())
    if channel.locked:
        parts.append("locked: " + " ".join(["x", "y", "z", "rx", "ry", "rz"][axis] for axis in channel.locked))
    if channel.safe is not None:
        parts.append(f"safe: {channel.safe.value if isinstance(channel.safe, Safe) else 'zero'}")
    return ", ".join(parts)
