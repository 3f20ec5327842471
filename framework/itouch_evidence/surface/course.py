"""A run over a carried surface, recorded tick by tick: forces, depth and heat, and the ticks in which a law counts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.session import Session

Floats = NDArray[np.float64]

PAD, PAD_DAMPING = 1e3, 2.0  # stiffness [N/m] and damping [N s/m] of the operator twin's pad, if none are said
MEAN = 0.015  # time [s] over which forces on the pad are averaged
PLATE_FORCE = 2.0  # force above which a plate yields (K4) [N]


@dataclass(slots=True)
class Course:
    """A run, tick by tick: arrays (n,), and forces on the finger (n, 3) in the world [N].

    ``time`` [s]; ``touching``: there is a virtual contact; ``plate``: the plate touches the finger; ``renders``: the
    plate renders the contact, otherwise the arm alone; ``settled``: the plate is where the virtual surface is;
    ``share``: the arm's share of the normal force; ``virtual``: the virtual force, ``arm``: the force sent to the arm,
    both (n, 3); ``normal``: of the touched surface (n, 3); ``pad``: the force of the plate on the pad (n,); ``flux``
    out of the finger [W/m2] and temperature of its ``skin`` by the display's twin, 0 without a display.  Forces are
    those that are felt, by the twins: what noisy sensors read of them is not judged.  ``pad_stiffness`` [N/m] and
    ``pad_damping`` [N s/m] of the finger; ``before``: the greatest force on it while the table was calibrated [N].
    """

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
    depth: Floats  # how deep the finger is in a rigid plate at the height of the virtual surface [m]
    flux: Floats
    skin: Floats
    lowest: Floats  # height of the finger's lowest point [m]
    report: dict[str, Any]
    force: float  # the scene's limit [N]
    warm: bool = False  # whether there is a thermal display
    pad_stiffness: float = PAD
    pad_damping: float = PAD_DAMPING
    before: float = 0.0

    @property
    def total(self) -> Floats:
        """Return the force of arm and plate together, shape (n, 3) [N]."""
        total: Floats = self.arm + self.pad[:, None] * np.array([0.0, 0.0, 1.0])
        return total

    @property
    def steps(self) -> Floats:
        """Return by how much the force on the finger changed from the tick before, shape (n,) [N]."""
        steps: Floats = np.r_[0.0, np.linalg.norm(np.diff(self.total, axis=0), axis=1)]
        return steps

    def changes(self) -> list[int]:
        """Return the ticks in which a contact passes from plate to arm or back while it goes on."""
        on = self.touching[1:] & self.touching[:-1]
        return (np.flatnonzero(on & (self.renders[1:] != self.renders[:-1])) + 1).tolist()

    def after(self, ticks: Iterable[int], seconds: float) -> NDArray[np.bool_]:
        """Return which ticks are from one before each of ``ticks`` to ``seconds`` after it: booleans (n,)."""
        found = np.zeros(len(self.time), bool)
        for tick in ticks:
            found[max(0, tick - 1) : tick + round(seconds / (self.time[1] - self.time[0]))] = True
        return found

    def begins(self) -> list[int]:
        """Return the ticks in which the finger meets the virtual surface."""
        return np.flatnonzero(self.touching & ~np.r_[False, self.touching[:-1]]).tolist()

    def changing(self) -> NDArray[np.bool_]:
        """Return in which ticks a contact is being handed over, without first impacts: booleans (n,).

        Ticks in which the arm alone gives the virtual force, as it did in the tick before, are left out, too: steps of
        the force are then steps of the virtual force itself.
        """
        own = ~self.renders & (np.linalg.norm(self.arm - self.virtual, axis=1) < 1e-9) & (self.pad == 0.0)
        own[1:] &= own[:-1]
        on: NDArray[np.bool_] = self.touching & self.after(self.changes(), 0.3) & ~self.after(self.begins(), 0.05)
        on &= ~own
        return on

    def late(self) -> int:
        """Return the longest time [ticks] that a plate is on its way to the virtual surface while it need not yield."""
        rigid, _, _ = self.rigid()
        waits = self.touching & self.renders & ~self.settled & (rigid < min(PLATE_FORCE, self.force - 0.15) - 0.1)
        edges = np.flatnonzero(np.diff(np.r_[0, waits.astype(int), 0]))
        return int((edges[1::2] - edges[::2]).max(initial=0))

    def rigid(self, given: Floats | None = None) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Return the pad's force on a rigid plate at the virtual height, that on the real one, and where they count.

        ``given``: other forces on the pad (n,) [N], in place of those on the real plate.
        All have shape (n,).  They count where the plate renders a contact and is at the surface, at least 0.1 s after
        first impact and changes, and where it need not yield.  Forces [N] are means over MEAN, because the arm reads in
        steps of 30 um.
        """
        depth = np.where(np.isfinite(self.depth), self.depth, 0.0)  # beside a mesh nothing is below the finger
        period = self.time[1] - self.time[0]
        rate = np.r_[0.0, np.diff(depth)] / period
        pad = np.where(depth > 0.0, np.maximum(0.0, self.pad_stiffness * depth + self.pad_damping * rate), 0.0)
        there = self.touching & self.plate & self.renders & self.settled
        there &= ~self.after([*self.begins(), *self.changes()], 0.1) & (pad < min(PLATE_FORCE, self.force - 0.15) - 0.1)
        ticks = 2 * round(0.5 * (MEAN / period - 1.0)) + 1
        window = np.ones(ticks) / ticks
        there &= np.convolve(~there, np.ones(2 * ticks + 1), "same") < 1
        return (
            np.convolve(pad, window, "same"),
            np.convolve(self.pad if given is None else given, window, "same"),
            there,
        )


