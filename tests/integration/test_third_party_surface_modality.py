"""A stranger's modality brings a stranger's robot to the finger: the default stands back, the framework's limits do not."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_third_party_surface import PLUGIN, SCENE
from third_party_plugins import install

import itouch
from itouch.plugin.discovery import Catalog
from itouch.testing.declared_fields import carries
from itouch.testing.scenario import ModalityHarness
from itouch_tools.cli.__main__ import main

EXAMPLE = (
    (Path(__file__).parent / "brings_a_surface.py")
    .read_text(encoding="utf-8")
    .replace("from __future__ import annotations\n", "")
)
WRONG = """

@dataclass(frozen=True, slots=True)
class Asked(Brings):
    error: str = schema.text(default="", doc="what it does wrong")


class Wrong(Hover):
    Params = Asked

    def compile(self, name, params, world):
        Wrong.error = params.error
        return super().compile(name, params, world)

    def commands(self, model):
        return () if self.error == "silent" else super().commands(model)

    def surface_fields(self, model):
        carries = super().surface_fields(model)
        if self.error == "nameless":
            return carries._replace(distance="nothing")
        if self.error in ("unyielding", "lying"):
            return carries._replace(yield_distance="missed", remaining_distance="")
        return carries._replace(fault="missed") if self.error in ("missed", "coming", "both") else carries

    def fields(self, model):
        return (*super().fields(model), Field("missed", unit="1", doc="why the prop renders no more"))

    def update(self, model, state, period):
        super().update(model, state, period)
        if self.error == "nan" and state["tick"].item() > 500:
            state[f"{model.name}.away"] = float("nan")
        if self.error == "lying":
            state[f"{model.name}.missed"] = 0.1
            state[f"{model.name}.away"] -= 0.05
        if self.error == "both":
            state[f"{model.name}.missed"] = 1.0
        if self.error in ("missed", "coming") and state["tick"].item() >= 1200:
            state[f"{model.name}.missed"], state[f"{model.name}.renders"] = 1.0, 0.0
        if self.error == "coming":
            state[f"{model.name}.coming"] = 5e-3
        if self.error == "endless":
            state[f"{model.name}.coming"] = math.inf
        if self.error == "half":
            state[f"{model.name}.there"] = 0.5
        if self.error == "far":
            state[f"{model.robot}.command.{model.channel}"][2] = 5.0
"""
ASKED = '<robo:brings probe="tip" robot="presenter"{0}/>\n    <operator'
NUMBERS = itertools.count()


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Return what writes a scene whose surface the modality brings, with plugin and robot installed."""
    module = f"robo_{next(NUMBERS)}"
    listed = f"[itouch.devices]\nrobo = {module}:Presenter\n[itouch.modalities]\nrobo.brings = {module}:Wrong\n"
    site = install(tmp_path / "site", "robo", listed, module=module, code=PLUGIN + EXAMPLE + WRONG)
    monkeypatch.syspath_prepend(str(site))

    def written(attributes: str = "", mount: str = "") -> Path:
        text = SCENE.replace("<operator", ASKED.format(attributes), 1)
        text = text.replace('plugin="robo">', f'plugin="robo">{mount}', 1)
        text = text.replace('xmlns:usb-arm="', 'xmlns:robo="urn:itouch:plugin:robo" xmlns:usb-arm="', 1)
        path = tmp_path / f"{next(NUMBERS)}.xml"
        path.write_text(text)
        return path

    return written


def run(path: Path, base: float = 0.0) -> tuple[Any, list[float]]:
    """Run a scene; return the session, and how far below the finger's pad the prop was, at each tick.

    ``base`` is the height of the robot's frame [m].
    """
    session = itouch.build(path)
    away: list[float] = []
    state = session.state
    session.taps.append(
        lambda tick: away.append(float(state["tip.hip"][2] - 0.008 - state["presenter.prop"][2] - base))
    )
    session.run()
    return session, away


@pytest.mark.parametrize(
    ("mount", "base"),
    [("", 0.0), ('<mount pos="10 -20 -12 mm" rpy="0 0 70 deg"/>', -0.012)],
    ids=["level at the origin", "turned and moved"],
)
def test_it_is_what_is_felt_and_waits_where_its_author_says(
    scene: Callable[..., Path], mount: str, base: float
) -> None:
    session, away = run(scene("", mount), base)
    report = session.report()
    (contact,) = report["contacts"]
    assert report["faults"] == []
    assert contact["plate"] is True
    assert contact["peak_force_N"] > 0.3
    assert abs(contact["plate_gap_mm"]) < 0.5
    assert away[400] == pytest.approx(0.012, abs=1e-4)  # the default keeps 5 mm


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
    ("error", "said"),
    [("", ""), ("both", "brings.renders is 1"), ("endless", "brings.coming is inf"), ("half", "brings.there is 0.5")],
)
def test_the_suite_finds_what_it_says_of_its_surface_and_cannot_be(
    scene: Callable[..., Path], error: str, said: str
) -> None:
    path = scene(f' error="{error}"')
    cls = Catalog().modality("robo", "brings")
    assert cls is not None
    finding = carries.examine(ModalityHarness(cls, path))
    assert finding.outcome == ("failed" if error else "passed"), finding.note
    assert said in finding.note


