"""A stranger's modality computes the desired flux, by a model of its own: `flux-control` renders it on the plate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from third_party_plugins import install

import itouch
from itouch_tools.cli.__main__ import main

PLUGIN = '''"""The flux of a body with a skin of its own: it begins at once, and falls as the body warms."""

import math
from dataclasses import dataclass

from itouch.plugin import Contact, Field, Modality, Role, schema


@dataclass(frozen=True, slots=True)
class Lump:
    at: str = schema.ref("probe", doc="the finger")
    start: float = schema.quantity("W/m^2", low=-5e3, high=5e3, default=1500.0, doc="flux at first")
    lag: float = schema.quantity("s", low=0.01, high=100.0, default=1.5, doc="time constant of its fall")


class Lumped(Modality):
    Params = Lump
    subscribes_to = frozenset({Contact.BEGIN, Contact.END})

    def compile(self, name, params, world):
        return name, params

    def fields(self, model):
        return (
            Field("object", "i8", unit="1", doc="1 in contact"),  # a name that others use for something else
            Field("finger", unit="s", doc="how long it has been touched"),
            Field("wanted", unit="W/m^2", role=Role.HEAT_FLUX, doc="flux out of the finger"),
        )

    def reset(self, model, state):
        pass

    def on_contact(self, event, model, state):
        state[f"{model[0]}.object"] = int(event.kind is Contact.BEGIN)
        state[f"{model[0]}.finger"] = 0.0

    def update(self, model, state, period):
        name, params = model
        flux = 0.0
        if state[f"{name}.object"].item():
            flux = params.start * math.exp(-state[f"{name}.finger"].item() / params.lag)
            state[f"{name}.finger"] += period
        state[f"{name}.wanted"] = flux
'''
SCENE = """<itouch version="1.0" xmlns:lump="urn:itouch:plugin:lump" xmlns:xyz-table="urn:itouch:plugin:xyz-table"
    xmlns:thermal="urn:itouch:plugin:thermal">
  <materials><material name="m"><contact stiffness="800 N/m"/>{material}</material></materials>
  <world temperature="23 degC"><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices>
    <device name="arm" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/></device>
    <device name="table" plugin="xyz-table"><mount pos="0 0 -34 mm"/><limits speed="0.25 m/s"/>
      <xyz-table:hardware travel="200 140 80 mm"/></device>
    <device name="peltier" plugin="thermal"><mount on="table" pos="0 0 4 mm"/>
      <limits current="6 A" temperature="15 40 degC"/><thermal:hardware/></device>
  </devices>
  <interaction>
    <probe name="tip" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="tip" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="33 degC"><motion>
      <to pos="0 0 44 mm" in="0.3 s" hold="2 s"/><to pos="0 0 24 mm" in="0.5 s" hold="3 s"/>
      <to pos="0 0 44 mm" in="0.5 s" hold="0.3 s"/></motion></operator>
    <thermal:flux-control display="peltier" desired-from="{name}" controller="{controller}"/>
    <lump:lumped name="{name}" at="tip"{more}/>
  </interaction>
</itouch>
"""


def put(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, role: str = "Role.HEAT_FLUX", **given: str) -> Path:
    """Install the plugin, and return a scene with it."""
    module = "a_lump" if role == "Role.HEAT_FLUX" else "a_lump_of_no_role"
    listed = f"[itouch.modalities]\nlump.lumped = {module}:Lumped\n"
    site = install(tmp_path / "site", module, listed, code=PLUGIN.replace("Role.HEAT_FLUX", role))
    monkeypatch.syspath_prepend(str(site))
    usual = {"name": "body", "controller": "model", "more": "", "material": ""}
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(**{**usual, **given}), encoding="utf-8")
    return path


def course(path: Path, name: str = "body") -> tuple[dict[str, Any], Any, Any]:
    """Run a scene; return its only contact, and desired and true flux [W/m2] in each tick of it."""
    session = itouch.build(path)
    asked, drawn = [], []
    while not session.done:
        session.tick()
        if session.state[f"{name}.object"].item():
            asked.append(session.state[f"{name}.wanted"].item())
            drawn.append(session.state["peltier.twin.true_flux"].item())
    (entry,) = session.report()["contacts"]
    return entry, np.array(asked), np.array(drawn)


def settled(asked: Any, drawn: Any) -> Any:
    """Return the error [1] of the flux while the finger lies on the plate, from 0.7 s on after the touch began."""
    return (drawn[700:2900] - asked[700:2900]) / np.abs(asked[700:2900])


@pytest.mark.parametrize(
    ("controller", "more", "bound"),
    [
        ("model", "", 0.02),
        ("model", ' start="-600 W/m^2" lag="3 s"', 0.02),  # a body that is warmer than the skin
        ("paper", ' start="900 W/m^2" lag="30 s"', 0.05),
    ],
)
def test_the_plate_draws_what_it_asks_for_on_an_object_without_a_thermal_material(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, controller: str, more: str, bound: float
) -> None:
    entry, asked, drawn = course(put(tmp_path, monkeypatch, controller=controller, more=more))
    assert entry["plate"] is True and entry["plate_ready"] is True
    assert np.abs(settled(asked, drawn)).max() < bound
    assert entry["mean_flux_W_m2"] == pytest.approx(drawn[drawn != 0.0].mean(), rel=0.03)


def test_names_decide_nothing_and_a_restored_session_goes_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = put(tmp_path, monkeypatch)
    session = itouch.build(path)
    session.run(3.6)  # in the touch
    session.save(tmp_path / "s.itouch")
    session.run(0.5)
    other = itouch.restore(tmp_path / "s.itouch")
    other.run(0.5)
    assert other.state.tobytes() == session.state.tobytes()
    renamed = itouch.build(put(tmp_path, monkeypatch, name="finger"))
    renamed.run(4.1)
    drawn = "peltier.twin.true_flux"
    assert renamed.state[drawn].item() == session.state[drawn].item() > 300.0


def test_what_computes_no_heat_flux_is_refused_at_its_attribute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = put(tmp_path, monkeypatch, role="Role.SIGNAL")
    assert main(["check", str(path)]) == 2
    told = "".join(capsys.readouterr())
    assert "desired-from = 'body' is not a modality that computes a heat flux" in told
    assert "scene.xml:17:45" in told and "a field of State of the role HEAT_FLUX" in told
