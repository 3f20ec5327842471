"""The objects of a world in motion: moved at the beginning of each tick, before anything is felt."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from itouch.contact.object_motion import carry, move_scripted
from itouch.dynamics.mujoco_link import push_bodies
from itouch.loop import render
from itouch.loop.device_runner import Runner
from itouch.loop.rigid_transforms import Frame, quaternion
from itouch.loop.touch import ContactStep
from itouch.plugin import Record, Role
from itouch.world import Model

#: Time constant [s] of the filter on the velocity of what a device carries.
VELOCITY_FILTER = 0.002


class Objects:
    """Moves scripted and carried objects, and rigid bodies, on their part of State."""

    def __init__(
        self, model: Model, state: Record, runners: Mapping[str, Runner], contact_steps: Sequence[ContactStep]
    ) -> None:
        self._runners = runners
        place = render.CONTACT_FORCE
        self._pushes = [
            (contact_step.figures[place : place + 3], contact_step.result) for contact_step in contact_steps
        ]
        self._physics = model.motions.bodies.make() if model.motions.bodies is not None else None
        self._body_state = state["objects.physics"] if self._physics is not None else np.zeros(0)
        self._forces = np.zeros((len(model.objects), 6))
        self._start = model.poses
        self._motions, self._period = model.motions, model.period
        self._poses, self._twists = state["objects.pose"], state["objects.twist"]
        self._ticks = state["objects.ticks"] if model.moving else np.zeros((), np.int64)
        self._smooth = 1.0 - math.exp(-model.period / VELOCITY_FILTER)
        self._end = math.ceil(model.motions.duration / model.period - 1e-9)
        self._carried = [
            (c.index, runners[c.device], _place_of(runners[c.device]), np.array(c.offset), np.zeros(7))
            for c in model.motions.carried
            if c.device in runners
        ]
        self._placed: dict[int, Frame] = {}
        self._warm_up()

    def reset(self) -> None:
        """Set the rigid bodies to their start."""
        if self._physics is not None:
            self._physics.start(self._body_state)

    def restore(self) -> None:
        """Forget the frames of devices, so that they are found anew, and take over bodies as State has them."""
        self._placed.clear()
        if self._physics is not None:
            self._physics.take_over(self._body_state, self._poses)

    def _warm_up(self) -> None:
        """Compile the kernels now, not in the first tick."""
        poses, twists = np.array(self._start), self._twists.copy()
        if len(self._motions.scripts):
            move_scripted(self._motions.scripts, self._motions.pieces, 0.0, poses, twists)
        for index, _, reading, offset, frame in self._carried[:1]:
            carry(index, frame, reading.copy(), offset, self._period, self._smooth, True, poses, twists)
        if self._physics is not None:
            scratch = self._body_state.copy()
            self._physics.start(scratch)
            for force, result in self._pushes:
                push_bodies(force, result, poses, self._forces)
            self._physics.step(scratch, self._forces, poses, twists)

    @property
    def scripted(self) -> bool:
        """Whether a script that ends moves an object."""
        return self._end > 0

    @property
    def done(self) -> bool:
        """Whether all scripts with an end have ended."""
        return int(self._ticks) >= self._end

    def update(self, tick: int, moving: bool) -> None:
        """Write poses and twists of this tick; scripts go on if ``moving``."""
        if len(self._motions.scripts):
            time = self._ticks.item() * self._period
            move_scripted(self._motions.scripts, self._motions.pieces, time, self._poses, self._twists)
            if moving:
                self._ticks += 1
            else:
                self._twists[self._motions.scripts[:, 0].astype(np.intp)] = 0.0
        for index, runner, reading, offset, frame in self._carried:
            origin = frame_of(runner, self._runners)
            if origin is not self._placed.get(index):
                self._placed[index] = origin
                frame[:3], frame[3:] = origin.origin, quaternion(origin.r)
            carry(index, frame, reading, offset, self._period, self._smooth, tick == 0, self._poses, self._twists)

    def advance(self, moving: bool) -> None:
        """Step the rigid bodies to the next tick, pushed by all probes; they stay at rest unless ``moving``."""
        if self._physics is None or not moving:
            return
        self._forces[:] = 0.0
        for force, result in self._pushes:
            push_bodies(force, result, self._poses, self._forces)
        self._physics.step(self._body_state, self._forces, self._poses, self._twists)


def frame_of(runner: Runner, runners: Mapping[str, Runner]) -> Frame:
    """Return the frame of a device in the world, through the devices that carry it."""
    frame = runner.base_frame()
    if not runner.model.carrier:
        return frame
    carrier = runners[runner.model.carrier]
    below = frame_of(carrier, runners)
    x, y, z = _place_of(carrier).tolist()[:3]
    return below.moved(below.vector((x, y, z))).compose(frame)


def _place_of(carrier: Runner) -> NDArray[np.float64]:
    """Return the view of the pose of a device's end, shape (7,); the rest pose for a device that reads no pose."""
    rest = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    return rest if carrier.model.reading(Role.TRACKED_POSE) is None else carrier.read_as(Role.TRACKED_POSE)
