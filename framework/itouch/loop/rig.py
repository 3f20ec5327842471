"""The parts of one probe at work: contact, carried surface, touch-off, finger twin and contact log."""

from __future__ import annotations

import math
from collections.abc import Mapping

from itouch.loop.contactlog import ContactLog
from itouch.loop.frames import Frame, Vector
from itouch.loop.ledger import Ledger
from itouch.loop.runner import Runner
from itouch.loop.surface import Surface
from itouch.loop.touch import Listener, Toucher
from itouch.loop.touchoff import TouchOff
from itouch.plugin import Record
from itouch.twin.coupling import Coupling
from itouch.twin.hand import Hand
from itouch.world import Model, ProbeModel


class ProbeRig:
    """Takes one probe through a tick."""

    def __init__(
        self, model: Model, probe: ProbeModel, state: Record, runners: Mapping[str, Runner], ledger: Ledger
    ) -> None:
        self.model, self.probe, self._runners = model, probe, runners
        self.tracker = runners[probe.scene.pose_from]
        self.arm = runners.get(probe.scene.force_to)
        self.table = runners.get(probe.scene.surface_to)
        self._ledger = ledger
        self._tracked = self.tracker.reading["pose"][:3]
        if self.table is not None:
            self._sent, self._position = self.table.sent["pose_target"][:3], self.table.reading["pose"][:3]
        if self.arm is not None:
            self._force = self.arm.command["wrench"][:3]
        self.toucher = Toucher(model, probe, state)
        self.surface, self.touch_off = self._carried(state)
        self.coupling = self._coupling(state)
        self.log = ContactLog(model, self.toucher, self.surface, self.coupling, state, ledger)
        self.force: Vector = (0.0, 0.0, 0.0)

    def _carried(self, state: Record) -> tuple[Surface | None, TouchOff | None]:
        if self.table is None:
            return None, None
        surface = Surface(self.model, self.probe, state, self.table, self._runners[self.probe.face])
        wanted = self.table.model.touch_off and "wrench" in self.table.reading
        return surface, TouchOff(surface, state, self.model.period) if wanted else None

    def _coupling(self, state: Record) -> Coupling:
        operator, table = self.probe.operator, self.table
        moves = operator is not None and self.tracker.model.twin
        hand = Hand(operator, self.probe.name, state, self.model.period) if operator is not None and moves else None
        face = self._runners[self.probe.face] if table is not None else None
        extent = face.model.cls.face(face.model.params) if face is not None else None
        return Coupling(
            hand, self.probe.scene.radius, self.tracker if moves else None,
            table if table is not None and table.model.twin else None,
            face if face is not None and face.model.twin else None,
            self.surface.offset if self.surface else (0.0, 0.0, 0.0), extent, state, self.probe.name, self.model.period,
        )  # fmt: skip

    def reset(self) -> None:
        """Set the probe's part of State to its start."""
        self.toucher.reset()
        self.coupling.reset()
        if self.coupling.hand is not None:
            self.coupling.hand.reset()
            self.coupling.place()
        if self.touch_off is not None:
            self.touch_off.reset()

    def restore(self) -> None:
        """Tell the arm's twin where the finger is, from State."""
        self.coupling.place()

    @property
    def ready(self) -> bool:
        """Whether the rig is calibrated and the hand back on its path."""
        hand = self.coupling.hand
        calibrated = self.touch_off is None or self.touch_off.done
        return calibrated and (hand is None or float(hand.offset) == 0.0)

    def frame_of(self, runner: Runner) -> Frame:
        """Return the frame of a device in the world, through what carries it."""
        frame = runner.base_frame()
        if not runner.model.carrier:
            return frame
        carrier = self._runners[runner.model.carrier]
        below = self.frame_of(carrier)
        moved = carrier.reading["pose"].tolist()[:3] if "pose" in carrier.reading else (0.0, 0.0, 0.0)
        return below.moved(below.vector(moved)).compose(frame)

    def touch(self, tick: int, tell: Listener) -> None:
        """Contact and its events, from this tick's readings."""
        position = self.frame_of(self.tracker).point(self._tracked.tolist())
        self.force = self.toucher.update(position, tick == 0)
        if self.surface is not None:
            self.surface.update(self.toucher)
        self.toucher.events(tick, tell)

    def command(self) -> None:
        """Command arm and table."""
        if self.touch_off is not None and not self.touch_off.done and self.table is not None and self.table.enabled:
            self._lead()
            self.touch_off.update(self.toucher)
        if self.arm is not None:
            force = self.surface.share(self.force, self.toucher) if self.surface is not None else self.force
            self._force[:] = self.frame_of(self.arm).vector_into(force)

    def _lead(self) -> None:
        """Ask the hand down to where the plate can reach it, if its path begins higher."""
        hand = self.coupling.hand
        if hand is None or self.touch_off is None:
            return
        highest = self.touch_off.highest_finger(self.probe.scene.radius)
        hand.lower(min(0.0, highest - float(hand.path.start[2])))

    def couple(self, moving: bool) -> None:
        """Step the finger's twin, and tell the twins of devices what touches them."""
        hand = self.coupling.hand
        if hand is not None and self.touch_off is not None and self.touch_off.done:
            hand.lower(0.0)
        self.coupling.step(moving)
        self.log.note()

    def check(self, tick: int, counting: bool) -> None:
        """Check that the table is where it was sent; count its distance for the report."""
        if self.table is None or not self.table.enabled:
            return
        sx, sy, sz = self._sent.tolist()
        x, y, z = self._position.tolist()
        distance = math.sqrt((sx - x) ** 2 + (sy - y) ** 2 + (sz - z) ** 2)
        if counting:
            self._ledger.tracking.add(distance)
        self.table.check_tracking(tick, distance)
