"""Whether a scene's parts fit together: needed channels, locked axes, one writer for each command, reach, tilts."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from itouch.monitors.default_limits import SPEED, SPEED_NEAR
from itouch.plugin import Role, poses
from itouch.scene import Scene
from itouch.scene.elements import Capsule, Probe
from itouch.schema import Place, Problem
from itouch.schema.diagnostics import did_you_mean
from itouch.schema.fields import specs
from itouch.world.presented_surfaces import touched_device_of
from itouch.world.rig import DeviceModel

_LINEAR = (0, 1, 2)
_UP = np.array([0.0, 0.0, 1.0])
#: How far a surface's z axis may be tilted [rad]: moved sideways, it then rises no faster than it may near a finger.
MOST_TILT = math.asin(SPEED_NEAR / SPEED)
#: How far a face may be tilted on its carrier [rad]: the edge of one of 40 mm is then 0.7 mm off, less than the
#: millimetre from which a plate is taken for one at a wrong height.
MOST_UNEVEN = math.radians(2.0)


def check_bindings(scene: Scene, devices: Mapping[str, DeviceModel]) -> Iterator[Problem]:
    """Find references to devices that lack the needed channels, or that can only command locked degrees of freedom."""
    missing = {device.name for device in scene.devices if device.optional and device.name not in devices}
    yield from _uncarried(scene, missing)
    for probe in scene.probes:
        yield from _untracked(scene, probe, missing)
        yield from _channels(scene, probe, f"probe '{probe.name}'", devices)
        yield from _locked(scene, probe, "force_to", Role.FORCE_ON_OPERATOR, devices)
        yield from _locked(scene, probe, "surface_to", Role.SURFACE_POSE, devices)
        yield from _tilted(scene, probe, devices)
        yield from _uneven(scene, probe, devices)
        yield from _met_by_its_tracker(scene, probe, devices)
    for element in scene.objects:
        yield from _channels(scene, element, f"object '{element.name}'", devices)
    for part in scene.modalities:
        yield from _channels(scene, part.params, f"modality '{part.name}'", devices)
    yield from _operators(scene)


def _untracked(scene: Scene, probe: Probe, missing: Collection[str]) -> Iterator[Problem]:
    """Find a probe whose tracker is ``missing``: a session can't go on without it, even if it is optional."""
    if probe.pose_from in missing:
        sentence = f"probe '{probe.name}' is tracked by '{probe.pose_from}', which is missing: it can't do without"
        advice = f"install the plugin of '{probe.pose_from}', or remove the probe"
        yield Problem("missing-channel", sentence, scene.places.of(probe, "pose_from"), advice)


def _met_by_its_tracker(scene: Scene, probe: Probe, devices: Mapping[str, DeviceModel]) -> Iterator[Problem]:
    """Find a probe whose surface is brought by the device that tracks it: finger and surface would be one place."""
    device = devices.get(probe.pose_from)
    if probe.pose_from != probe.surface_to or device is None or device.command(Role.SURFACE_POSE) is None:
        return
    sentence = (
        f"probe '{probe.name}' is tracked by '{device.name}', which also brings it the surface: the finger would be "
        "wherever the surface is"
    )
    advice = "write the device that tracks the finger, such as an arm, as pose-from"
    yield Problem("exclusive", sentence, scene.places.of(probe, "surface_to"), advice)


def _uncarried(scene: Scene, missing: Collection[str]) -> Iterator[Problem]:
    """Find devices that are mounted on a ``missing`` one: nothing tells where they are."""
    for device in scene.devices:
        if device.mount.on in missing and device.name not in missing:
            sentence = f"device '{device.name}' is mounted on '{device.mount.on}', which is missing"
            advice = f"install the plugin of '{device.mount.on}', or remove both"
            yield Problem("missing-channel", sentence, scene.places.of(device.mount, "on"), advice)


