"""Who moves the finger of a probe: the scene's operator, a person who leads the operator's hand, or a recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from itouch.plugin import poses
from itouch.scene import Scene
from itouch.scene.elements import Operator, Probe
from itouch.schema import Problem
from itouch.world.rig import DeviceModel

Vector = tuple[float, float, float]
#: Input sources with which a person leads a hand.
PERSON = ("mouse", "keyboard", "gamepad")


def hand_of(
    scene: Scene, probe: Probe, devices: Mapping[str, DeviceModel], problems: list[Problem]
) -> tuple[Operator | None, Vector]:
    """Return the operator of a probe, and where its hand begins if it has no motion, in the world [m].

    An arm that a person leads needs a hand: if the scene has no operator, one with the defaults is made for the first
    probe on that arm; the other probes are on the same finger.
    """
    operator = next((o for o in scene.operators if o.probe == probe.name), None)
    arm = devices.get(probe.pose_from)
    if arm is None or arm.cls.input_source not in (*PERSON, "recording"):
        return operator, (0.0, 0.0, 0.0)
    if arm.cls.input_source == "recording":
        if operator is not None and (operator.motion.targets or operator.motion.file):
            sentence = f"probe '{probe.name}' follows the recording of '{arm.name}', and its operator has a motion too"
            problems.append(Problem("exclusive", sentence, scene.places.of(operator.motion), "remove one of them"))
        return None, (0.0, 0.0, 0.0)
    start = np.array(getattr(arm.params, "start", (0.0, 0.0, 0.0)), np.float64)
    mine = [other.name for other in scene.probes if other.pose_from == probe.pose_from]
    led = [o.probe for o in scene.operators if o.probe in mine] or mine
    if probe.name != led[0]:
        return operator, (0.0, 0.0, 0.0)
    x, y, z = poses.transform(np.array(arm.mount), start).tolist()
    return operator or Operator(probe=probe.name), (x, y, z)
