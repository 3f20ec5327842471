"""Contact of one probe in the loop: HIP -> proxy -> force, BEGIN, MOVE and END, and how long a separation ends it.

BEGIN and END are those of the virtual contact: it ends after 0.1 mm and 20 ms of separation, or when another object
takes over.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from itouch.contact import layout as at
from itouch.contact.effects import render_effects
from itouch.contact.stated_contact import StatedContact, found, given
from itouch.contact.step import step
from itouch.contact.surface_effects import effects_table
from itouch.joining import runner
from itouch.loop import event_detection, probe_steps, render
from itouch.loop.device_runner import Runner
from itouch.loop.late_coupling import Late, ease
from itouch.loop.rigid_transforms import Frame
from itouch.loop.surface import force, plate, surface_memory
from itouch.loop.surface.force import SOON
from itouch.monitors.surface_kernels import FingerAbove
from itouch.plugin import Bound, Contact, ContactArrays, ContactEvent, ContactFields, Record, Role
from itouch.plugin.carried_surfaces import ABOUT, LEFT
from itouch.twin.frame_rotation import FRAME
from itouch.world import Model, ProbeModel

#: Time constant [s] of the filter on the HIP's velocity.
VELOCITY_FILTER = 0.002


class SurfaceBelow(NamedTuple):
    """Position of a finger (3,), height of a surface's top (1,) in the world [m]; constants with the device's frame."""

    finger: render.Floats
    top: render.Floats
    frame: render.Floats


class ContactStep:
    """Renders the contact of one probe on its part of State."""

    def __init__(
        self, model: Model, probe: ProbeModel, state: Record, tracker: Runner, arm: Runner | None, table: Runner | None,
    ) -> None:  # fmt: skip
        self.model, self.probe = model, probe
        name = probe.name
        self.figures = state.flat(f"{name}.hip", f"{name}.tracking")
        self.surface = state.flat(f"{name}.surface.renders", f"{name}.surface.unsure")
        self.memory, self.result = state[f"{name}.memory"], state[f"{name}.result"]
        self.object, self.near_object = state[f"{name}.object"], state[f"{name}.near_object"]
        self._beside = (state[f"{name}.beside"], state[f"{name}.beside_distance"])
        self.plate, self.below = state[f"{name}.plate"], state[f"{name}.below"]
        self.current, self.separated = state[f"{name}.contact.object"], state[f"{name}.contact.separated"]
        self.begin = state[f"{name}.contact.begin"]
        #: The nearest object, -1: none; and 1 while the tracker's next position is to give no velocity; shape (1,).
        self._nearest, self._afresh = np.full(1, -1, np.int64), np.zeros(1, np.int64)
        #: How fast the surface rises [m/s], shape (1,); computed anew in each tick.
        self._rising = np.zeros(1)
        self._patience = round(event_detection.SEPARATION_TIME / model.period)
        self._tick, self._events, self._count = state["tick"], state["events.table"], state["events.count"]
        self._constants = _constants(model, probe, arm, table)
        #: Views of State with the frames of tracker, arm and table.
        self._frames = {
            which: state[f"{runner.model.name}.frame"]
            for which, runner in ((render.TRACKER, tracker), (render.ARM, arm), (render.TABLE, table))
            if runner is not None
        }
        #: Stiffness and damping of the coupling with each object, (objects, 2) [N/m, N s/m]; and each of them, shape
        #: (objects,), as it is now: behind a wire computed anew in each tick.  If a modality computes the contact they
        #: are in State, for it to read.
        self._own = np.array([tuple(one) for one in probe.coupling], np.float64).reshape(-1, 2)
        shown = (state.get(f"{name}.coupling.{which}") for which in ("stiffness", "damping"))
        self._stiffness, self._damping = (
            own.copy() if view is None else view for own, view in zip(self._own.T, shown, strict=True)
        )  # fmt: skip
        self._bind(model, probe, state, tracker, arm, table)
        self._followed, self._found = runner(self.follows), runner(self.finds) if self.finds else lambda: -1
        self._carried = runner(self.carries)
        self._pushed = runner((self.pushes,))

    def _bind(
        self, model: Model, probe: ProbeModel, state: Record, tracker: Runner, arm: Runner | None, table: Runner | None
    ) -> None:
        """Collect the views that the compiled tick works on."""
        nothing, self._moving = np.zeros(7), bool(model.moving)
        self._load = table.read_as(Role.CONTACT_FORCE) if table is not None else nothing
        #: Surface force reported by the carrying modality [N], shape (1,); below 0: none reported.
        self._presses = np.full(1, -1.0)
        #: The fields of State that say that, and how much higher it is than is read; and with the surface's distance.
        self.newer: tuple[str, ...] = ()
        self.looked_at: tuple[str, ...] = ()
        self._poses, self._twists = state["objects.pose"], state["objects.twist"]
        follow = Bound(
            render.follow, self._constants, tracker.read_as(Role.TRACKED_POSE), self.figures, self._afresh,
            state["tick"],
        )  # fmt: skip
        eased = self._bind_ease(model, probe, state, tracker, arm) if model.objects else ()
        touched = self._bind_touch(model, probe, state) if model.objects else ()
        #: The calls that follow the tracker; that find what it touches; that look below the finger for the modality
        #: that carries a surface to it; that take over what it says of the surface; and that command the arm's part of
        #: the force.
        self.follows, self.finds = (follow, *eased), touched
        self.looks: tuple[Bound, ...] = ()
        self.carries: tuple[Bound, ...] = ()
        if table is not None:
            self._bind_surface(model, probe, state, table)
        else:  # nothing but the virtual force can be felt
            self.finds += (Bound(probe_steps.only_virtual, self.figures, state[f"{probe.name}.felt_force"]),)
        self.pushes = Bound(
            force.push, self._constants, self.figures, self.surface,
            arm.sent_as(Role.FORCE_ON_OPERATOR) if arm is not None else np.zeros(6),
            arm.commanded(Role.FORCE_ON_OPERATOR) if arm is not None else np.zeros(6), self._load,
            self._presses, self.object,
        )  # fmt: skip

    def _bind_ease(
        self, model: Model, probe: ProbeModel, state: Record, tracker: Runner, arm: Runner | None
    ) -> tuple[Bound, ...]:
        """Return the call that keeps the coupling no stiffer than an arm behind a wire allows; empty: no wire."""
        if arm is None or probe.relied is None:
            return ()
        name, arm_name = f"{probe.name}.coupling", arm.model.name
        pose = next(i for i, channel in enumerate(tracker.model.reads) if channel.role is Role.TRACKED_POSE)
        measured = state[f"{tracker.model.name}.measured"][pose : pose + 1]
        left = state.get(f"{arm_name}.left")  # without a wire a command acts from its own tick on
        return (
            Bound(
                ease, state["tick"], measured, state["tick"] if left is None else left, state[f"{arm_name}.status"],
                Late(state[f"{name}.delay"], state[f"{name}.lost"], state[f"{name}.lost_object"]), self.object,
                self._own, probe.relied, model.period, self._stiffness, self._damping,
            ),
        )  # fmt: skip

    def _bind_touch(self, model: Model, probe: ProbeModel, state: Record) -> tuple[Bound, ...]:
        """Return the calls that find the proxy, its force with surface effects, and an object that begins beside it."""
        world, mesh, figures = model.geometry.world, model.geometry.mesh, self.figures
        stiffness, damping = self._stiffness, self._damping
        one = model.contact_of(probe.name)
        if one is not None and one.contact_fields is not None:
            calls = [self._bind_given(model, probe, state, one.name, one.contact_fields)]
            damping = damping if one.contact_fields.add_damping else np.zeros_like(damping)
        else:
            searched = Bound(
                step, world, mesh, self._poses, self._twists, stiffness, figures[:3], probe.scene.radius,
                probe.scene.near, self.memory, self.result,
            )  # fmt: skip
            calls = [searched]
        if (effects := effects_table(probe.effects)) is not None:
            effect = Bound(
                render_effects, *effects, world, self._poses, self._twists, stiffness, figures[:3],
                figures[render.VELOCITY : render.VELOCITY + 3], model.period, state[f"{probe.name}.effects"],
                self.result, figures[render.EFFECT_FORCE : render.EFFECT_FORCE + 3],
            )  # fmt: skip
            calls.append(effect)
        touched = Bound(
            render.touch, self._constants, self._poses, self._twists, damping, figures, self.result, self.object,
            self._nearest,
        )  # fmt: skip
        calls.append(touched)
        if len(model.objects) > 1:
            # the normal in State is that of the whole force, which leans where a second object is touched, too
            first = self.result[at.RESULT_CONTACTS : at.RESULT_CONTACTS + at.CONTACT_WIDTH]
            place = (first[row : row + 3] for row in (at.CONTACT_POINT, at.CONTACT_NORMAL))
            beside = Bound(
                probe_steps.look_beside,
                world,
                mesh,
                self._poses,
                self.object,
                *place,
                probe.scene.radius,
                *self._beside,
            )
            calls.append(beside)
        return tuple(calls)

    def _bind_given(self, model: Model, probe: ProbeModel, state: Record, name: str, touches: ContactFields) -> Bound:
        """Return the call that takes over what a modality says of the contact."""
        if touches.found:
            return Bound(found, model.geometry.world, state[f"{name}.{touches.found}"], self.result)
        touched = state[f"{name}.{touches.object}"].reshape(1)
        force, normal, point = (state[f"{name}.{field}"] for field in (touches.force, touches.normal, touches.point))
        said = StatedContact(
            touched, force, normal, point, state[f"{name}.{touches.proxy}"] if touches.proxy else np.zeros(0)
        )
        return Bound(
            given, model.geometry.world, model.geometry.mesh, self._poses, self._twists, self.figures[:3],
            probe.scene.radius, probe.scene.near, said, self.result,
        )  # fmt: skip

    def _bind_surface(self, model: Model, probe: ProbeModel, state: Record, table: Runner) -> None:
        """Bind the calls that show what the modality that carries a surface needs, and take over what it says."""
        one = model.carrier_to(probe.name)
        if one is None or one.surface_fields is None:
            return
        fields = one.surface_fields
        here = table.read_as(Role.TRACKED_POSE)
        without = {
            "remaining_distance": np.full(1, -1.0), "fault": np.zeros(1), "yield_distance": np.full(1, -1.0),
            "pressing_force": self._presses, "height_correction": np.zeros(1),
        }  # fmt: skip
        *said, self._presses, risen = (
            state[f"{one.name}.{field}"].reshape(1) if field else without[kind]
            for kind, field in zip(fields._fields[2:], fields[2:], strict=True)
        )
        distance = state[f"{one.name}.{fields.distance}"].reshape(1)
        newer = (fields.pressing_force, fields.height_correction)
        self.newer = tuple(f"{one.name}.{field}" for field in newer if field)
        self.looked_at = (*self.newer, f"{one.name}.{fields.distance}")
        own = probe_steps.ProbeArrays(self._constants, self.figures, self.surface)
        objects = probe_steps.Objects(model.geometry.world, model.geometry.mesh, self._poses, self._twists)
        look = Bound(
            probe_steps.look_below, own, objects, here, self._load,
            probe_steps.StatedReadings(self._presses, risen, distance), self.below,
            np.array([0.0, 0.0, -1.0]), np.zeros(3), np.zeros(3),
            table.gate.acquisition.measured_of(Role.CONTACT_FORCE), not table.model.wire,
        )  # fmt: skip
        measured, read = table.gate.acquisition.measured_of(Role.TRACKED_POSE), np.zeros(0)
        if table.model.wire:
            read = state.flat(f"{probe.name}.rising.read_at", f"{probe.name}.rising.between")
        sent, goal = table.sent_as(Role.SURFACE_POSE), table.commanded(Role.SURFACE_POSE)
        taken = Bound(
            probe_steps.carried, own, probe_steps.Carrier(here, sent, goal, self._load, measured, read),
            probe_steps.StatedSurface(*said), self.object, self.plate, self._rising, state["tick"], model.period,
        )  # fmt: skip
        self.looks, self.carries = (look,), (taken,)
        nothing = np.zeros(7)
        self.withdrawal_floor(nothing, nothing)  # called once now, so that no tick has to compile it

    def restore(self) -> None:
        """Go on from a State that was restored: how stiff objects are follows from the scene, or behind a wire anew."""
        if len(self.follows) == 1:
            self._stiffness[...], self._damping[...] = self._own.T

    def reset(self) -> None:
        """Begin without contact."""
        self._stiffness[...], self._damping[...] = self._own.T
        for view in (self.object, self.near_object, self.below, self.current, self.begin, self._beside[0]):
            view[...] = -1
        self._beside[1][...] = math.inf
        self.figures[render.NEAR_DISTANCE] = self.figures[render.TIME_TO_CONTACT] = math.inf
        self.surface[surface_memory.RENDERS] = self.surface[surface_memory.SETTLED] = 1.0
        self.surface[surface_memory.SHARE] = -1.0

    def stay_away(self, withdrawn: bool) -> None:
        """Note whether safety keeps the surface away (T4): then it renders no contact."""
        missed = self.surface[surface_memory.MISSED]
        if withdrawn:
            self.surface[surface_memory.MISSED] = surface_memory.WITHDRAWN
        elif missed == surface_memory.WITHDRAWN:
            self.surface[surface_memory.MISSED] = 0.0

    def withdrawal_floor(self, target: render.Floats, sent: render.Floats) -> float:
        """Return how low [m] a surface that safety takes away may go in this tick; -inf: it is clear of the finger.

        ``target`` and ``sent`` (7,) [m; quaternion]: the pose that it is commanded, and the one that was sent last.
        """
        return plate.withdrawal_floor(self._constants, self.surface, target, sent, max(0.0, -self._load[2].item()))

    def gone(self) -> None:
        """Mark a surface that safety has taken away as not present, once it is clear of the finger."""
        away = self.figures[render.HIP + 2] - self._constants[render.RADIUS] - self.figures[render.PLATE_TOP]
        if away > (SOON if self._constants[render.HAS_LOAD] > 0.0 else ABOUT) and -self._load[2] < LEFT:
            self.surface[surface_memory.PRESENT] = self.plate[...] = 0

    def restart(self) -> None:
        """Forget how the tracker moved before: take the position that it reads now, without a velocity."""
        self._afresh[0] = 1
        self.follows[0].run()
        self.figures[render.VELOCITY : render.VELOCITY + 3] = 0.0

    @property
    def nearing(self) -> FingerAbove:
        """Views of finger and surface from which follows how much the force between them may rise in a tick."""
        figures, surface = self.figures, self.model.surfaces[self.probe.name]
        return FingerAbove(
            figures[render.HIP : render.HIP + 3], figures[render.VELOCITY : render.VELOCITY + 3],
            figures[render.PLATE_TOP : render.PLATE_TOP + 1], self._rising,
            np.array([self.probe.scene.radius, surface.pad_stiffness, surface.pad_damping, self.model.period]),
            self._presses, surface_memory.estimated(self.surface),
            self.surface[surface_memory.SINK : surface_memory.SINK + 1],
        )  # fmt: skip

    @property
    def over(self) -> SurfaceBelow:
        """Where finger and surface are in the world."""
        figures = self.figures
        return SurfaceBelow(
            figures[render.HIP : render.HIP + 3], figures[render.PLATE_TOP : render.PLATE_TOP + 1], self._constants
        )  # fmt: skip

    def place(self, which: int, frame: Frame, *, stands: bool) -> None:
        """Set the frame in the world of tracker, arm or table, as ``which`` says: `render.TRACKER`, ARM or TABLE.

        ``stands``: no other device carries it.  Where its frame changes all the same, a calibration has found where it
        is: its surface has not risen by that, and presses no harder.
        """
        if which == render.TABLE and stands and self._frames[which].any():
            self.figures[render.PLATE_TOP] += frame.z - self._frames[which][2]
        self._frames[which][:] = self._constants[which : which + 12] = (frame.x, frame.y, frame.z, *frame.r)

    @property
    def constants(self) -> render.Floats:
        """The probe's constants, of which only the frames of its devices may change, (CONSTANTS,); see `render`."""
        return self._constants

    def settle(self, *, moves: bool = False) -> None:
        """Take the tracker's next position without a velocity: hardware may have moved while nothing ran.

        ``moves``: the pause was only a moment, so the finger's velocity is taken to be as before.
        """
        if not moves:
            self.figures[render.VELOCITY : render.VELOCITY + 3] = 0.0
        self._afresh[0] = 1

    def follow(self) -> None:
        """Take the tracker's position as the finger's."""
        self._followed()

    def find(self) -> int:
        """Find what the finger touches; return what stopped it, as `itouch.contact.stated_contact` tells, or 0."""
        found = self._found()
        return found & 0xFFFFFFFF if found >= 0 else 0

    def carry(self) -> None:
        """Take over where the surface was brought, and determine whether it renders the contact."""
        self._carried()

    def push(self) -> None:
        """Command the arm's part of the force."""
        self._pushed()

    @property
    def event_views(self) -> tuple[Any, ...]:
        """The views that show whether there is an event in a tick: the first arguments of `probe_steps.quiet`."""
        return self._nearest, self.near_object, self.current, self.object, self.separated

    def happens(self, moves: bool, event: ContactArrays) -> tuple[Any, ...]:
        """Return the arguments of `event_detection.happens`; ``moves``: MOVE is an event, too."""
        seen = event_detection.EventInputs(
            self._nearest, self.object, self.figures, self.result, self._poses, self._twists, self._tick
        )  # fmt: skip
        table = self._events.view(np.int64).reshape(len(self._events), -1)
        kept = event_detection.EventMemory(
            self.near_object, self.current, self.separated, self.begin, self._count, table, table.view(np.float64)
        )  # fmt: skip
        return seen, kept, event, self.probe.index, self._moving, moves, self._patience

    def event(self, heard: ContactArrays) -> ContactEvent:
        """Return an event from its numbers, for its delivery in Python."""
        kind, tick, _, index, point, normal, distance, speed, along, *rest = [part.tolist() for part in heard]
        return ContactEvent(
            Contact(kind[0]), tick[0], self.probe.name, self.model.objects[index[0]], index[0], tuple(point),
            tuple(normal), distance[0], speed[0], tuple(along), *(part[0] for part in rest),
        )  # fmt: skip