def _channels(scene: Scene, element: Any, what: str, devices: Mapping[str, DeviceModel]) -> Iterator[Problem]:
    for name, spec in specs(type(element)).items():
        device = devices.get(getattr(element, name)) if spec.kind == "ref" and spec.target == "device" else None
        if device is None:
            continue
        for kind, wanted, offered in (("reads", spec.reads, device.reads), ("obeys", spec.commands, device.commands)):
            names = [channel.name for channel in offered]
            known: set[object] = {*names, *(channel.role for channel in offered)}
            for channel in wanted:
                if channel not in known:
                    yield _lacking(scene, element, name, what, channel, device, kind, names)


def _lacking(
    scene: Scene, element: Any, name: str, what: str, wanted: object, device: DeviceModel, kind: str, names: list[str]
) -> Problem:
    shown = wanted.value if isinstance(wanted, Role) else f"'{wanted}'"
    sentence = f"{what} needs {shown} of device '{device.name}', which {kind} no such channel"
    advice = did_you_mean(str(shown), names, f"it {kind}") or f"it {kind} nothing"
    return Problem("missing-channel", sentence, scene.places.of(element, name), advice)


def _locked(
    scene: Scene, probe: Probe, field: str, role: Role, devices: Mapping[str, DeviceModel]
) -> Iterator[Problem]:
    device = devices.get(getattr(probe, field))
    channel = device.command(role) if device else None
    if device is not None and channel is not None and set(_LINEAR) <= set(channel.locked):
        sentence = f"probe '{probe.name}' can only command locked degrees of freedom of device '{device.name}'"
        advice = f"'{channel.name}' of '{device.name}' has x, y and z locked; bind a device that moves"
        yield Problem("locked-dof", sentence, scene.places.of(probe, field), advice)


def _tilted(scene: Scene, probe: Probe, devices: Mapping[str, DeviceModel]) -> Iterator[Problem]:
    """Find a surface that is mounted so tilted that it does not rise along its own z, by which speeds are limited."""
    device = devices.get(probe.surface_to)
    if device is None or device.command(Role.SURFACE_POSE) is None:
        return
    up, name, chain = _UP, device.name, list[str]()
    while name in devices and name not in chain:
        chain.append(name)
        up, name = poses.rotate(np.array(devices[name].mount[3:]), up), devices[name].carrier
    tilt = _tilt(up)
    if tilt > MOST_TILT:
        most_turned = max(chain, key=lambda one: _tilt(_upright_of(devices[one])))
        most = math.floor(math.degrees(MOST_TILT) * 10) / 10
        sentence = (
            f"device '{device.name}' is mounted with its z axis {_degrees(tilt)} deg from upright, and probe "
            f"'{probe.name}' brings its surface to a finger: sideways it would rise faster than it may near one (K5)"
        )
        advice = f"mount it with its z axis at most {most:g} deg from upright"
        yield Problem("bad-value", sentence, _turned_at(scene, most_turned), advice)


def _uneven(scene: Scene, probe: Probe, devices: Mapping[str, DeviceModel]) -> Iterator[Problem]:
    """Find a face that is mounted tilted on what carries it: wherever it is used, it is level with its carrier."""
    table = devices.get(probe.surface_to)
    if table is None or table.command(Role.SURFACE_POSE) is None:
        return
    face = devices[touched_device_of(table.name, devices)]
    if face is table or face.surface_half_extents is None:
        return
    tilt = _tilt(_upright_of(face))
    if tilt > MOST_UNEVEN:
        sentence = (
            f"device '{face.name}' is mounted with its face tilted by {_degrees(tilt)} deg on '{table.name}', and "
            f"probe '{probe.name}' touches it there: a carried face lies level on what carries it"
        )
        advice = f"mount it level, at most {math.degrees(MOST_UNEVEN):g} deg off, and tilt '{table.name}' if it must be"
        yield Problem("bad-value", sentence, _turned_at(scene, face.name), advice)


def _upright_of(device: DeviceModel) -> Any:
    """Return the z axis of a device in the frame of what carries it, shape (3,)."""
    return poses.rotate(np.array(device.mount[3:]), _UP)


def _tilt(up: Any) -> float:
    """Return the angle [rad] between a direction, shape (3,), and upright."""
    return math.acos(max(-1.0, min(1.0, float(up[2]))))


def _degrees(angle: float) -> str:
    return f"{round(math.degrees(angle), 1):g}"