def test_a_surface_that_is_missed_is_told_with_its_first_place(scene: Callable[..., Path]) -> None:
    """Its author finds that the prop is not felt: the contact becomes the arm's, and the report says where and when."""
    session, _ = run(scene(' error="missed"'))
    state = session.state
    (told,) = (line for line in session.report()["notices"] if "should have been felt" in line)
    assert "1.200 s" in told
    assert state["tip.surface.missed"] == 1.0
    assert state["tip.surface.misses"] == 1.0
    assert session.report()["contacts"][0]["plate_missed"] is True


def test_one_that_says_that_it_yields_and_does_not_is_lowered_as_others_are(scene: Callable[..., Path]) -> None:
    """The finger comes down quickly, 18 mm deep: the framework lowers the prop by what its author leaves out (K4).

    So it does where the author says, besides, that the prop is nearer than its device reads.
    """
    most: dict[str, float] = {}
    for error in ("", "unyielding", "lying"):
        path = scene(f' error="{error}"')
        path.write_text(path.read_text().replace('pos="0 0 25 mm" in="0.5 s"', 'pos="0 0 10 mm" in="0.15 s"', 1))
        session = itouch.build(path)
        loads: list[float] = []
        gave: list[float] = []
        state = session.state
        session.taps.append(
            lambda tick, loads=loads, gave=gave, state=state: (
                loads.append(-float(state["presenter.strain"][2])), gave.append(float(state["tip.plate_yield"]))
            )
        )  # fmt: skip
        session.run()
        assert max(gave) > 0.0
        most[error] = max(loads)
    assert most["unyielding"] == pytest.approx(most[""], abs=0.02)
    assert most["unyielding"] < 2.1
    assert most["lying"] < 2.1


def test_a_touch_off_goes_by_what_the_device_reads_of_itself(scene: Callable[..., Path]) -> None:
    """Its author says that the prop is 50 mm nearer than it is; the mount is 3 mm off."""
    found: dict[str, float] = {}
    for error in ("", "lying"):
        mount = '<mount pos="0 0 0 mm" mount-error="0 0 3 mm"/><calibration method="touch-off"/>'
        session = itouch.build(scene(f' error="{error}"', mount))
        session.run(until=lambda session=session: bool(session.state["ready"]) or session.ticks >= 9000)
        assert session.state["ready"].item() == 1
        found[error] = session.state["presenter.calibration"][2].item()
    assert found[""] == pytest.approx(-3e-3, abs=1e-4)
    assert found["lying"] == pytest.approx(found[""], abs=1e-5)


def test_the_force_is_led_over_as_long_as_the_surface_is_coming(scene: Callable[..., Path]) -> None:
    """It is led over for 0.3 s at least, and as long as its author says that the prop is still to go."""
    left: dict[str, float] = {}
    for error in ("missed", "coming"):
        session = itouch.build(scene(f' error="{error}"'))
        state = session.state
        session.enable()
        session.run(1.6)
        left[error] = float(state["tip.surface.changing"])
    assert left == {"missed": 0.0, "coming": pytest.approx(0.05)}


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


def test_a_probe_that_is_met_by_no_surface_is_a_problem_of_its_attribute(
    scene: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene()
    path.write_text(path.read_text().replace(' surface-to="presenter"', "", 1))
    assert main(["check", str(path)]) == 2
    out = "".join(capsys.readouterr())
    assert "modality 'brings': 'tip' has no surface-to" in out
    assert "KeyError" not in out


@pytest.mark.parametrize("keeps", [frozenset(), frozenset({"clearance"})], ids=["none", "clearance"])
def test_attributes_that_it_does_not_keep_to_are_warned_of(
    scene: Callable[..., Path], keeps: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clearance of a probe is the framework's to keep, unless the modality says that it does."""
    path = scene()
    path.write_text(path.read_text().replace('surface-to="presenter"', 'surface-to="presenter" clearance="8 mm"', 1))
    cls = Catalog().modality("robo", "brings")
    assert cls is not None
    monkeypatch.setattr(cls, "probe_attributes", keeps)
    said = [line for line in itouch.build(path).report()["notices"] if "clearance of probe 'tip' has no effect" in line]
    assert bool(said) is not bool(keeps)
