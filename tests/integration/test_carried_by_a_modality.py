"""A stranger's modality brings a stranger's robot to the finger: the framework's own way stands back, its limits do not."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_outside_surface import PLUGIN, SCENE

import itouch
from itouch.cli.__main__ import main

CARRIER = """
from dataclasses import dataclass
import numpy as np

from itouch.plugin import Carries, Field, Modality, Role, schema

@dataclass(frozen=True, slots=True)
class Brings:
    probe: str = schema.ref("probe", doc="the finger")
    robot: str = schema.ref("device", doc="what brings it")
    stands_off: float = schema.quantity("m", low=1e-3, high=0.1, default=0.012, doc="how far away it waits")
    error: str = schema.text(default="", doc="what it does wrong, for a test")


class Hover(Modality):
    "Keeps the prop where the virtual surface is, or well away from the finger."
    Params = Brings

    def compile(self, name, params, world):
        robot = world.devices[params.robot]
        return dict(
            name=name, params=params, radius=world.probes[params.probe],
            goal=f"{params.robot}.command.{robot.command(Role.SURFACE_POSE).name}",
            channel=f"{params.robot}.{robot.command(Role.SURFACE_POSE).name}",
            prop=robot.read_field(Role.TRACKED_POSE),
        )

    def fields(self, model):
        return tuple(Field(name, unit=unit, doc="how the prop stands") for name, unit in
                     (("renders", "1"), ("there", "1"), ("away", "m"), ("short", "m")))

    def commands(self, model):
        return () if model["params"].error == "silent" else (model["channel"],)

    def carries(self, model):
        away = "nothing" if model["params"].error == "nameless" else "away"
        return Carries(model["params"].probe, model["params"].robot, "renders", "there", away, "short")

    def reset(self, model, state):
        state[f"{model['name']}.away"] = state[f"{model['name']}.short"] = np.inf

    def update(self, model, state, period):
        probe, own, params = model["params"].probe, model["name"], model["params"]
        x, y, z = state[f"{probe}.hip"].tolist()
        height, lowest = float(state[f"{probe}.surface_height"]), z - model["radius"]
        upright = float(state[f"{probe}.surface.upright"]) > 0.95
        goal = state[model["goal"]]
        goal[:2], goal[3:] = (x, y), (1, 0, 0, 0)
        goal[2] = max(height, lowest - params.stands_off) if upright else lowest - params.stands_off
        top = float(state[model["prop"]][2])
        state[f"{own}.renders"] = upright
        state[f"{own}.away"] = np.nan if params.error == "nan" and float(state["tick"]) > 500 else lowest - top
        state[f"{own}.short"] = height - top if np.isfinite(height) else np.inf
        state[f"{own}.there"] = upright and lowest - top < 3e-4
        if params.error == "far":
            goal[2] = 5.0
"""
ASKED = '<robo:brings probe="tip" robot="presenter"{0}/>\n    <operator'
NUMBERS = itertools.count()


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Return what writes a scene whose surface the modality brings, with plugin and robot installed."""
    info = tmp_path / "site" / "robo-1.0.dist-info"
    info.mkdir(parents=True)
    module = f"robo_{next(NUMBERS)}"
    (info.parent / f"{module}.py").write_text(PLUGIN + CARRIER)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: robo\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        f"[itouch.devices]\nrobo = {module}:Presenter\n[itouch.modalities]\nrobo.brings = {module}:Hover\n"
    )
    monkeypatch.syspath_prepend(str(info.parent))

    def written(attributes: str = "") -> Path:
        text = SCENE.replace("<operator", ASKED.format(attributes), 1)
        text = text.replace('xmlns:usb-arm="', 'xmlns:robo="urn:itouch:plugin:robo" xmlns:usb-arm="', 1)
        path = tmp_path / f"{next(NUMBERS)}.xml"
        path.write_text(text)
        return path

    return written


def run(path: Path) -> tuple[Any, list[float]]:
    """Run a scene; return the session, and how far below the finger's pad the prop was, at each tick."""
    session = itouch.build(path)
    away: list[float] = []
    state = session.state
    session.taps.append(lambda tick: away.append(float(state["tip.hip"][2] - 0.008 - state["presenter.prop"][2])))
    session.run()
    return session, away