def follow(session: Session, seconds: float | None = None) -> Course:
    """Run a session to its end, or for ``seconds``, and record every tick, from the end of its calibrations on."""
    state, surface = session.state, session.model.surfaces["finger"]
    radius, before, rows = session.scene.probes[0].radius, 0.0, []
    warm = "peltier.twin.true_flux" in state
    while not session.done and (seconds is None or session.seconds < seconds):
        lowest = state["finger.hand.position"][2].item() - radius
        session.tick()
        x, y, z = state["arm.sent.wrench"][:3].tolist()
        if not state["ready"]:
            before = max(before, math.hypot(x, y, z + state["finger.plate_force"].item()))
            continue
        rows.append(
            (
                session.seconds, int(state["finger.object"]) >= 0, bool(state["finger.plate"]),
                state["finger.surface.renders"].item() > 0.0, state["finger.surface.settled"].item(),
                state["finger.surface.share"].item(), *state["finger.contact_force"].tolist(),
                *state["finger.normal"].tolist(), -x, -y, z, state["finger.plate_force"].item(),
                state["finger.surface_height"].item() - lowest,
                state["peltier.twin.true_flux"].item() if warm else 0.0,
                state["peltier.twin.true_skin"].item() if warm else 0.0, lowest,
            )
        )  # fmt: skip
    a = np.array(rows)
    return Course(
        a[:, 0], a[:, 1] > 0, a[:, 2] > 0, a[:, 3] > 0, a[:, 4] > 0, a[:, 5], a[:, 6:9], a[:, 9:12], a[:, 12:15],
        a[:, 15], a[:, 16], a[:, 17], a[:, 18], a[:, 19], session.report(), session.scene.safety.force, warm,
        surface.pad_stiffness, surface.pad_damping, before,
    )  # fmt: skip


def around(values: Floats, ticks: int) -> Floats:
    """Return for each of the values (n,), in any unit, the greatest within ``ticks`` before and after it, (n,)."""
    padded = np.pad(values, ticks)
    greatest: Floats = np.lib.stride_tricks.sliding_window_view(padded, 2 * ticks + 1).max(axis=1)
    return greatest