def _turned_at(scene: Scene, name: str) -> Place | None:
    """Return where a device is turned, else where it is declared."""
    device = scene.device(name)
    turned = next((one for one in ("rpy", "quat") if scene.places.given(device.mount, one)), None)
    return scene.places.of(device) if turned is None else scene.places.of(device.mount, turned)


def _operators(scene: Scene) -> Iterator[Problem]:
    moved: dict[str, Any] = {}
    tracked: dict[str, Any] = {}
    trackers = {probe.name: probe.pose_from for probe in scene.probes}
    for operator in scene.operators:
        tracker = trackers.get(operator.probe, "")
        leader = tracked.setdefault(tracker, operator) if tracker else operator
        if leader.probe != operator.probe:
            place = scene.places.of(leader)
            related = ((place, "the other"),) if place else ()
            sentence = (
                f"the operators of probes '{leader.probe}' and '{operator.probe}' would both move '{tracker}': "
                "one finger has one operator"
            )
            advice = f"remove one: all probes on '{tracker}' follow the same finger"
            yield Problem("exclusive", sentence, scene.places.of(operator, "probe"), advice, related)
        other = moved.setdefault(operator.probe, operator)
        if other is not operator:
            place = scene.places.of(other)
            related = ((place, "first here"),) if place else ()
            sentence = f"probe '{operator.probe}' has two operators"
            yield Problem("duplicate-element", sentence, scene.places.of(operator, "probe"), "remove one", related)


def check_writers(scene: Scene, writers: list[tuple[str, Any, str, str]]) -> Iterator[Problem]:
    """Find commands with two writers; ``writers`` holds (command, element, attribute, who writes it)."""
    first: dict[str, tuple[Any, str, str]] = {}
    for command, element, attribute, who in writers:
        if command not in first:
            first[command] = (element, attribute, who)
            continue
        other, other_attribute, other_who = first[command]
        place = scene.places.of(other, other_attribute)
        related = ((place, f"{other_who} writes it"),) if place else ()
        sentence = f"'{command}' is written by {other_who} and by {who}"
        yield Problem(
            "two-writers", sentence, scene.places.of(element, attribute), "bind one of them elsewhere", related
        )


def check_fingers(
    scene: Scene, devices: Mapping[str, DeviceModel], writers: list[tuple[str, Any, str, str]]
) -> Iterator[Problem]:
    """Find commands to a device that pushes a finger, or brings a surface to it, while no probe locates that finger.

    Whoever commands it, its monitors would know neither the finger's speed (K2), nor how near it is (K5), nor for how
    long it touches (T4).  ``writers`` as in ``check_writers``.
    """
    blind = unseen(scene, devices)
    for command, element, attribute, who in writers:
        name, _, called = command.partition(".")
        if (name, called) not in blind:
            continue
        sentence = f"{who} commands '{command}', and no probe says where the finger is that '{name}' acts on"
        advice = f"add {blind[name, called]}: what watches the finger goes by it"
        severity = "warning" if devices[name].twin else "error"
        yield Problem("unmonitored-drive", sentence, scene.places.of(element, attribute), advice, severity=severity)


def unseen(scene: Scene, devices: Mapping[str, DeviceModel]) -> dict[tuple[str, str], str]:
    """Return the commands (device, channel) that act on a finger which no probe locates, each with what is missing."""
    tracked = {name for probe in scene.probes for name in (probe.pose_from, probe.force_to)}
    met = {probe.surface_to for probe in scene.probes}
    found = {}
    for name, device in devices.items():
        for channel in device.commands:
            pushes, carries = channel.role is Role.FORCE_ON_OPERATOR, channel.role is Role.SURFACE_POSE
            if (pushes and not tracked & {*_chain(name, devices)}) or (carries and name not in met):
                bound = "surface-to" if carries else "pose-from"
                found[name, channel.name] = f'a probe with {bound}="{name}"'
    return found


def _chain(name: str, devices: Mapping[str, DeviceModel]) -> Iterator[str]:
    """Yield a device, the one that carries it, the one that carries that, and so on."""
    seen: set[str] = set()
    while name in devices and name not in seen:
        seen.add(name)
        yield name
        name = devices[name].carrier


