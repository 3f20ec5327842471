"""Second openers of hardware: drivers that the guardian keeps ready for the servo process's death."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

from itouch.exchange.thread import make_safe
from itouch.plugin import Device, Field, Record
from itouch.plugin.discovery import Catalog
from itouch.plugin.wire_claims import WireClaims
from itouch.safety.actuation import lowest_retreat
from itouch.scene import loads
from itouch.servo.link import Link
from itouch.servo.shared_memory import SharedMemory
from itouch.world import DeviceModel
from itouch.world.rig import build_devices


def openers(segment: SharedMemory, meta: dict[str, Any]) -> dict[str, Callable[[], None]]:
    """Return, for each device that a second process may open, the function that makes it safe from the last State."""
    sys.path[:] = [*sys.path, *(entry for entry in meta["sys_path"] if entry not in sys.path)]
    catalog = Catalog()
    scene = loads(meta["scene_xml"].encode(), catalog, shown=meta["source"])
    models = build_devices(scene, catalog, [])
    link = Link(segment)
    claims = WireClaims()  # the servo process's claims end with it, but until all is safe nobody else may use the wires
    claims.guard(wire for name in meta["second_openers"] for wire in models[name].wires)
    return {name: _act(models[name], link, claims) for name in meta["second_openers"]}


def _act(model: DeviceModel, link: Link, claims: WireClaims) -> Callable[[], None]:
    device: Device = model.cls(model.params)
    command = Record.of(Field.of(channel) for channel in model.commands)

    def act(_held: WireClaims = claims) -> None:
        state = link.state
        for channel in model.commands:
            command[channel.name] = state[f"{model.name}.sent.{channel.name}"]
        make_safe(command, model.commands, _lowest(state, model.name))
        device.make_safe(command)

    return act


def _lowest(state: Record, name: str) -> float:
    """Return the lowest height [m] to which a surface may retract: it may be one that goes the wrong way."""
    if f"{name}.way" not in state:
        return math.nan
    status, stopped, way = (state[f"{name}.{field}"] for field in ("status", "stopped", "way"))
    return lowest_retreat(status.item(), stopped.item(), way[1].item())
