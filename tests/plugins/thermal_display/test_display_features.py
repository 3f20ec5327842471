"""Dew, data sheets, what differs in the plant, limits of the published controllers, energy over a whole run, commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from display_scenes import CONTROL, Display

import itouch
from itouch_thermal import bench_display, cli
from itouch_thermal.display import Datasheet, DisplayParams, plant
from itouch_thermal.display.column import plate_capacity
from itouch_thermal.flux.condensation import driest, warning
from itouch_thermal.flux.flux_control_params import FluxControlParams, MaterialCurve

AVOID = '<thermal:flux-control display="peltier" desired-from="heat" condensation="avoid"/>'


def hardware(text: str) -> str:
    return f"<thermal:hardware {text}/>"


# --- dew ---------------------------------------------------------------------------------------------------------


def test_check_and_report_warn_of_the_dew_point(scenes: Path) -> None:
    engine = itouch.build(Display(hardware=hardware('humidity="80 %"')).write(scenes))
    (notice,) = [text for text in engine.notices if "dew point" in text]
    assert "19.4 degC" in notice
    assert notice in engine.report()["notices"]
    said = engine.report()["modalities"]["flux-control"]
    assert said["dew_point_C"] == pytest.approx(19.38, abs=0.05)
    assert said["condensation_s"] == 0.0


def test_dry_air_gives_no_warning(scenes: Path) -> None:
    for humidity in ("0.5", "0"):
        engine = itouch.build(Display(hardware=hardware(f'humidity="{humidity}"')).write(scenes))
        assert not any("dew" in text for text in engine.notices)
        rig = scenes / "rigs" / "twin.xml"
        rig.write_text(rig.read_text().replace(hardware(f'humidity="{humidity}"'), "<thermal:hardware/>"))


def test_the_plate_can_be_kept_above_the_dew_point(scenes: Path) -> None:
    path = Display(hardware=hardware('humidity="0.95"'), control=AVOID, left="aluminium").write(scenes)
    text = path.read_text(encoding="utf-8")
    path.write_text(
        text.replace('material="aluminium"/>', 'material="aluminium" temperature="16 degC"/>'), encoding="utf-8"
    )
    engine = itouch.build(path)
    coldest = 400.0
    while not engine.done:
        engine.tick()
        coldest = min(coldest, float(engine.state["peltier.twin.true_plate"]))
    said = engine.report()["modalities"]["flux-control"]
    assert coldest - 273.15 > said["dew_point_C"]
    assert said["plate_band_C"][0] == pytest.approx(said["dew_point_C"] + 1.0)
    assert said["condensation_s"] == 0.0
    assert engine.report()["contacts"][0]["plate_limited"] is True


def test_a_plate_below_the_dew_point_is_counted(scenes: Path) -> None:
    engine = itouch.build(Display(hardware=hardware('humidity="0.99"'), room="24 degC").write(scenes))
    engine.run()
    assert engine.report()["modalities"]["flux-control"]["condensation_s"] > 0.1


def test_a_room_that_leaves_no_band_is_a_problem(scenes: Path) -> None:
    path = Display(hardware=hardware('humidity="1"'), control=AVOID, room="39.5 degC").write(scenes)
    with pytest.raises(itouch.SceneError, match="leaves nothing"):
        itouch.build(path)
    assert warning((288.15, 313.15), 280.0, 296.15, 0.4) == ""
    assert driest((288.15, 313.15), 280.0) == (288.15, 313.15)


# --- data sheets and differences -----------------------------------------------------------------------------------


def test_a_module_may_be_given_by_its_data_sheet(scenes: Path) -> None:
    sheet = (
        '<thermal:hardware><thermal:datasheet voltage="15.4 V" current="6.4 A" difference="68 K"/></thermal:hardware>'
    )
    scene = itouch.load(Display(hardware=sheet).write(scenes))
    (part,) = scene.device("peltier").parts
    assert part.params.seebeck == pytest.approx(15.4 / 300.15)
    assert part.params.resistance == pytest.approx(15.4 * (300.15 - 68.0) / (6.4 * 300.15))
    assert part.params.conductance == pytest.approx(15.4 * 6.4 * (300.15 - 68.0) / (2 * 300.15 * 68.0))
    again = DisplayParams(datasheet=part.params.datasheet, seebeck=part.params.seebeck)
    assert again.resistance == part.params.resistance


@pytest.mark.parametrize(
    "text",
    [
        '<thermal:datasheet voltage="15.4 V" current="6.4 A" difference="0.2 K"/>',
        '<thermal:datasheet voltage="0 V" current="6.4 A" difference="68 K"/>',
        '<thermal:datasheet voltage="1000 V" current="6.4 A" difference="68 K"/>',
        '<thermal:datasheet voltage="15.4 V" current="6.4 A"/>',
    ],
)
def test_a_data_sheet_that_can_not_be_is_a_problem(scenes: Path, text: str) -> None:
    with pytest.raises(itouch.SceneError) as fault:
        itouch.load(Display(hardware=f"<thermal:hardware>{text}</thermal:hardware>").write(scenes))
    assert len(fault.value.problems) == 1


def test_a_value_beside_the_data_sheet_must_agree() -> None:
    with pytest.raises(ValueError, match="contradicts"):
        DisplayParams(seebeck=0.03, datasheet=Datasheet(voltage=15.4, current=6.4, difference=68.0))


def test_every_mismatch_of_a_plant_comes_from_the_scene_and_the_bench_takes_it(
    scenes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = (
        "contact-resistance",
        "seebeck",
        "conductance",
        "resistance",
        "plate-effusivity",
        "finger-effusivity",
        "sensor-lag",
        "flux-gain",
    )
    off = " ".join(f'{name}="{2 + i} %"' for i, name in enumerate(names))
    text = f'<thermal:hardware><thermal:mismatch {off} plate-offset="0.04 K"/></thermal:hardware>'
    path = Display(hardware=text).write(scenes)
    (part,) = itouch.load(path).device("peltier").parts
    found = [getattr(part.params.mismatch, name.replace("-", "_")) for name in names]
    assert found == pytest.approx([0.01 * (2 + i) for i in range(len(names))])
    argv = ["--plant", str(path), "--materials", "wood", "--seconds", "0.5", "--no-bound"]
    assert bench_display.main(argv) == 0
    assert "wood" in capsys.readouterr().out
    assert bench_display.main([*argv[:1], str(scenes / "none.xml")]) == 2


# --- limits, energy ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("controller", ["paper", "hold"])
def test_published_controllers_keep_band_and_rate_in_the_touch(scenes: Path, controller: str) -> None:
    """Gains that are much too high: the plate swings, but neither out of its band nor past 10 K/s over half a second."""
    control = CONTROL.replace("/>", f' controller="{controller}" proportional="400" integral="3000 Hz"/>')
    path = Display(
        left="polystyrene", control=control, heat='<thermal:heat probe="finger" contact-resistance="1e-4"/>'
    ).write(scenes)
    engine = itouch.build(path)
    plates = []
    while not engine.done:
        engine.tick()
        in_touch = bool(engine.state["flux-control.touching"])
        plates.append(float(engine.state["peltier.twin.memory"][plant.MEAN]) if in_touch else np.nan)
    course = np.array(plates)
    assert np.nanmin(course) > 288.15 - 0.3
    assert np.nanmax(course) < 313.15 + 0.3
    assert np.nanmax(np.abs(course[500:] - course[:-500])) < 1.1 * 5.0


def test_the_heat_of_a_whole_run_balances(scenes: Path) -> None:
    engine = itouch.build(Display(hold="0.4 s").write(scenes), seed=1)
    memory = engine.state["peltier.twin.memory"]
    params = DisplayParams()
    capacity = plate_capacity(params.plate) * params.area

    def stored() -> float:
        return capacity * float(memory[plant.MEAN]) + params.sink_capacity * float(memory[plant.SINK])

    begin = stored()
    engine.run()
    came = memory[plant.ENERGY_ELECTRIC] + memory[plant.ENERGY_FINGER] + memory[plant.ENERGY_AIR]
    scale = float(memory[plant.ENERGY_ELECTRIC] + abs(memory[plant.ENERGY_FINGER]))
    assert scale > 10.0
    assert abs(stored() - begin - float(came - memory[plant.ENERGY_ROOM])) < 1e-9 * stored()


# --- parameters and commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"target": "file"}, "file"),
        ({"file": "x.csv", "desired_from": "heat"}, "target"),
        ({}, "desired-from"),
        ({"desired_from": "heat", "preset_time": 1.0}, "equalise"),
        (
            {
                "target": "file",
                "curves": (MaterialCurve(material="a", file="x"), MaterialCurve(material="a", file="y")),
            },
            "two curves",
        ),
        ({"desired_from": "heat", "integral": float("nan")}, "integral"),
    ],
)
def test_parameters_that_do_not_go_together(given: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        FluxControlParams(display="peltier", **given)  # type: ignore[arg-type]


def test_a_current_limit_without_a_current_is_a_problem(scenes: Path) -> None:
    with pytest.raises(itouch.SceneError, match="no current"):
        itouch.build(Display(hardware=hardware('command="temperature"')).write(scenes))


def test_a_temperature_without_a_unit_is_proposed_in_degc(capsys: pytest.CaptureFixture[str]) -> None:
    sheet = ["module", "--voltage", "15.4V", "--current", "6.4 A", "--difference", "68K"]
    for words, meant in ((["dew-point", "--room", "20"], "--room 20degC"), ([*sheet, "--hot", "27"], "--hot 27degC")):
        assert cli.main(words) == 2
        assert f"did you mean {meant}?" in capsys.readouterr().err
    for beyond in ("2000", "500 degC"):  # in degC it would be out of range, too
        assert cli.main(["dew-point", "--room", beyond]) == 2
        told = capsys.readouterr().err
        assert "out of range: -40 to 60 degC" in told
        assert "did you mean" not in told


def test_commands_about_modules_and_dew(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["module", "--voltage", "15.4V", "--current", "6.4 A", "--difference", "68K"]) == 0
    out = capsys.readouterr().out
    assert "0.051308 V/K" in out
    assert "<thermal:datasheet" in out
    assert cli.main(["dew-point", "--room", "25 degC", "--humidity", "50%"]) == 0
    assert float(capsys.readouterr().out.split()[0]) == pytest.approx(13.87, abs=0.05)
    for words in (
        ["dew-point", "--humidity", "0"], ["dew-point", "--room", "nan"], ["dew-point", "--room", "500 degC"],
        ["dew-point", "--humidity", "1e400"], ["module", "--voltage", "x", "--current", "1A", "--difference", "1K"],
        ["module", "--voltage", "1V", "--current", "1m", "--difference", "1K"],
        ["module", "--voltage", "1V", "--current", "1A", "--difference", "400K"], ["switching", "none.xml"],
    ):  # fmt: skip
        assert cli.main(words) == 2
        assert "error" in capsys.readouterr().err