def blind(scene: Scene, devices: Mapping[str, DeviceModel]) -> dict[str, str]:
    """Return the hardware that can't be enabled, because it acts on a finger which no probe locates: name -> sentence.

    Whatever else may command it (a script, another process), its monitors would know nothing of that finger.
    """
    found = {}
    for (name, called), missing in unseen(scene, devices).items():
        channel = next(one for one in devices[name].commands if one.name == called)
        if not devices[name].twin and not channel.harmless.strip():
            found[name] = f"no probe says where the finger is that '{called}' acts on: add {missing}"
    return found


def check_reach(
    scene: Scene, devices: Mapping[str, DeviceModel], boxes: Mapping[str, Any] = MappingProxyType({})
) -> Iterator[Problem]:
    """Warn of objects that the table under a probe can't carry a surface to.

    ``boxes``: object's name -> lower and upper corner of its mesh, in its own frame [m].
    """
    for probe in scene.probes:
        table = devices.get(probe.surface_to)
        target = table.command(Role.SURFACE_POSE) if table else None
        if table is None or target is None or not target.low:
            continue
        face = next((d for d in devices.values() if d.carrier == table.name), None)
        offset = np.array(face.mount[:3]) if face else np.zeros(3)
        low, high = _world_box(
            np.array(table.mount), np.array(target.low[:3]) + offset, np.array(target.high[:3]) + offset
        )
        for element in scene.objects:
            box = extent(element, boxes)
            if box is None:
                continue
            top = box[1][2]
            aside = np.any(box[1][:2] < low[:2]) or np.any(box[0][:2] > high[:2])
            if aside or top < low[2] - 1e-9 or top > high[2] + 1e-9:
                where = (
                    "outside"
                    if aside
                    else f"at height {top * 1e3:g} mm, outside {low[2] * 1e3:g} to {high[2] * 1e3:g} mm of"
                )
                sentence = f"the top of object '{element.name}' is {where} what '{table.name}' can reach"
                # Of this probe alone: another one's table may reach the object.
                touched = f"the contacts of probe '{probe.name}' with it"
                arm = f"only the arm renders {touched}, without heat"
                advice = arm if probe.force_to else f"nothing renders {touched}"
                yield Problem("out-of-reach", sentence, scene.places.of(element), advice, severity="warning")


def _world_box(mount: Any, low: Any, high: Any) -> tuple[Any, Any]:
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    world = np.array([poses.transform(mount, corner) for corner in corners])
    return world.min(axis=0), world.max(axis=0)


def extent(element: Any, boxes: Mapping[str, Any]) -> tuple[Any, Any] | None:
    """Return the axis-aligned extent of a shape in the world: lower and upper corner [m]; None if it has no bounds.

    ``boxes`` as in `check_reach`.
    """
    centre = np.array(element.pos)
    if element.name in boxes:
        try:
            return _world_box(pose_of(element), *boxes[element.name])
        except ValueError:
            return None
    if hasattr(element, "size"):
        try:
            half = np.abs(poses.matrix(pose_of(element)[3:])) @ (np.array(element.size) / 2)
        except ValueError:
            return None
    elif hasattr(element, "length"):
        try:
            along = poses.matrix(pose_of(element)[3:])[:, 2]
        except ValueError:
            return None
        ends = np.ones(3) if isinstance(element, Capsule) else np.sqrt(np.maximum(0.0, 1.0 - along**2))
        half = element.length / 2 * np.abs(along) + element.radius * ends
    elif hasattr(element, "radius"):
        half = np.full(3, element.radius)
    else:
        return None
    return centre - half, centre + half


def pose_of(element: Any) -> Any:
    """Return the pose of an object as the scene has it, shape (7,) [m; quaternion].

    Raises
    ------
    ValueError
        If its quaternion is no orientation.
    """
    quat = element.quat or (poses.quaternion_from_rpy(element.rpy) if element.rpy else (1.0, 0.0, 0.0, 0.0))
    return np.array([*element.pos, *poses.normalized(quat)])