def test_it_is_what_is_felt_and_waits_where_its_author_says(scene: Callable[..., Path]) -> None:
    session, away = run(scene())
    report = session.report()
    (contact,) = report["contacts"]
    assert report["faults"] == []
    assert contact["plate"] is True
    assert contact["peak_force_N"] > 0.3
    assert abs(contact["plate_gap_mm"]) < 0.5
    assert away[400] == pytest.approx(0.012, abs=1e-4)  # the framework's own way keeps 5 mm


def test_while_it_renders_the_arm_does_not_and_where_it_does_not_the_arm_does(scene: Callable[..., Path]) -> None:
    session = itouch.build(scene())
    found: list[tuple[float, float, float]] = []
    state = session.state
    session.taps.append(
        lambda tick: found.append((float(state["tip.plate"]), -float(state["presenter.strain"][2]),
                                   float(np.linalg.norm(state["stick.sent.wrench"][:3]))))
    )  # fmt: skip
    session.run()
    pressed = [(load, arm) for there, load, arm in found if there and load > 0.2]
    assert len(pressed) > 200
    assert max(arm for _, arm in pressed[50:]) < 0.05
    assert all(not there for there, _, _ in found[:400])


def test_its_step_stands_before_the_force_and_what_may_overrule_it_is_shown(
    scene: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene()
    assert main(["inspect", str(path), "--plan", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["steps"]
    names = [row["step"] for row in rows]
    assert names.index("contact tip") < names.index("below tip") < names.index("brings") < names.index("surface tip")
    assert names.index("surface tip") < names.index("force tip") < names.index("guard presenter")
    (mine,) = [row for row in rows if row["step"] == "brings"]
    (taken,) = [row for row in rows if row["step"] == "surface tip"]
    assert "presenter.command.prop_goal" in mine["writes"]
    assert taken["amends"] == ["presenter.command.prop_goal"]
    assert "presenter.command.prop_goal" not in taken["writes"]


def test_the_limits_of_a_surface_hold_for_it(scene: Callable[..., Path]) -> None:
    """It asks for a height of five metres: the prop rises to its end of travel, no faster than it may, or it trips."""
    session = itouch.build(scene(' error="far"'))
    heights: list[float] = []
    state = session.state
    session.taps.append(lambda tick: heights.append(float(state["presenter.sent.prop_goal"][2])))
    try:
        session.run()
    except itouch.DeviceFaultError:
        assert session.report()["faults"][0]["device"] in ("presenter", "stick")
    steps = np.diff(heights)
    assert max(heights) <= 0.06 + 1e-12
    assert steps.max() <= 0.25e-3 + 1e-9
    near = [step for step, gap in zip(steps, heights, strict=False) if gap > 0.03]
    assert near
    assert max(near) <= 0.10e-3 + 1e-9


def test_what_is_not_a_number_stops_and_names_it(scene: Callable[..., Path]) -> None:
    session = itouch.build(scene(' error="nan"'))
    with pytest.raises(itouch.DeviceFaultError, match="brings.away"):
        session.run()
    (fault,) = session.report()["faults"]
    assert fault["trip"] == "modality-error"
    assert fault["safe"]["reached"]


def test_restored_in_the_middle_of_a_touch_it_goes_on_as_it_was(scene: Callable[..., Path]) -> None:
    path = scene()
    whole = itouch.build(path)
    whole.enable()
    whole.run(1.0)
    kept = whole.state.tobytes()
    whole.run(0.4)
    other = itouch.build(path)
    other.enable()
    other.adopt(kept)
    other.run(0.4)
    assert other.state.tobytes() == whole.state.tobytes()


@pytest.mark.parametrize(
    ("attributes", "said"),
    [
        (' error="silent"', "does not command 'prop_goal'"),
        (' error="nameless"', "field 'nothing', which it does not declare"),
    ],
)
def test_what_it_says_wrong_is_a_problem_of_its_element(
    scene: Callable[..., Path], attributes: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(scene(attributes))]) == 2
    out = capsys.readouterr()
    assert said in out.out + out.err
    assert "[modality]" in out.out + out.err
