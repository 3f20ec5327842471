"""Worlds that are not flat, under an arm and a table, and what their runs must hold to in every tick."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import itouch

Floats = NDArray[np.float64]

RADIUS = 8.0  # of the finger [mm]
HIGHEST = 45.0  # up to which the table brings its plate, and a little more [mm]
PAD, PAD_DAMPING = 1e3, 2.0  # of the operator twin's pad [N/m], [N s/m]
PLATE_FORCE = 2.0  # above which a plate yields (K4) [N]

_SCENE = """<?xml version="1.0" encoding="utf-8"?>
<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal" xmlns:xyz-table="urn:itouch:plugin:xyz-table"
        xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <include file="materials.xml"/>
  <materials>
    <material name="stuff" base="aluminium">
      <contact stiffness="{stiffness} N/mm" damping="2 N*s/m" static-friction="{friction}"
               dynamic-friction="{friction}"/>
    </material>
  </materials>
  <defaults><mesh scale="1 mm"/></defaults>
  <world temperature="23 degC">{world}</world>
  <devices>
    <device name="arm" plugin="usb-arm">
      <mount pos="0 250 0 mm" rpy="0 0 180 deg"/><limits force="3 N"/><usb-arm:hardware/>
    </device>
    <device name="table" plugin="xyz-table">
      <mount pos="0 0 {mount} mm" mount-error="0 0 {error} mm"/><limits speed="0.25 m/s"/>
      {calibration}<xyz-table:hardware travel="200 140 80 mm"/>
    </device>
    {display}
  </devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="33 degC">
      <motion>{motion}</motion>
    </operator>
    {heat}
  </interaction>
  <safety force="{force} N" contact-time="{contact_time} s"/>
</itouch>
"""
_DISPLAY = """<device name="peltier" plugin="thermal"><mount on="table" pos="0 0 4 mm"/>
      <limits current="6 A" temperature="15 40 degC"/><thermal:hardware>{hardware}</thermal:hardware></device>"""
_HEAT = """<thermal:heat probe="finger">{heat}</thermal:heat><thermal:flux-control display="peltier" desired-from="heat"/>"""


@dataclass(slots=True)
class Slope:
    """A scene to be: world and motion in mm; ``warm`` puts a thermal display on the table."""

    world: str
    motion: str
    stiffness: float = 1.2
    friction: float = 0.0
    force: float = 3.0
    error: float = 0.0
    warm: bool = False
    touch_off: bool = False
    heat: str = ""
    seed: int = 0
    contact_time: float = 10.0

    def build(self, folder: Path, hardware: str = "") -> itouch.Session:
        """Write the scene into a folder that holds the shipped scenes, and build it; ``hardware``: of the display."""
        path = folder / "slope.xml"
        path.write_text(
            _SCENE.format(
                world=self.world, motion=self.motion, stiffness=self.stiffness, friction=self.friction,
                force=self.force, error=self.error, display=_DISPLAY.format(hardware=hardware) if self.warm else "",
                heat=_HEAT.format(heat=self.heat) if self.warm else "", mount=-34 if self.warm else -30,
                contact_time=self.contact_time,
                calibration='<calibration method="touch-off"/>' if self.touch_off else "",
            ),
            encoding="utf-8",
        )  # fmt: skip
        return itouch.build(path, seed=self.seed)


def ramp(degrees: float, deep: float = 5.0) -> tuple[str, str]:
    """Return a ramp and a touch of it along its normal, whose target is so deep in it [mm]."""
    tilt = math.radians(degrees)

    def off(distance: float) -> str:
        return f"{distance * math.sin(tilt):.3f} 0 {distance * math.cos(tilt):.3f} mm"

    world = f'<box name="ramp" pos="0 0 0 mm" rpy="0 {degrees} 0 deg" size="60 60 10 mm" material="stuff"/>'
    away, on = off(5.0 + RADIUS + 12.0), off(5.0 + RADIUS - deep)
    return world, (
        f'<to pos="{away}" in="0.1 s" hold="0.1 s"/><to pos="{on}" in="0.5 s" hold="0.4 s"/>'
        f'<to pos="{away}" in="0.4 s" hold="0.05 s"/>'
    )


def ball(degrees: list[float], each: float, radius: float = 30.0, deep: float = 4.0) -> tuple[str, str]:
    """Return a ball and a stroke over it from angle to angle, each in so many seconds; the table reaches its top."""
    middle = min(0.0, HIGHEST - radius)
    world = f'<sphere name="ball" pos="0 0 {middle:g} mm" radius="{radius} mm" material="stuff"/>'
    reach = radius + RADIUS - deep

    def on(angle: float) -> str:
        there = math.radians(angle)
        return f"{reach * math.sin(there):.3f} 0 {middle + reach * math.cos(there):.3f} mm"

    strokes = "".join(f'<to pos="{on(angle)}" in="{each} s"/>' for angle in degrees)
    above = f"0 0 {middle + radius + RADIUS + 12.0} mm"
    return world, (
        f'<to pos="{above}" in="0.1 s" hold="0.1 s"/><to pos="{on(0.0)}" in="0.5 s" hold="0.3 s"/>{strokes}'
        f'<to pos="{above}" in="0.4 s"/>'
    )


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

    @property
    def total(self) -> Floats:
        """Return the force of arm and plate, shape (n, 3)."""
        return self.arm + self.pad[:, None] * np.array([0.0, 0.0, 1.0])

    @property
    def steps(self) -> Floats:
        """Return how much the force on the finger changed since the tick before [N]."""
        return np.r_[0.0, np.linalg.norm(np.diff(self.total, axis=0), axis=1)]

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
        return (np.flatnonzero(self.touching[1:] & ~self.touching[:-1]) + 1).tolist()

    def changing(self) -> NDArray[np.bool_]:
        """Return the ticks of a contact in and after a change, without first impacts.

        Nor those in which the arm alone gives the virtual force, as in the tick before: its steps are the contact's.
        """
        own = ~self.renders & (np.linalg.norm(self.arm - self.virtual, axis=1) < 1e-9) & (self.pad == 0.0)
        own[1:] &= own[:-1]
        return self.touching & self.after(self.changes(), 0.3) & ~self.after(self.begins(), 0.05) & ~own

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


def follow(session: itouch.Session, seconds: float | None = None) -> Course:
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
        a[:, 15], a[:, 16], a[:, 17], a[:, 18], a[:, 19], session.report(), session.scene.safety.force,
    )  # fmt: skip
