"""A Peltier pad that somebody else has made, worn on the finger: its twin feels contact and skin, its heat reaches both."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from third_party_plugins import install

import itouch
from itouch.plugin import Bound
from itouch.twin import skin_under_devices
from itouch.world.state_fields import CELLS
from itouch_tools.cli import main as cli

PLUGIN = '''"""A small Peltier pad strapped to the fingertip, and a tactor, from an outside distribution."""

from dataclasses import dataclass

from itouch.plugin import (
    Channel, Contact, Device, DeviceError, Field, Modality, Role, Twin, plate_temperature, schema, temperature_target,
)


@dataclass(frozen=True, slots=True)
class Strap:
    resistance: float = schema.quantity("m^2*K/W", low=1e-4, high=1.0, default=2e-3, doc="between skin and pad")
    lag: float = schema.quantity("s", low=0.0, high=10.0, default=0.3, doc="time constant of the pad")


class PadTwin(Twin):
    def fields(self):
        return (
            Field("face", unit="K", doc="temperature of the pad", role=Role.SKIN_CONTACT_TEMPERATURE),
            Field("felt", unit="N", doc="what has pressed on the pad", role=Role.CONTACT_FORCE),
        )

    def reset(self, state, rng):
        state["face"] = 306.15

    def step(self, state, command, touch, period):
        target = command["target"].item() or 306.15
        state["face"] += period / self.params.lag * (target - state["face"].item())
        state["felt"] = max(state["felt"].item(), touch.force)
        touch.heat_flux[0] = (touch.skin_temperature[0] - state["face"].item()) / self.params.resistance

    def read(self, state, reading):
        reading["bulk"] = state["face"]
        return True


class Pad(Device):
    Params = Strap
    reads = (Channel("bulk", 1, "K", (250.0,), (330.0,), role=Role.SKIN_CONTACT_TEMPERATURE, doc="the pad"),)
    commands = (
        Channel("target", 1, "K", (0.0,), (320.0,), safe=(0.0,), role=Role.TEMPERATURE_TARGET, doc="0: off"),
    )
    Twin = PadTwin

    def open(self):
        raise DeviceError("no pad here")

    def close(self):
        pass

    def read(self, reading):
        return False


@dataclass(frozen=True, slots=True)
class Cold:
    pad: str = schema.ref("device", doc="the pad")
    to: float = schema.temperature(low=280.0, high=315.0, default=298.15, doc="while something is touched")


class Chill(Modality):
    """Cools the pad while the finger touches anything."""

    Params = Cold
    subscribes_to = frozenset({Contact.BEGIN, Contact.END})

    def compile(self, name, params, world):
        return (f"{name}.on", f"{params.pad}.command.target", params)

    def fields(self, model):
        return (Field("on", "i8", unit="1", doc="1 in contact"),)

    def commands(self, model):
        return (f"{model[2].pad}.target",)

    def reset(self, model, state):
        state[model[0]] = 0

    def on_contact(self, event, model, state):
        state[model[0]] = int(event.kind is Contact.BEGIN)

    def update(self, model, state, period):
        state[model[1]] = model[2].to if state[model[0]].item() else 306.15
'''
PLATE = """<device name="table" plugin="xyz-table"><mount pos="0 0 -34 mm"/><limits speed="0.25 m/s"/>
    <xyz-table:hardware travel="200 140 80 mm"/></device>
  <device name="peltier" plugin="thermal"><mount on="table" pos="0 0 4 mm"/>
    <limits current="6 A" temperature="15 40 degC"/><thermal:hardware/></device>"""
SCENE = """<itouch version="1.0" xmlns:polar="urn:itouch:plugin:polar" xmlns:chill="urn:itouch:plugin:chill"
    xmlns:usb-arm="urn:itouch:plugin:usb-arm" xmlns:xyz-table="urn:itouch:plugin:xyz-table"
    xmlns:thermal="urn:itouch:plugin:thermal">
  <materials><material name="m"><contact stiffness="800 N/m"/></material></materials>
  <world temperature="23 degC"><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices>
    <device name="stick" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/><usb-arm:hardware/></device>
    {plate}
    <device name="glove" plugin="polar"><mount on="stick" pos="0 0 -8 mm"/>
      <limits temperature="15 40 degC"/><polar:hardware/></device>
  </devices>
  <interaction>
    <probe name="tip" radius="8 mm" pose-from="stick" force-to="stick" {surface}/>
    <operator probe="tip" skin-temperature="33 degC"><motion>
      <to pos="0 0 36 mm" in="0.1 s" hold="0.2 s"/><to pos="0 0 26 mm" in="0.3 s" hold="1 s"/>
      <to pos="0 0 36 mm" in="0.3 s" hold="0.3 s"/></motion></operator>
    <chill:chill pad="glove"/>
  </interaction>
</itouch>
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    listed = "[itouch.devices]\npolar = polar_glove:Pad\n[itouch.modalities]\nchill = polar_glove:Chill\n"
    site = install(tmp_path / "site", "polar-glove", listed, code=PLUGIN)
    monkeypatch.syspath_prepend(str(site))
    path = tmp_path / "worn.xml"
    path.write_text(SCENE.format(plate="", surface=""))
    return path


