"""Which devices act on which finger; a finger is what one device tracks, however many probes it has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from itouch.loop.device_runner import Runner
from itouch.loop.probe_rig import ProbeRig
from itouch.monitors.surface_kernels import FingerAbove, rise
from itouch.plugin import Role
from itouch.safety import Finger
from itouch.world.rig import carriers_of


def fingers(runners: Mapping[str, Runner], rigs: Sequence[ProbeRig]) -> Iterator[tuple[Finger, list[Runner]]]:
    """Yield each finger on which devices act, together with these devices.

    A device that is mounted, directly or through others, on one that tracks or acts on a finger is on that finger.  A
    display that no such device carries and that no probe names is taken to be on every finger.
    """
    trackers = list(dict.fromkeys(rig.tracker.model.name for rig in rigs))
    named = {one.model.name for rig in rigs for one in (rig.arm, rig.table) if one is not None}
    devices = {name: runner.model for name, runner in runners.items()}
    chains = {name: {*carriers_of(devices, device)} for name, device in devices.items()}
    somewhere = {*trackers, *named}
    acting = {name: one for name, one in runners.items() if one.gate.heats or one.gate.presses}
    pushing = {name: one for name, one in runners.items() if one.model.command(Role.FORCE_ON_OPERATOR) is not None}
    free = [one for name, one in acting.items() if not {name, *chains[name]} & somewhere]
    for tracker in trackers:
        mine = [rig for rig in rigs if rig.tracker.model.name == tracker]
        found = [one for rig in mine for one in (rig.arm, rig.table) if one is not None]
        carriers = {tracker, *(one.model.name for one in found)}
        found += [one for name, one in runners.items() if carriers & chains[name]]
        found += [acts[tracker] for acts in (acting, pushing) if tracker in acts]
        nearing = {rig.table.model.name: rig.contact_step.nearing for rig in mine if rig.table is not None}
        yield from _finger(mine[0].probe.name, [*found, *free], nearing)
    if not trackers:
        yield from _finger("", free, {})


def join_fingers(rigs: Sequence[ProbeRig]) -> None:
    """Let all probes that one device tracks act on one finger: the operator twin's, where one of them has an operator.

    A probe with an operator of its own does not join another's.
    """
    led: list[Runner] = []
    for rig in rigs:
        mine = [other for other in rigs if other.tracker is rig.tracker]
        if rig.coupling.hand is not None and rig.tracker not in led:
            led.append(rig.tracker)
            others = [other for other in mine if other.probe.operator is None]
            rig.coupling.join([(one.coupling, one.arm if one.arm is not rig.tracker else None) for one in others])


def _finger(
    name: str, devices: Sequence[Runner], nearing: Mapping[str, FingerAbove]
) -> Iterator[tuple[Finger, list[Runner]]]:
    listed = list({one.model.name: one for one in devices}.values())
    finger = Finger(name, [one.gate for one in listed], nearing)
    for near in nearing.values():
        rise(near, 0.0)  # called once now, so that no tick has to compile it
    for arm in finger.arms:
        arm.actuation.leave_room = partial(finger.reduce, arm)
    if not finger.alone:
        yield finger, listed
