"""Virtual coupling: the stiffness that is stable on a device, K <= 2 (b - B) / T, and its own limit.

``b`` is the damping of device and hand, ``B`` that of the material, ``T`` the servo period (Colgate and Brown 1994,
for a virtual wall).  B is lowered before K; a notice tells what is rendered instead when the scene is compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from itouch.contact.surface_effects import Effects
from itouch.scene.elements import ContactMaterial, Probe
from itouch.world.rig import DeviceModel

#: Stiffness [N/m] for a device that states neither its damping nor its greatest stiffness.
UNSTATED_STIFFNESS = 500.0


class Coupling(NamedTuple):
    """Stiffness [N/m] and damping [N s/m] rendered for one object."""

    stiffness: float
    damping: float


def couplings(
    probe: Probe,
    arm: DeviceModel | None,
    materials: Sequence[ContactMaterial],
    names: Sequence[str],
    period: float,
    notices: list[str],
) -> tuple[Coupling, ...]:
    """Return the coupling for each object, and add a notice where it differs from the material."""
    found, told = [], set()
    ceiling, damping, unstated = _arm_limits(probe, arm)
    if unstated and arm is not None and materials:
        notices.append(
            f"device '{arm.name}' states neither its damping nor its greatest stiffness; "
            f"rendering at most {UNSTATED_STIFFNESS:g} N/m"
        )
    for material, name in zip(materials, names, strict=True):
        coupling = stable(material.stiffness, material.damping, damping, ceiling, period)
        if arm is not None and name not in told and coupling != (material.stiffness, material.damping):
            told.add(name)
            notices.append(_notice(probe, arm, name, material, coupling, period))
        found.append(coupling if arm is not None else Coupling(material.stiffness, material.damping))
    return tuple(found)


def _arm_limits(probe: Probe, arm: DeviceModel | None) -> tuple[float, float, bool]:
    if arm is None:
        return float("inf"), float("inf"), False
    stiffness, damping = arm.cls.max_stiffness, arm.cls.damping
    unstated = stiffness is None and damping is None
    ceiling = UNSTATED_STIFFNESS if unstated else stiffness if stiffness is not None else float("inf")
    return ceiling, probe.hand_damping + (damping or 0.0), unstated


def relied(probe: Probe, tracker: DeviceModel | None, arm: DeviceModel | None) -> float | None:
    """Return the damping of hand and arm [N s/m] to rely on if a wire makes pose or force late; None: no wire does."""
    late = any(device is not None and device.wire for device in (tracker, arm))
    return _arm_limits(probe, arm)[1] if arm is not None and late else None


#: Greatest K T^2 / m and B T / m for a free body of mass m under several fingers, its rotation included.
BODY_STIFFNESS, BODY_DAMPING = 0.2, 0.1


def on_bodies(
    coupling: Sequence[Coupling], objects: Sequence[Any], ease: Sequence[float], period: float, notices: list[str]
) -> tuple[Coupling, ...]:
    """Return the couplings, lowered for light rigid bodies to what the time step of their motion allows.

    ``ease`` says of each object what share of its shape's inertia its own is: a body that turns the more easily gives
    way at its edge like a lighter one.
    """
    found = []
    for own, element, share in zip(coupling, objects, ease, strict=True):
        if element.dynamics is None:
            found.append(own)
            continue
        mass = element.dynamics.mass
        felt = mass * min(share, 1.0)
        stiffness = min(own.stiffness, BODY_STIFFNESS * felt / period**2)
        lowered = Coupling(stiffness, min(own.damping, BODY_DAMPING * felt / period))
        if lowered != own:
            why = f"is too light, {mass * 1e3:g} g," if share >= 1.0 else "has too small an inertia"
            notice = (
                f"object '{element.name}' {why} for its material at {1 / period:g} Hz; "
                f"rendering {lowered.stiffness:g} N/m and {lowered.damping:g} N s/m"
            )
            if notice not in notices:
                notices.append(notice)
        found.append(lowered)
    return tuple(found)


def stable_effects(
    probe: Probe,
    arm: DeviceModel | None,
    effects: Sequence[Effects],
    coupling: Sequence[Coupling],
    names: Sequence[str],
    period: float,
    notices: list[str],
) -> tuple[Effects, ...]:
    """Return the effects, viscosities lowered with a notice to what the coupling leaves: K T / 2 + viscosity <= b."""
    if arm is None:
        return tuple(effects)
    _, damping, _ = _arm_limits(probe, arm)
    found: list[Effects] = []
    told = set()
    for own, spring, name in zip(effects, coupling, names, strict=True):
        room = max(0.0, damping - spring.stiffness * period / 2)
        if own.viscosity > room and name not in told:
            told.add(name)
            notices.append(
                f"the viscosity of material '{name}', {own.viscosity:g} N s/m, exceeds what '{arm.name}' can render "
                f"stably to '{probe.name}' beside its stiffness; rendering {room:g} N s/m"
            )
        found.append(replace(own, viscosity=min(own.viscosity, room)))
    return tuple(found)


def stable(stiffness: float, material_damping: float, damping: float, ceiling: float, period: float) -> Coupling:
    """Return the coupling with K <= 2 (b - B) / T and K <= ceiling: B is lowered first, then K.

    ``stiffness`` and ``ceiling`` [N/m]; ``material_damping``: B [N s/m]; ``damping``: b [N s/m]; ``period``: T [s].
    """
    wanted = min(stiffness, ceiling)
    room = damping - wanted * period / 2
    lowered = min(material_damping, max(0.0, room))
    return Coupling(min(wanted, 2 * (damping - lowered) / period), lowered)


def _notice(
    probe: Probe, arm: DeviceModel, name: str, material: ContactMaterial, coupling: Coupling, period: float
) -> str:
    return (
        f"material '{name}' with stiffness {material.stiffness:g} N/m and damping {material.damping:g} N s/m exceeds "
        f"what '{arm.name}' can render stably to '{probe.name}' at {1 / period:g} Hz; "
        f"rendering {coupling.stiffness:g} N/m and {coupling.damping:g} N s/m"
    )
