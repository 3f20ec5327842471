"""Surfaces that a modality brings to a finger in the place of the framework's way: is what it says of them so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from itouch.plugin import Carries, Role
from itouch.scene import Scene
from itouch.scene.elements import PluginPart
from itouch.schema import Problem
from itouch.world.rig import DeviceModel

#: Attributes of a probe that say how the framework itself carries a surface.
_OWN = ("clearance", "plate_angle")
#: Kind and size of a field that holds one number.
_ONE = (("f8", 0), ("f8", 1), ("i8", 0), ("i8", 1))


def check_carried(
    scene: Scene, part: PluginPart, carries: Carries, fields: Mapping[str, object], commands: Sequence[str],
    devices: Mapping[str, DeviceModel], every: int,
) -> Iterator[Problem]:  # fmt: skip
    """Find what keeps a modality from carrying the surface that it says it carries; ``fields``: kinds and sizes."""
    who, place = f"modality '{part.name}'", scene.places.of(part)
    probe = next((one for one in scene.probes if one.name == carries.probe), None)
    if probe is None or probe.surface_to != carries.device:
        found = "there is no such probe" if probe is None else f"its surface-to is '{probe.surface_to}'"
        sentence = f"{who} carries the surface of '{carries.device}' to probe '{carries.probe}', but {found}"
        advice = f'write surface-to="{carries.device}" at the probe that the modality names'
        yield Problem("modality", sentence, place, advice)
        return
    device = devices.get(carries.device)
    channel = device.command(Role.SURFACE_POSE) if device is not None else None
    if channel is not None and f"{carries.device}.{channel.name}" not in commands:
        sentence = f"{who} carries the surface of '{carries.device}', but does not command '{channel.name}'"
        yield Problem("modality", sentence, place, f"its commands must have {carries.device}.{channel.name}")
    for name in carries[2:]:
        if fields.get(name) not in _ONE:
            sentence = (
                f"{who} says how its surface stands in field '{name}', which it does not declare as one number (f8)"
            )
            yield Problem("modality", sentence, place, f"it declares {', '.join(fields) or 'none'}")
    if every != 1:
        sentence = f"{who} carries a surface, which moves in every tick, but is updated in one of {every}"
        yield Problem("modality", sentence, place, "leave its rate out of <rates>")
    for name in _OWN:
        written = scene.places.of(probe, name)
        if written is not None and written != scene.places.of(probe):
            shown = name.replace("_", "-")
            sentence = f"{shown} of probe '{probe.name}' has no effect: {who} carries its surface"
            yield Problem("modality", sentence, written, f"remove {shown}", severity="warning")
