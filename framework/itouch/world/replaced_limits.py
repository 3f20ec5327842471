"""What another rig under a scene changes in the limits in force: listed by name; what can't apply is dropped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement
from itouch.world.limit_texts import shown
from itouch.world.limits import DEFAULT, ceilings
from itouch.world.rig import DeviceModel, build_devices

#: Limits of a scene's own device that mean nothing for another one without such a command.
_OF_COMMANDS = ("force", "torque", "speed", "current")


def fitted(scene: Scene, catalog: Catalog) -> Scene:
    """Return the scene without those limits of its own devices that the rig's devices keep by themselves.

    A limit above what the rig's device can do, or on a command that it does not have, has no effect; a limit that the
    rig's device would have to keep and can't is kept, and becomes a problem.
    """
    if scene.swapped is None:
        return scene
    own = {device.name: device for device in scene.swapped.devices}
    return replace(scene, devices=tuple(_fitted(scene, one, own.get(one.name), catalog) for one in scene.devices))


def _fitted(scene: Scene, device: DeviceElement, own: DeviceElement | None, catalog: Catalog) -> DeviceElement:
    cls = catalog.device(device.plugin)
    if own is None or cls is None:
        return device
    params = next((part.params for part in device.parts if part.plugin == device.plugin), None)
    try:
        most = ceilings(*cls.channels(cls.Params() if params is None else params))
    except Exception:  # reported when the device is built
        return device
    moot = {name: None for name in _OF_COMMANDS if _is_moot(getattr(own.limits, name), device.limits, name, most)}
    if not moot:
        return device
    limits = replace(device.limits, **moot)
    scene.places.succeed(limits, device.limits)
    found = replace(device, limits=limits)
    scene.places.succeed(found, device)
    return found


def _is_moot(own: float | None, limits: Any, name: str, most: Mapping[str, tuple[Any, str]]) -> bool:
    """Tell whether a limit came from the scene's own device and is one that the rig's device keeps anyway."""
    if own is None or own != getattr(limits, name):
        return False
    return name not in most or (most[name][1] != DEFAULT and own > most[name][0])


def differences(scene: Scene, devices: Mapping[str, DeviceModel], catalog: Catalog) -> Iterator[str]:
    """Yield what does not hold with another rig, and each limit that differs from that of the scene's own device."""
    if scene.swapped is None:
        return
    yield from scene.swapped.notes
    before = replace(scene, devices=scene.swapped.devices, safety=scene.swapped.safety, swapped=None, faults=())
    own = build_devices(before, catalog, [])
    for name, device in devices.items():
        old, new = own[name].limits.table() if name in own else {}, device.limits.table()
        for limit in sorted({*old, *new}) if old else ():
            if old.get(limit) != new.get(limit):
                by = f" ({device.limits.sources.get(limit, DEFAULT)})" if limit in new else ""
                now, was = shown(limit, new.get(limit)), shown(limit, old.get(limit))
                yield f"limit of '{name}' with this rig: {limit.replace('_', '-')} {now}{by}, it was {was}"
