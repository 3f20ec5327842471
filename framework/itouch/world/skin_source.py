"""The source of a finger's skin temperature, found by role: a sensor of it, or else a twin.

Also the rule by which the skin counts as recovered, for a script's ``hold="until skin ..."`` and for a study's trials.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from itouch.plugin import Role
from itouch.scene.elements import Operator, Probe
from itouch.schema import Problem
from itouch.schema.hold_until import SKIN, WORD, Until
from itouch.world.rig import DeviceModel, carriers_of

#: For the recovery of skin: averaging time [s] of the baseline at the session's start, averaging time [s] of the skin
#: now, and longest wait for it [s].
BASELINE, WINDOW, LONGEST = 1.0, 0.1, 60.0


class Finger(Protocol):
    """What must be known of a probe here: its element, who moves it, and the device that it meets."""

    @property
    def name(self) -> str:
        """The probe's name."""

    @property
    def scene(self) -> Probe:
        """Its element."""

    @property
    def operator(self) -> Operator | None:
        """The operator twin that moves it; None: there is none."""

    @property
    def touched_device(self) -> str:
        """Name of the device on its table that it touches; empty: none."""


class CompiledScene(Protocol):
    """What must be known of a compiled scene here."""

    @property
    def scene(self) -> Any:
        """The scene."""

    @property
    def probes(self) -> Sequence[Finger]:
        """Its probes."""

    @property
    def devices(self) -> Mapping[str, DeviceModel]:
        """Its devices by name."""

    def worn(self, probe: Any) -> tuple[DeviceModel, ...]:
        """Return the twins worn on the operator's finger of a probe."""


@dataclass(frozen=True, slots=True)
class SkinSource:
    """The field of State with the skin's temperature [K], and the one that says whether it is valid (empty: always).

    ``sensed``: a device measures it; else a twin tells it.
    """

    field: str
    valid: str = ""
    sensed: bool = True


def is_back(skin: float, baseline: float, within: float) -> bool:
    """Tell whether a skin temperature [K] has recovered to within ``within`` [K] of its baseline [K]."""
    return abs(skin - baseline) <= within


def sensed_skin(model: CompiledScene, probe: Finger) -> SkinSource | None:
    """Return the reading of the skin of a probe's finger; None: no device measures it."""
    for device in devices_at(probe, model.probes, model.devices):
        if field := device.field(Role.SKIN_TEMPERATURE):
            return SkinSource(field, device.field(Role.SKIN_VALID))
    return None


def skin_of(model: CompiledScene, probe: Finger) -> SkinSource | None:
    """Return the source of the skin temperature of a probe's finger: a sensor, else a twin; None: there is none."""
    sensed = sensed_skin(model, probe)
    if sensed is not None:
        return sensed
    leader = next((one for one in model.probes if _same(one, probe) and model.worn(one)), None)
    if leader is not None:
        return SkinSource(f"{leader.name}.skin", sensed=False)
    for device in devices_at(probe, model.probes, model.devices):
        own = device.twin_fields() if device.twin else ()
        if field := next((one.name for one in own if one.role is Role.SKIN_TEMPERATURE), ""):
            return SkinSource(f"{device.name}.twin.{field}", sensed=False)
    return None


def waits_without_skin_reading(model: CompiledScene) -> Iterator[Problem]:
    """Find waits for a skin whose temperature nothing tells."""
    for probe in model.probes:
        if probe.operator is None:
            continue
        waits = [target for target in probe.operator.motion.targets if isinstance(target.hold, Until)]
        if waits and skin_of(model, probe) is None:
            sentence = f"nothing tells how warm the skin of '{probe.name}' is, so no motion can wait for it"
            advice = (
                "put a device under the finger that reads it (role SKIN_TEMPERATURE) or whose twin has a skin, or hold "
                f"for a time in place of '{WORD} {SKIN}'"
            )
            yield Problem("missing-channel", sentence, model.scene.places.of(waits[0], "hold"), advice)


def _same(one: Finger, other: Finger) -> bool:
    return one.scene.pose_from == other.scene.pose_from


def devices_at(probe: Finger, probes: Sequence[Finger], devices: Mapping[str, DeviceModel]) -> list[DeviceModel]:
    """Return the devices at a probe's finger: its plate, those on its devices, then those at no other finger."""
    mine = {name for one in probes if _same(one, probe) for name in _bound(one)}
    others = {name for one in probes if not _same(one, probe) for name in _bound(one)} - mine
    carriers = {name: {name, *carriers_of(devices, device)} for name, device in devices.items()}
    on_it = [name for name in devices if carriers[name] & mine]
    free = [name for name in devices if not carriers[name] & (mine | others)]
    listed = [name for name in (probe.touched_device, *on_it, *free) if name in devices]
    return [devices[name] for name in dict.fromkeys(listed)]


def _bound(probe: Finger) -> tuple[str, ...]:
    named = (probe.scene.pose_from, probe.scene.force_to, probe.scene.surface_to, probe.touched_device)
    return tuple(name for name in named if name)


def window_ticks(period: float) -> tuple[int, int, int]:
    """Return `BASELINE`, `WINDOW` and `LONGEST` in ticks of a period [s]."""
    baseline, window, longest = (max(1, math.ceil(seconds / period - 1e-9)) for seconds in (BASELINE, WINDOW, LONGEST))
    return baseline, window, longest
