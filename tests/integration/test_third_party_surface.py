"""A robot arm that presents a prop, from an outside distribution, is the surface that a probe meets: by its roles alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from third_party_plugins import install

import itouch

PLUGIN = """
from dataclasses import dataclass

from itouch.plugin import RETRACT, Channel, Device, DeviceError, Field, Role, Twin, schema

LOW, HIGH = (-0.1, -0.1, -0.05, -1, -1, -1, -1), (0.1, 0.1, 0.06, 1, 1, 1, 1)


@dataclass(frozen=True, slots=True)
class Reach:
    lag: float = schema.quantity("s", low=1e-3, high=1.0, default=4e-3, doc="time constant of its drives")


class Moves(Twin):
    def fields(self):
        return Field("tip", "f8", 3, unit="m", doc="the prop"), Field("load", "f8", 3, unit="N", doc="on the prop")

    def reset(self, state, rng):
        state["tip"] = 0.0

    def position(self, state):
        return state["tip"]

    def step(self, state, command, touch, period):
        state["tip"] += (command["prop_goal"][:3] - state["tip"]) * min(1.0, period / self.params.lag)
        state["load"] = touch.wrench[:3]

    def read(self, state, reading):
        reading["prop"][:3], reading["prop"][3:] = state["tip"], (1, 0, 0, 0)
        reading["strain"][:3], reading["strain"][3:] = state["load"], 0
        return True


class Presenter(Device):
    Params, Twin = Reach, Moves
    reads = (
        Channel("prop", 7, "m", LOW, HIGH, role=Role.TRACKED_POSE, doc="the prop"),
        Channel("strain", 6, "N", (-20.0,) * 6, (20.0,) * 6, role=Role.CONTACT_FORCE, doc="on the prop"),
    )
    commands = (Channel("prop_goal", 7, "m", LOW, HIGH, safe=RETRACT, role=Role.SURFACE_POSE, doc="where to"),)

    def open(self):
        raise DeviceError("no robot here")

    def close(self):
        pass

    def read(self, reading):
        return False
"""
SCENE = """<itouch version="1.0" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials><material name="m"><contact stiffness="800 N/m"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices>
    <device name="stick" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/><usb-arm:hardware/></device>
    <device name="presenter" plugin="robo"><limits speed="0.25 m/s"/></device>
  </devices>
  <interaction>
    <probe name="tip" radius="8 mm" pose-from="stick" force-to="stick" surface-to="presenter"/>
    <operator probe="tip"><motion><to pos="0 0 40 mm" in="0.2 s" hold="0.5 s"/>
      <to pos="0 0 25 mm" in="0.5 s" hold="0.5 s"/><to pos="0 0 40 mm" in="0.3 s" hold="0.2 s"/></motion></operator>
  </interaction>
</itouch>
"""


def test_a_prop_that_a_strangers_robot_presents_is_what_is_felt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = install(tmp_path / "site", "robo", "[itouch.devices]\nrobo = robo:Presenter\n", code=PLUGIN)
    monkeypatch.syspath_prepend(str(site))
    (tmp_path / "s.xml").write_text(SCENE)
    session = itouch.build(tmp_path / "s.xml")
    session.run()
    report = session.report()
    (contact,) = report["contacts"]
    assert report["faults"] == []
    assert contact["plate"] is True
    assert contact["peak_force_N"] > 0.3
    assert abs(contact["plate_gap_mm"]) < 0.5
