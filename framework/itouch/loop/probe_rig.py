"""Everything that belongs to one probe: contact, carried surface, touch-off, finger twin and contact log."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from itouch.loop import probe_steps, render
from itouch.loop.contact_log import ContactLog
from itouch.loop.device_runner import Runner
from itouch.loop.rigid_transforms import Frame, Vector
from itouch.loop.run_statistics import RunStatistics
from itouch.loop.touch import ContactStep
from itouch.loop.touchoff import TOO_HIGH, UNFELT, TouchOff
from itouch.monitors import Surface
from itouch.plugin import Bound, Record, Role, TwinInputs, poses
from itouch.schema.hold_until import Until
from itouch.twin.finger_coupling import Coupling
from itouch.twin.hand import Hand
from itouch.twin.skin_under_devices import Floats, Skin
from itouch.world import Model, ProbeModel
from itouch.world.skin_source import skin_of
from itouch.world.state import truth


class ProbeRig:
    """Runs one probe through a tick."""

    def __init__(
        self, model: Model, probe: ProbeModel, state: Record, runners: Mapping[str, Runner], statistics: RunStatistics
    ) -> None:
        self.model, self.probe, self._runners, self._statistics = model, probe, runners, statistics
        self.tracker = runners[probe.scene.pose_from]
        self.arm = runners.get(probe.scene.force_to)
        self.table = runners.get(probe.scene.surface_to)
        self.touched_device = runners.get(probe.touched_device)
        offset = model.surfaces[probe.name].face if probe.name in model.surfaces else (0.0, 0.0, 0.0)
        self.contact_step = ContactStep(model, probe, state, self.tracker, self.arm, self.table)
        self.coupling = self._coupling(state, offset)
        #: The skin under the devices that are worn on the finger, if there are any.
        self.skin = self._under_worn(state)
        #: 1 while frames stay where they are, shape (1,).
        self._fixed = np.zeros(1, np.int64)
        self.touch_off = self._touch_off(state, offset)
        #: The phase of the touch-off (`TouchOffPhase`), shape (1,); -1: there is none.
        self.stage = self.touch_off.stage.reshape(1) if self.touch_off is not None else np.full(1, -1, np.int64)
        self.log = ContactLog(model, self.contact_step, self.table, self.coupling, state, statistics)
        self._figures = self.contact_step.figures
        self._radius = probe.scene.radius
        self._stands = [
            (which, runner)
            for which, runner in ((render.TRACKER, self.tracker), (render.ARM, self.arm), (render.TABLE, self.table))
            if runner is not None
        ]
        measured = self.table is not None and not self.table.model.twin and self.table.model.reading(Role.CONTACT_FORCE)
        #: Whether the plate's force on the finger is known only from what a real table measures.
        self.feels_for_real = bool(measured)
        self._felt = self.table.read_as(Role.CONTACT_FORCE) if self.table is not None and measured else None
        self._placed: dict[int, Frame] = {}
        #: Whether no other probe's touch-off can move the frames of its devices.
        self._alone = len(model.probes) == 1
        self._moves = any(runner.model.carrier for _, runner in self._stands)

    def moves(self, runner: Runner) -> bool:
        """Whether a device moves with this finger: it tracks it, pushes it, or is mounted on one that does."""
        on: Runner | None = runner
        while on is not None and on not in (self.arm, self.tracker):
            on = self._runners.get(on.model.carrier)
        return on is not None

    def _touch_off(self, state: Record, offset: Vector) -> TouchOff | None:
        table = self.table
        if table is None or not table.model.touch_off or table.model.reading(Role.CONTACT_FORCE) is None:
            return None
        hand = self.coupling.hand
        return TouchOff(table, self.contact_step, offset, state, self.model.period, hand, self._fixed)

    def _coupling(self, state: Record, offset: Vector) -> Coupling:
        operator, table, face = self.probe.operator, self.table, self.touched_device
        hand = None
        if operator is not None and self.tracker.model.twin:
            probe = self.probe
            waits = any(isinstance(target.hold, Until) for target in operator.motion.targets)
            hand = Hand(
                operator, probe.name, state, self.model.period, recorded=probe.recorded, start=probe.start,
                skin=skin_of(self.model, probe) if waits else None,
            )  # fmt: skip
        return Coupling(
            hand, self.probe.scene.radius, self.tracker,
            table if table is not None and table.model.twin else None,
            face if face is not None and face.model.twin else None,
            offset, _extent_of(face) if face is not None else None, state, self.probe.name,
            self.model.period,
        )  # fmt: skip

    def _under_worn(self, state: Record) -> Skin | None:
        worn = [self._runners[device.name] for device in self.model.worn(self.probe)]
        operator = self.probe.operator
        if not worn or operator is None:
            return None
        for runner in worn:
            runner.worn_by = self.probe.name
        rest, ambient = operator.skin_temperature, self.model.scene.world.temperature
        touches = [runner.touch for runner in worn]
        return Skin(state, self.probe.name, self.model.period, touches, self._owners(state), rest, ambient)

    def _owners(self, state: Record) -> list[tuple[Floats, TwinInputs]]:
        """Return skin temperature and twin inputs of each plate whose twin models the finger's tissue.

        Plates count that any probe of this finger meets.
        """
        same = [one.touched_device for one in self.model.probes if one.scene.pose_from == self.probe.scene.pose_from]
        faces = [self._runners[name] for name in dict.fromkeys(same) if name in self._runners]
        fields = [(truth(self.model, one.model.name, Role.SKIN_TEMPERATURE), one) for one in faces if one.model.twin]
        return [(state[field].reshape(1), one.touch) for field, one in fields if field]

    def reset(self) -> None:
        """Set the probe's part of State to its start."""
        self.contact_step.reset()
        self.coupling.reset()
        if self.skin is not None:
            self.skin.reset()
        if self.coupling.hand is not None:
            self.coupling.hand.reset()
            self.coupling.place()
            self.tracker.settle()  # so that its first reading is where the finger is
        if self.touch_off is not None:
            self.touch_off.reset()
        self._fixed[0] = 0

    def rearm(self) -> None:
        """Take the tracker's place anew after a fault: no tick has followed it through the stop, in which it moved."""
        self._place()  # in a restored session no tick has done so yet
        self.contact_step.restart()

    def restore(self) -> None:
        """Tell the twins where the finger is, from State; the frames of devices are found anew."""
        self.contact_step.restore()
        self.coupling.place()
        self._placed.clear()
        self._fixed[0] = 0

    @property
    def ready(self) -> bool:
        """Whether the rig is calibrated and the hand back on its path."""
        hand = self.coupling.hand
        calibrated = self.touch_off is None or self.touch_off.done
        return calibrated and (hand is None or hand.home)

    def frame_of(self, runner: Runner) -> Frame:
        """Return the frame of a device in the world, through the devices that carry it."""
        frame = runner.base_frame()
        if not runner.model.carrier:
            return frame
        carrier = self._runners[runner.model.carrier]
        below = self.frame_of(carrier)
        moved = carrier.read_as(Role.TRACKED_POSE).tolist()[:3]
        return below.moved(below.vector(moved)).compose(frame)

    def follow(self, tick: int, ready: bool) -> None:
        """Take the tracker's reading of this tick as where the finger is."""
        if not self._fixed[0]:  # a calibration, or the motion of a carrier, may move frames
            self._fixed[0] = (ready or self._alone) and not self._moves
            self._place()
        self.contact_step.follow()

    def contact(self, tick: int, ready: bool) -> None:
        """Find what the finger touches, from this tick's readings."""
        self.follow(tick, ready)
        self.contact_step.find()

    def _place(self) -> None:
        """Set the frames of the devices in the world as they are now."""
        for which, runner in self._stands:
            frame = self.frame_of(runner)
            if self._placed.get(which) is not frame:
                self._placed[which] = frame
                self.contact_step.place(which, frame, stands=not runner.model.carrier)

    @property
    def bound_follow(self) -> tuple[Bound, ...]:
        """``follow`` as compiled calls, which leave it to Python while frames may move."""
        return (Bound(probe_steps.placed, self._fixed), *self.contact_step.follows)

    @property
    def bound_contact(self) -> tuple[Bound, ...]:
        """``contact`` as compiled calls, which leave it to Python while frames may move."""
        return (*self.bound_follow, *self.contact_step.finds)

    def bound_surface(self) -> tuple[Bound, ...]:
        """Return ``surface`` as compiled calls, which leave a withdrawal to Python; none: all of it is Python's."""
        table = self.table
        post = table.gate.device_monitors.surface if table is not None else None
        if table is None or post is None or not isinstance(post.monitor, Surface):
            return ()
        led = Bound(probe_steps.led, post.state["withdrawn"], self.contact_step.surface)
        closing = Bound(
            probe_steps.close_in,
            self._figures,
            self._radius,
            *post.monitor.paces,
            table.gate.actuation.moving.closing,
            table.gate.actuation.clamped,
        )
        seek = self.touch_off.bounds if self.touch_off is not None else ()
        return (led, *self.contact_step.carries, closing, *seek)

    def surface_left(self, code: int, tick: int, ready: bool) -> None:
        """Do what the compiled calls have left to Python: end a touch-off that found no height, or the whole step.

        Raises
        ------
        DeviceFaultError
            If the plate was not felt up to the end of its travel, or is still felt where it can go no lower.
        """
        if code in (UNFELT, TOO_HIGH) and self.touch_off is not None:
            self.touch_off.give_up(code)
        else:
            self.surface(tick, ready)

    def force(self, tick: int, ready: bool) -> None:
        """Command the arm's part of the force."""
        self.contact_step.push()

    def surface(self, tick: int, ready: bool) -> None:
        """Carry the table's surface to the finger, and choose how fast it may close in.

        A touch-off that is not done yet commands the table instead.
        """
        table = self.table
        if table is None or table.gate.device_monitors.surface is None:
            self.contact_step.carry()
            return
        self.contact_step.stay_away(table.gate.device_monitors.withdrawn)
        self.contact_step.carry()
        tracking_error = self._figures[render.TRACKING].item()
        gap = probe_steps.gap_of(self._figures, self._radius)
        table.gate.actuation.closing = table.gate.device_monitors.closing(gap, tracking_error)
        if self.touch_off is not None and not self.touch_off.done and table.latch.enabled:
            self.touch_off.update()
        elif table.gate.device_monitors.withdrawn:
            target = table.commanded(Role.SURFACE_POSE)
            leaves = self.contact_step.withdrawal_floor(target, table.sent_as(Role.SURFACE_POSE))
            target[2] = table.gate.device_monitors.follow(
                target[2].item(), self.contact_step.current.item() < 0, leaves
            )
            self.contact_step.gone()

    def _gap(self) -> float:
        """Return the distance [m] between finger pad and plate, by their readings."""
        figures = self._figures
        gap: float = figures[2].item() - self._radius - figures[render.PLATE_TOP].item()
        return gap

    def couple(self, moving: bool) -> None:
        """Step the finger's twin, and tell the twins of devices what touches them."""
        self.lead(moving)
        self.coupling.bound()
        if self.skin is not None:
            self.skin.bound()
        if self.feels_for_real:
            self.measure()
        self.log.note()

    def lead(self, moving: bool) -> None:
        """Move the operator's hand on: along its path if ``moving``, or back to it after a touch-off."""
        hand = self.coupling.hand
        if hand is None:
            return
        if not moving and self.touch_off is not None and self.touch_off.done:
            hand.lower(0.0)
        hand.advance(moving)

    def measure(self) -> None:
        """Write the force on the finger: what a real table measures along the plate's normal, plus the arm's force."""
        arm = self.arm
        if self._felt is None:
            return
        normal = max(0.0, -self._felt[2].item())
        total = self._placed[render.TABLE].vector((0.0, 0.0, normal)) if render.TABLE in self._placed else (0.0,) * 3
        if arm is not None and render.ARM in self._placed:
            push = self._placed[render.ARM].vector(arm.sent_as(Role.FORCE_ON_OPERATOR).tolist()[:3])
            total = (total[0] + push[0], total[1] + push[1], total[2] + push[2])
        self.coupling.total[...] = math.hypot(*total)

    def present(self, runner: Runner, counting: bool) -> None:
        """Tell the monitors of an arm or a table where the finger is and how fast; ``counting``: scripts run."""
        figures, moment = self._figures, runner.gate.device_monitors.moment
        if self.moves(runner):  # also an arm whose force a modality commands
            moment.speed = render.size(figures[render.VELOCITY : render.VELOCITY + 3])
        if runner is self.table:
            distance = figures[render.TRACKING].item()
            moment.tracking_error = runner.gate.acquisition.tracking_error(distance)
            if counting:
                self._statistics.tracking.add(distance)
            moment.gap = self._gap()
            moment.calibrated = counting and self.touch_off is not None
            if render.TABLE in self._placed:
                moment.finger = self._placed[render.TABLE].into(figures[:3].tolist())


def _extent_of(face: Runner) -> tuple[float, float, float, float] | None:
    """Return the half extents [m] of a face that a carrier brings, and its heading on it (cosine and sine), or None."""
    half, mount = face.model.surface_half_extents, face.model.mount
    if half is None:
        return None
    x, y, _ = (
        poses.rotate(np.array(mount[3:]), np.array((1.0, 0.0, 0.0))).tolist() if face.model.carrier else (1.0, 0.0, 0.0)
    )
    size = math.hypot(x, y)
    return *half, x / size, y / size
