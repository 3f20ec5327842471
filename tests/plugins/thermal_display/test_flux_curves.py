"""Recorded flux curves: what a file may hold, what is said when it does not, and recording and playing in a scene."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from display_scenes import HEAT, Display
from hypothesis import given, settings
from hypothesis import strategies as st

import itouch
from itouch_thermal import cli
from itouch_thermal.flux.curve import Curve, flux_at, format_curve, parse_curve, read_curve

PLAYED = '<thermal:flux-control display="peltier" desired-from="heat" target="file" file="curve.csv"/>'
ALONE = '<thermal:flux-control display="peltier" target="file" file="curve.csv"/>'


def test_units_stand_in_the_first_row() -> None:
    curve = parse_curve("\ufefft [ms], j (kW/m^2), note\n\n0,2.5,a\n# a remark\n10,1.5,b\n".removeprefix("\ufeff"))
    np.testing.assert_allclose(curve.times, [0.0, 0.01])
    np.testing.assert_allclose(curve.fluxes, [2500.0, 1500.0])
    np.testing.assert_allclose(curve.at(np.array([-1.0, 0.005, 9.0])), [2500.0, 2000.0, 1500.0])


@given(
    st.lists(st.floats(0.0, 10.0), min_size=2, max_size=9, unique=True).map(sorted),
    st.lists(st.floats(-1e5, 1e5), min_size=9, max_size=9),
    st.lists(st.floats(-1.0, 11.0), min_size=1, max_size=9),
)
def test_a_tick_plays_a_curve_as_it_is_to_the_bit(times: list[float], fluxes: list[float], asked: list[float]) -> None:
    curve = Curve.of(times, fluxes[: len(times)])
    rows = np.concatenate([[3.0, 4.0], curve.times, [0.0]]), np.concatenate([[5.0, 6.0], curve.fluxes, [7.0]])
    for time in (*asked, *times):
        assert flux_at(*rows, 2, 2 + len(times), time) == curve.at(time)


def test_a_solved_case_is_a_curve_too() -> None:
    curve = parse_curve("t,j,T_skin,T_object,Q\n0.001,4000,33,23,4\n0.01,3500,32,24,39\n")
    assert curve.at(0.001) == 4000.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "first row"),
        ("\n\n", "first row"),
        ("time,flux\n0,1\n1,2\n", "first row"),
        ("0,1\n1,2\n", "first row"),
        ("t,j\n", "two rows"),
        ("t,j\n0,1\n", "two rows"),
        ("t,t,j\n0,0,1\n", "two columns t"),
        ("t [K],j\n0,1\n1,2\n", "not a unit"),
        ("t [furlong],j\n0,1\n1,2\n", "column t"),
        ("t,j\n0,1\n0,2\n", "line 3"),
        ("t,j\n1,1\n0,2\n", "ascend"),
        ("t,j\n0,nan\n1,2\n", "line 2: j = 'nan'"),
        ("t,j\n0,1\n1,inf\n", "line 3"),
        ("t,j\n0,1\n1,1_0\n", "1_0"),
        ("t,j\n0,1\n1\n", "line 3: j is missing"),
        ("t,j\n0,1\n1,\n", "j is missing"),
        ("t,j\n-1,1\n1,2\n", "out of range"),
        ("t,j\n0,1e7\n1,2\n", "out of range"),
        ("t,j\n0,1\n1e9,2\n", "out of range"),
        ("t;j\n0;1\n1;2\n", "first row"),
        ('t,j\n0,"1\n1,2\n', "line"),
        ("t,j\n0," + "9" * 200000 + "\n", "line"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(text: str, said: str) -> None:
    with pytest.raises(ValueError, match="line") as fault:
        parse_curve(text)
    assert said in str(fault.value)
    assert len(str(fault.value)) < 300


@settings(max_examples=150, deadline=None)
@given(st.one_of(st.text(), st.text(alphabet='tj,0123456789.e+-\n "#[]()_naif;'), st.binary()))
def test_no_text_breaks_the_reader(text: str | bytes) -> None:
    words = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    for content in (words, "t,j\n" + words, "t [ms],j\n0,1\n" + words):
        try:
            curve = parse_curve(content)
        except ValueError as fault:
            assert "line" in str(fault)
        else:
            assert np.all(np.diff(curve.times) > 0.0)
            assert np.isfinite(curve.at(curve.times)).all()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=40))
def test_what_is_written_is_read_back(fluxes: list[float]) -> None:
    times = [0.001 * (k + 1) for k in range(len(fluxes))]
    curve = parse_curve(format_curve(times, fluxes))
    np.testing.assert_allclose(curve.times, times, rtol=1e-9)
    np.testing.assert_array_equal(curve.fluxes, fluxes)


def test_a_curve_in_python_is_checked() -> None:
    for times, fluxes in (([0.0], [1.0]), ([0.0, 0.0], [1.0, 2.0]), ([0.0, 1.0], [1.0, np.nan]), ([0.0, 1.0], [1.0])):
        with pytest.raises(ValueError, match="curve"):
            Curve.of(times, fluxes)


def test_a_file_must_be_a_file_of_the_scenes_folder(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "out.csv").write_text("t,j\n0,1\n1,2\n")
    (folder / "sub" / "in.csv").write_text("t,j\n0,1\n1,2\n")
    (folder / "link.csv").symlink_to(tmp_path / "out.csv")
    (folder / "bytes.csv").write_bytes(b"t,j\n\xff\xfe\x00")
    os.mkfifo(folder / "pipe.csv")
    assert len(read_curve(str(folder), "sub/in.csv").times) == 2
    for name, said in (
        ("../out.csv", "outside"), (str(tmp_path / "out.csv"), "outside"), ("link.csv", "outside"), ("", "file name"),
        ("a\0b", "file name"), ("none.csv", "no file"), ("sub", "not a file"), ("pipe.csv", "not a file"),
        ("bytes.csv", "UTF-8"), ("x" * 5000, "x"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            read_curve(str(folder), name)


@pytest.mark.parametrize(
    ("control", "content", "said"),
    [
        (PLAYED, "t,j\n0,1\n0,2\n", "'curve.csv', line 3"),
        (PLAYED.replace("curve.csv", "../curve.csv"), "", "outside the scene's folder"),
        (PLAYED.replace("curve.csv", "other.csv"), "", "cannot read 'other.csv'"),
        (PLAYED.replace(' file="curve.csv"', ""), "", "needs the attribute 'file'"),
        (PLAYED.replace(' target="file"', ""), "t,j\n0,1\n1,2\n", 'write target="file"'),
        ('<thermal:flux-control display="peltier"/>', "", "'desired-from'"),
        (
            '<thermal:flux-control display="peltier" target="file"><thermal:curve material="wood" file="curve.csv"/>'
            "</thermal:flux-control>",
            "t,j\n0,1\n1,2\n",
            "object 'left' of 'aluminium' has no flux curve",
        ),
        (
            '<thermal:flux-control display="peltier" desired-from="heat" target="file">'
            '<thermal:curve material="gold" file="curve.csv"/></thermal:flux-control>',
            "t,j\n0,1\n1,2\n",
            "no material named 'gold'",
        ),
    ],
)
def test_a_scene_says_what_is_wrong_at_its_place(scenes: Path, control: str, content: str, said: str) -> None:
    path = Display(control=control, files={"curve.csv": content}).write(scenes)
    with pytest.raises(itouch.SceneError) as fault:
        itouch.build(path)
    (problem,) = fault.value.problems
    assert said in problem.sentence
    assert problem.place is not None
    assert problem.place.file.endswith("display.xml")


def test_recorded_and_played_again(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Display(hold="0.7 s").write(scenes)
    file = scenes / "curve.csv"
    assert cli.main(["record-flux", str(path), "-o", str(file), "--what", "desired", "--seed", "3"]) == 0
    assert "left (aluminium)" in capsys.readouterr().out
    text = file.read_text(encoding="utf-8")
    assert text.splitlines()[0] == "t,j"
    recorded = parse_curve(text)
    assert recorded.times[0] == pytest.approx(1e-3)
    path = Display(left="wood", control=PLAYED, hold="0.7 s", files={"curve.csv": text}).write(scenes)
    engine = itouch.build(path, seed=3)
    played, begun = [], None
    while int(engine.state["finger.contact.object"]) != 0:
        engine.tick()
    for _ in range(400):
        played.append(float(engine.state["flux-control.desired"]))
        begun = begun or int(engine.state["flux-control.begun"])
        engine.tick()
    np.testing.assert_allclose(played, recorded.fluxes[: len(played)], rtol=1e-9)
    engine.save(scenes / "half.itouch")
    file.unlink()  # the session holds the curve
    other = itouch.restore(scenes / "half.itouch")
    for session in (engine, other):
        session.run(0.1)
    assert engine.state.tobytes() == other.state.tobytes()
    engine.run()
    entries = engine.report()["contacts"]
    assert entries[0]["material"] == "wood"
    assert entries[0]["mean_flux_W_m2"] == pytest.approx(float(np.mean(recorded.fluxes)), rel=0.03)
    assert all(entry["flux_error_rms"] < 0.03 for entry in entries)


def test_a_curve_needs_no_model_of_the_touch(scenes: Path) -> None:
    """Without the modality `heat` the display plays the curve; it is another one for another material."""
    wood = '<thermal:curve material="wood" file="wood.csv"/>'
    control = ALONE.replace("/>", f">{wood}</thermal:flux-control>")
    files = {"curve.csv": "t,j\n0,1200\n2,1000\n", "wood.csv": "t [ms],j [kW/m^2]\n0,0.6\n2000,0.5\n"}
    path = Display(heat="", control=control, files=files, hold="0.7 s").write(scenes)
    engine = itouch.build(path, seed=3)
    engine.run()
    left, right = engine.report()["contacts"]
    assert left["mean_flux_W_m2"] == pytest.approx(1130.0, rel=0.05)
    assert right["mean_flux_W_m2"] == pytest.approx(570.0, rel=0.05)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--object", "gold"], "no object 'gold'"),
        (["--for", "100 ms"], "touched nothing"),
        (["--for", "soon"], "not a"),
        (["--for=-1s"], "out of range"),
        (["--seed", "-1"], "out of range"),
        (["--rig", "none.xml"], "none.xml"),
    ],
)
def test_recording_says_what_is_wrong(
    scenes: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Display().write(scenes)
    assert cli.main(["record-flux", str(path), "-o", str(scenes / "x.csv"), *words]) == 2
    assert said in capsys.readouterr().err
    assert not (scenes / "x.csv").exists()


def test_recording_needs_a_place_and_a_flux(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Display(heat=HEAT, control="").write(scenes)
    with pytest.raises(SystemExit) as ended:
        cli.main(["record-flux", str(path), "-o", str(scenes / "none" / "x.csv")])
    assert ended.value.code == 2
    assert "make it first" in capsys.readouterr().err
    assert cli.main(["record-flux", str(path), "-o", str(scenes / "x.csv"), "--what", "sensor"]) == 2
    assert cli.main(["record-flux", str(scenes / "none.xml"), "-o", str(scenes / "x.csv")]) == 2
    assert "no modality that knows the flux" in capsys.readouterr().err
