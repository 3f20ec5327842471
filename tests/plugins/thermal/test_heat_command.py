"""`itouch-py thermal` and `itouch-py bench thermal`."""

import json
import os

import heat_cases
import numpy as np
import pytest

from contact_heat import table
from contact_heat.stepper import Stepper
from itouch_thermal import bench, cli

CASE = str(heat_cases.FOLDER / "c_al_R1e-4_sensor37um.json")


def rows(text):
    lines = text.splitlines()
    return lines[0].split(","), np.array([[float(word) for word in line.split(",")] for line in lines[1:]])


def test_solve_writes_17_digits_in_celsius(tmp_path):
    output = tmp_path / "out.csv"
    assert cli.main(["solve", CASE, "-o", str(output)]) == 0
    names, table = rows(output.read_text())
    assert names == ["t", "j", "T_skin", "T_object", "Q", "T_200um", "T_500um", "j_sensor_mid", "j_sensor_back"]
    wanted = np.stack(list(heat_cases.solved("c_al_R1e-4_sensor37um")[1].values()), axis=1)
    assert table[10:, 1:5] == pytest.approx(wanted[10:, 1:5], rel=1e-10)


def test_live_and_exact_agree(capsys):
    assert cli.main(["solve", CASE, "--at", "1ms,10 ms,1s"]) == 0
    exact = rows(capsys.readouterr().out)[1]
    assert cli.main(["solve", CASE, "--at", "1ms,10ms,1 s", "--live", "--period", "1ms"]) == 0
    live = rows(capsys.readouterr().out)[1]
    assert live[:, :5] == pytest.approx(exact[:, :5], rel=1e-7)
    assert cli.main(["solve", CASE, "--at", "1s", "--method", "paper"]) == 0
    assert rows(capsys.readouterr().out)[1][0, 1] == pytest.approx(exact[2, 1], rel=1e-2)


def test_times_from_a_file(tmp_path, capsys):
    times = tmp_path / "times.csv"
    times.write_text("t\n0.001\n0.5\n")
    assert cli.main(["solve", CASE, "--times", str(times)]) == 0
    assert rows(capsys.readouterr().out)[1][:, 0].tolist() == [0.001, 0.5]


@pytest.mark.parametrize(
    "data",
    [
        b"t [ms],j [W/m^2]\n1,2\n500,3\n",
        b"\xef\xbb\xbf0.001\n0.5\n",
        b"# of a recording\n\n0.001 7\n0.5 8\n",
        b",\n0.001;7\n0.5;8\n",
    ],
)
def test_times_of_a_file_keep_their_unit_and_the_first_one(data, tmp_path, capsys):
    (tmp_path / "times.csv").write_bytes(data)
    assert cli.main(["solve", CASE, "--times", str(tmp_path / "times.csv")]) == 0
    assert rows(capsys.readouterr().out)[1][:, 0].tolist() == [0.001, 0.5]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"1ms\n2ms\n", "line 1: '1ms' is not a number; a unit belongs into the heading, as in t [ms]"),
        (b"t [days]\n1\n", "line 1: 'days' is no unit of times; use one of s, ms"),
        (b"time\nsoon\n", "line 2: 'soon' is not a number"),
        (b"\xff\xfe1\n", "times.csv: not text: byte 0 is not UTF-8"),
    ],
)
def test_times_that_are_none_are_told_with_their_line(data, message, tmp_path, capsys):
    (tmp_path / "times.csv").write_bytes(data)
    assert cli.main(["solve", CASE, "--times", str(tmp_path / "times.csv")]) == 2
    assert message in capsys.readouterr().err


def test_steps_are_taken_in_parts_of_what_fits_in_memory(tmp_path, capsys, monkeypatch):
    words = ["solve", CASE, "--live", "--at", "1ms,37ms,1s"]
    assert cli.main(words) == 0
    whole = capsys.readouterr().out
    asked = []
    advance = Stepper.advance
    monkeypatch.setattr(Stepper, "advance", lambda self, r, n: asked.append(n) or advance(self, r, n))
    monkeypatch.setattr(table, "_PART", 10)
    assert cli.main(words) == 0
    assert capsys.readouterr().out == whole and max(asked) == 10


def test_times_from_a_pipe_are_refused_at_once(tmp_path, capsys):
    os.mkfifo(tmp_path / "times.csv")
    assert cli.main(["solve", CASE, "--times", str(tmp_path / "times.csv")]) == 2
    assert "a folder, a pipe, a device or a socket, not a file" in capsys.readouterr().err


def test_a_plot_is_a_picture(tmp_path):
    pytest.importorskip("matplotlib")
    output = tmp_path / "out.png"
    assert cli.main(["solve", CASE, "-o", str(output)]) == 0
    assert output.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["solve", "nothing.json"], "nothing.json: No such file"),
        (["solve", CASE, "--at", "1q"], "'1q' is not a time"),
        (["solve", CASE, "--at", "1.2.3"], "'1.2.3' is not a time; write for example 1ms"),
        (["solve", CASE, "--at", "2s,1s"], "times[1]"),
        (["solve", CASE, "-o", "out.pdf"], "must end in .csv or .png"),
        (["solve", CASE, "--live", "--method", "paper"], "--live"),
        (["solve", CASE, "--live", "--at", "1us"], "none reaches the first step"),
        (["solve", CASE, "--live", "--period", "1h"], "period"),
    ],
)
def test_bad_input_is_one_message_and_code_2(words, message, capsys):
    assert cli.main(words) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.startswith("error: ") and printed.count("\n") == 1


def test_materials_are_listed_with_their_sources(capsys):
    assert cli.main(["materials"]) == 0
    printed = capsys.readouterr().out
    assert "polystyrene" in printed and "section II-E" in printed
    assert len(printed.splitlines()) > 27


def test_the_bench_measures_a_case(tmp_path, capsys):
    output = tmp_path / "rows.json"
    case = str(heat_cases.FOLDER / "b_wood_R0.json")
    assert bench.main(["--case", case, "--no-peers", "--no-batch", "--json", str(output)]) == 0
    found = {row["method"]: row for row in json.loads(output.read_text())}
    assert found["exact"]["error_10us"] < 1e-10
    assert found["live, constant resistance"]["error_1ms"] < 1e-7
    assert found["paper, 100 um, not split"]["error_10us"] > 0.5 > found["paper, 100 um"]["error_10us"]
    assert "us/point" in capsys.readouterr().out
    assert bench.main(["--case", "nothing.json"]) == 2