def test_heat_of_a_worn_pad_reaches_the_skin_and_is_told(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli(["check", str(scene)]) == 0
    assert "'glove' is worn on the finger 'tip'" in "".join(capsys.readouterr())
    session = itouch.build(scene)
    assert any(step.name == "worn tip" for step in session.plan.steps)
    rows, names = [], ("tip.object", "tip.skin", "tip.taken", "glove.bulk")
    while not session.done:
        session.tick()
        rows.append([session.state[name].reshape(-1)[0].item() for name in names])
    touched, warmth, taken, bulk = np.array(rows).T
    on = np.flatnonzero(touched >= 0)
    assert warmth[: on[0]].min() > 306.14  # a pad at the skin's temperature does not cool it
    assert warmth[on[-1]] < 304.0
    assert taken[on] == pytest.approx((warmth[on] - bulk[on]) / 2e-3, abs=60.0)  # what is read is a tick old
    force = session.report()["contacts"][0]["peak_force_N"]
    assert session.state["glove.twin.felt"].item() == pytest.approx(force, rel=1e-3)
    told = session.report()["devices"]["glove"]
    assert told["worn_by"] == "tip"
    assert told["skin_degC"]["lowest"] == pytest.approx(warmth.min() - 273.15, abs=1e-6)
    json.dumps(session.report())


def test_a_hand_waits_for_the_skin_that_is_worn_on(scene: Path) -> None:
    """Nothing reads the skin here: the finger's twin tells it."""
    text = SCENE.format(plate="", surface="").replace('hold="0.3 s"/>', 'hold="until skin 0.3 K"/>')
    scene.write_text(text)
    session = itouch.build(scene)
    session.run()
    (entry,) = session.report()["waits"]
    assert entry["back"] is True and entry["waited_s"] > 0.5
    assert 33.0 < entry["baseline_degC"] < 33.1  # of the time before the touch alone; the pad keeps the air away
    assert entry["skin_degC"] == pytest.approx(entry["baseline_degC"] - 0.3, abs=0.05)


def test_a_restored_session_has_the_same_skin(scene: Path, tmp_path: Path) -> None:
    session = itouch.build(scene)
    session.run(1.0)
    session.save(tmp_path / "s.itouch")
    session.run(0.3)
    other = itouch.restore(tmp_path / "s.itouch")
    other.run(0.3)
    assert other.state.tobytes() == session.state.tobytes()


def test_a_plate_feels_the_skin_that_is_worn_on(scene: Path) -> None:
    """Where a plate's twin owns the tissue there is one skin for both."""
    skins = {}
    for pad in ("25 degC", "33 degC"):
        text = SCENE.format(plate=PLATE, surface='surface-to="table"').replace('pad="glove"', f'pad="glove" to="{pad}"')
        scene.write_text(text)
        session = itouch.build(scene)
        session.run()
        skins[pad] = session.state["peltier.twin.true_skin"].item()
        assert session.state["tip.skin"][0] == pytest.approx(skins[pad], abs=0.02)
    assert skins["25 degC"] < skins["33 degC"] - 0.5


def test_there_is_one_skin_where_another_probe_of_the_finger_meets_the_plate(scene: Path) -> None:
    other = '/><probe name="other" radius="8 mm" pose-from="stick" surface-to="table"'
    scene.write_text(SCENE.format(plate=PLATE, surface=other))
    session = itouch.build(scene)
    session.run(1.0)
    assert session.state["tip.taken"].item() > 200.0
    own = session.state["peltier.twin.true_skin"].item()
    assert own < 305.5
    assert session.state["tip.skin"][0] == pytest.approx(own, abs=0.02)


@pytest.mark.parametrize("period", [1e-3, 2.5e-4])
def test_the_skin_is_a_thick_body_at_first(period: float) -> None:
    """A step of flux into a half-space: the surface rises by 2 q sqrt(t / pi) / e (Carslaw and Jaeger 1959, 2.9)."""
    tissue, now = np.zeros(CELLS), np.zeros(3)
    taken, flux = np.array([400.0]), 400.0
    step = Bound(
        skin_under_devices.wear, skin_under_devices.column(period), tissue, now, np.zeros(0), taken, np.zeros(1), np.zeros(1), np.zeros((1, 2)),
        0.0, 0.0,
    )  # fmt: skip
    effusivity = math.sqrt(skin_under_devices.CONDUCTIVITY * skin_under_devices.CAPACITY)
    for tick in range(1, round(0.8 / period) + 1):
        step()
        if tick * period in (0.1, 0.2, 0.4, 0.8):
            assert now[skin_under_devices.NOW] == pytest.approx(
                -2.0 * flux * math.sqrt(tick * period / math.pi) / effusivity, rel=0.03
            )
    thick = skin_under_devices.FIRST * skin_under_devices.GROWTH ** np.arange(CELLS)
    assert (tissue * thick).sum() * skin_under_devices.CAPACITY == pytest.approx(-flux * 0.8, rel=0.02)
