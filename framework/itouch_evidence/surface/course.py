"""What a run over a carried surface was, tick by tick."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.session import Session
from itouch_evidence.surface.scenes import RADIUS

Floats = NDArray[np.float64]

PAD, PAD_DAMPING = 1e3, 2.0  # of the operator twin's pad [N/m], [N s/m]
PLATE_FORCE = 2.0  # above which a plate yields (K4) [N]


@dataclass(slots=True)
class Course:
    """What a run was, tick by tick; forces on the finger in the world [N]."""

    time: Floats
    touching: NDArray[np.bool_]
    plate: NDArray[np.bool_]
    renders: NDArray[np.bool_]
    settled: NDArray[np.bool_]
    share: Floats
    virtual: Floats
    normal: Floats
    arm: Floats
    pad: Floats
    depth: Floats  # of the finger in a rigid plate at the virtual height [m]
    flux: Floats
    skin: Floats
    lowest: Floats  # point of the finger [m]
    report: dict[str, Any]
    force: float  # what the scene allows [N]
    warm: bool = False  # whether there is heat

    @property
    def total(self) -> Floats:
        """Return the force of arm and plate, shape (n, 3)."""
        total: Floats = self.arm + self.pad[:, None] * np.array([0.0, 0.0, 1.0])
        return total

    @property
    def steps(self) -> Floats:
        """Return how much the force on the finger changed since the tick before [N]."""
        steps: Floats = np.r_[0.0, np.linalg.norm(np.diff(self.total, axis=0), axis=1)]
        return steps

    def changes(self) -> list[int]:
        """Return the ticks in which a contact that goes on goes over from plate to arm or back."""
        on = self.touching[1:] & self.touching[:-1]
        return (np.flatnonzero(on & (self.renders[1:] != self.renders[:-1])) + 1).tolist()

    def after(self, ticks: Iterable[int], seconds: float) -> NDArray[np.bool_]:
        """Return which ticks are within so many seconds after any of some."""
        found = np.zeros(len(self.time), bool)
        for tick in ticks:
            found[max(0, tick - 1) : tick + round(seconds / (self.time[1] - self.time[0]))] = True
        return found

    def begins(self) -> list[int]:
        """Return the ticks in which the finger meets the virtual surface."""
        return np.flatnonzero(self.touching & ~np.r_[False, self.touching[:-1]]).tolist()

    def changing(self) -> NDArray[np.bool_]:
        """Return the ticks of a contact in and after a change, without first impacts.

        Nor those in which the arm alone gives the virtual force, as in the tick before: its steps are the contact's.
        """
        own = ~self.renders & (np.linalg.norm(self.arm - self.virtual, axis=1) < 1e-9) & (self.pad == 0.0)
        own[1:] &= own[:-1]
        on: NDArray[np.bool_] = self.touching & self.after(self.changes(), 0.3) & ~self.after(self.begins(), 0.05)
        on &= ~own
        return on

    def late(self) -> int:
        """Return the longest time [ticks] that a plate which could be at the surface is on its way there."""
        rigid, _, _ = self.rigid()
        waits = self.touching & self.renders & ~self.settled & (rigid < min(PLATE_FORCE, self.force - 0.15) - 0.1)
        edges = np.flatnonzero(np.diff(np.r_[0, waits.astype(int), 0]))
        return int((edges[1::2] - edges[::2]).max(initial=0))

    def rigid(self) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Return what a rigid plate at the virtual height would give, what the plate gives, and where that counts.

        It counts where the plate alone renders the normal force, after a first impact or a change, and where it need
        not yield.  The arm's reading goes in steps of 30 um: forces [N] are means over 15 ms.
        """
        depth = np.where(np.isfinite(self.depth), self.depth, 0.0)  # nothing is below a finger beside a mesh
        rate = np.r_[0.0, np.diff(depth)] / (self.time[1] - self.time[0])
        pad = np.where(depth > 0.0, np.maximum(0.0, PAD * depth + PAD_DAMPING * rate), 0.0)
        there = self.touching & self.plate & self.renders & self.settled
        there &= ~self.after([*self.begins(), *self.changes()], 0.1) & (pad < min(PLATE_FORCE, self.force - 0.15) - 0.1)
        window = np.ones(15) / 15.0
        there &= np.convolve(~there, np.ones(31), "same") < 1
        return np.convolve(pad, window, "same"), np.convolve(self.pad, window, "same"), there


def follow(session: Session, seconds: float | None = None) -> Course:
    """Run a session to its end, and note every tick."""
    state, rows = session.state, []
    warm = "peltier.twin.true_flux" in state
    while not session.done and (seconds is None or session.seconds < seconds):
        before = state["finger.hand.position"][2].item() - 1e-3 * RADIUS
        session.tick()
        x, y, z = state["arm.sent.wrench"][:3].tolist()
        rows.append(
            (
                session.seconds, int(state["finger.object"]) >= 0, bool(state["finger.plate"]),
                state["finger.surface.renders"].item() > 0.0, state["finger.surface.settled"].item(),
                state["finger.surface.share"].item(), *state["finger.contact_force"].tolist(),
                *state["finger.normal"].tolist(), -x, -y, z, state["finger.plate_force"].item(),
                state["finger.surface_height"].item() - before,
                state["peltier.twin.true_flux"].item() if warm else 0.0,
                state["peltier.twin.true_skin"].item() if warm else 0.0, before,
            )
        )  # fmt: skip
    a = np.array(rows)
    return Course(
        a[:, 0], a[:, 1] > 0, a[:, 2] > 0, a[:, 3] > 0, a[:, 4] > 0, a[:, 5], a[:, 6:9], a[:, 9:12], a[:, 12:15],
        a[:, 15], a[:, 16], a[:, 17], a[:, 18], a[:, 19], session.report(), session.scene.safety.force, warm,
    )  # fmt: skip


def around(values: Floats, ticks: int) -> Floats:
    """Return the greatest of values (n,) within so many ticks of each."""
    padded = np.pad(values, ticks)
    greatest: Floats = np.lib.stride_tricks.sliding_window_view(padded, 2 * ticks + 1).max(axis=1)
    return greatest