def _constants(model: Model, probe: ProbeModel, arm: Runner | None, table: Runner | None) -> render.Floats:
    constants = np.zeros(render.CONSTANTS)
    for which in (render.TRACKER, render.ARM, render.TABLE):  # until its device is placed, each frame is the world's
        constants[which : which + FRAME] = (0.0, 0.0, 0.0, *np.eye(3).ravel())
    surface = model.surfaces.get(probe.name)
    if surface is not None:
        constants[render.OFFSET : render.OFFSET + 3] = surface.face
        constants[render.PLATE_LIMIT], constants[render.PAD_STIFFNESS] = surface.greatest_force, surface.pad_stiffness
        constants[render.PLATE_COSINE] = math.cos(surface.plate_angle)
    force = (arm.model.limits.force if arm is not None else None) or math.inf
    values = {
        render.RADIUS: probe.scene.radius,
        render.NEAR: probe.scene.near,
        render.CLEARANCE: probe.scene.clearance,
        render.PERIOD: model.period,
        render.SMOOTH: 1.0 - math.exp(-model.period / VELOCITY_FILTER),
        render.FORCE_LIMIT: force,
        render.HAS_LOAD: float(table is not None and table.model.reading(Role.CONTACT_FORCE) is not None),
        render.HAS_TABLE: float(table is not None),
        render.PAD: math.pi * (0.75 * probe.scene.radius / probe.scene.modulus) ** (2 / 3),
    }
    for index, value in values.items():
        constants[index] = value
    return constants
