"""``itouch-py bench wire``: what differs is written into the scene, and each figure stands beside its bound."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from itouch.session import load_scene
from itouch_thermal import bench_wire
from itouch_thermal.bench_wire import WIDE, differ, main, plants
from itouch_thermal.display.params import DisplayParams


def display(scene: Path) -> DisplayParams:
    """Return what a scene says of its display."""
    (device,) = [device for device in load_scene(scene, twin="all").devices if device.name == "peltier"]
    (part,) = device.parts
    assert isinstance(part.params, DisplayParams)
    return part.params


def mismatch(scene: Path) -> dict[str, float]:
    """Return how the display's plant differs in a scene."""
    return {key: getattr(display(scene).mismatch, key.replace("-", "_")) for key in WIDE}


@pytest.mark.parametrize(("name", "before"), [("wire", 0.0), ("diy", -6e-3)])
def test_a_difference_is_written_beside_what_stands_there(scenes: Path, name: str, before: float) -> None:
    corner = {"contact-resistance": -0.2, "seebeck": 0.1, "delay": 5e-3, "sensor-lag": -0.3}
    assert differ(scenes / "rigs" / f"{name}.xml", corner) == 1
    found = mismatch(scenes / f"four_materials_{name}.xml")
    assert found == pytest.approx(corner | {"delay": before + 5e-3})
    assert differ(scenes / "rigs" / "twin.xml", corner) == 0  # not behind a wire


@pytest.mark.parametrize(("name", "told"), [("wire", 20e-3), ("diy", 11e-3)])
def test_a_plant_cannot_act_before_it_is_told_to(scenes: Path, name: str, told: float) -> None:
    """Behind the simulated chip the plate has no delay of its own: its controller is told of 5 ms more instead."""
    before = display(scenes / f"four_materials_{name}.xml")
    differ(scenes / "rigs" / f"{name}.xml", {"delay": -5e-3})
    after = display(scenes / f"four_materials_{name}.xml")
    assert after.mismatch.delay == pytest.approx(before.mismatch.delay - 5e-3)
    assert after.delay == pytest.approx(told)


def test_a_rig_of_ones_own_has_a_bound_of_its_own(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_wire, "run", lambda scene, mismatch, duration, **more: {"foam": 0.06})
    words = ["--only", "seebeck +10 %, delay +5 ms, sensor-lag"]
    bounds = {name: bench_wire.bound_of(scenes / f"four_materials_{name}.xml") for name in ("wire", "diy")}
    assert bounds == {"wire": bench_wire.BOUND, "diy": bench_wire.OWN_RIG}
    for name, bound in bounds.items():
        assert main([str(scenes / f"four_materials_{name}.xml"), *words]) == 0
        assert f"| {200.0 * bound:g} % |" in capsys.readouterr().out
        assert main([str(scenes / f"four_materials_{name}.xml"), "--only", "as written"]) == 1
        assert f"| {100.0 * bound:g} % MISSED |" in capsys.readouterr().out


def test_all_corners_are_tried_once() -> None:
    corners = [frozenset(mismatch.items()) for _, mismatch, times in plants(corners=True) if times > 1.0]
    assert len(set(corners)) == 2 ** len(WIDE)
    assert [times for _, _, times in plants(corners=False)] == [1.0, 1.0]


@pytest.mark.parametrize(("error", "code"), [(0.031, 1), (0.029, 0), (None, 1)])
def test_each_figure_is_held_against_its_bound(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: float | None, code: int
) -> None:
    monkeypatch.setattr(bench_wire, "run", lambda scene, mismatch, duration, **more: {"wood": 0.004, "foam": error})
    table = scenes / "rows.json"
    assert main([str(scenes / "four_materials_wire.xml"), "--json", str(table)]) == code
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "| plant | wood | foam | at most |"
    assert sum("MISSED" in line for line in lines) == 2 * code
    assert [row["holds"] for row in json.loads(table.read_text())] == [not code] * 2


def test_a_run_that_fails_and_a_scene_that_is_not_there_are_told(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(scenes / "nowhere.xml")]) == 2
    assert "there is no scene" in capsys.readouterr().err
    monkeypatch.setattr(bench_wire, "PROGRAM", "import sys; sys.exit('fault: the table is gone')")
    assert main([str(scenes / "four_materials_wire.xml")]) == 2
    assert "error: as written: fault: the table is gone" in capsys.readouterr().err


@pytest.mark.parametrize("words", [("--alone",), ("--real-time",)])
def test_a_run_in_which_nothing_is_touched_passes_no_bound(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    untouched = {**reported(), "contacts": []}
    monkeypatch.setattr(bench_wire, "_reported", lambda words, folder: (untouched, ""))
    assert main([str(scenes / "four_materials_wire.xml"), "--only", "as written", "--for", "1s", *words]) == 2
    assert "the finger touched nothing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "seeds"), [(("--only", "as written"), ["4"]), (("--unsteady", "--only", "19 ms"), 2 * ["4", "5", "6"])]
)
def test_the_noise_is_that_of_the_seed(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...], seeds: list[str],
) -> None:  # fmt: skip
    asked: list[tuple[str, ...]] = []

    def run(scene: Path, mismatch: dict[str, float], duration: str | None, **more: Any) -> dict[str, float | None]:
        asked.append(more["words"])
        return {"foam": 0.01}

    monkeypatch.setattr(bench_wire, "run", run)
    assert main([str(scenes / "four_materials_wire.xml"), "--seed", "4", *words]) == 0
    assert [each[-2:] for each in asked] == [("--seed", seed) for seed in seeds]
    for wrong in (("--seed", "-1"), ("--seed", "4", "--real-time")):
        with pytest.raises(SystemExit):
            main([str(scenes / "four_materials_wire.xml"), *wrong])
    assert "--seed must be 0 or more" in capsys.readouterr().err


def test_one_plant_is_chosen_by_words_of_its_name(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tried: list[tuple[dict[str, float], bool]] = []

    def run(scene: Path, mismatch: dict[str, float], duration: str | None, **more: Any) -> dict[str, float | None]:
        tried.append((dict(mismatch), more["alone"]))
        return {"foam": 0.05}

    monkeypatch.setattr(bench_wire, "run", run)
    words = "seebeck -10 %, delay +5 ms, sensor-lag -30 %"
    assert main([str(scenes / "four_materials_wire.xml"), "--only", words, "--alone"]) == 0
    assert [mismatch["contact-resistance"] for mismatch, _ in tried] == [0.2, -0.2]
    assert all(mismatch["delay"] == 5e-3 and alone for mismatch, alone in tried)
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main([str(scenes / "four_materials_wire.xml"), "--only", "gold"])
    assert "no plant has 'gold' in its name" in capsys.readouterr().err
    assert bench_wire.displays(scenes / "four_materials_wire.xml") == ["peltier"]


def test_better_wires_are_written_into_the_rig(scenes: Path) -> None:
    assert sum(bench_wire.rewire(scenes / "rigs" / "wire.xml", wires) for wires in bench_wire.FASTER.values()) == 4
    scene = load_scene(scenes / "four_materials_wire.xml", twin="all")
    (device,) = [device for device in scene.devices if device.name == "peltier"]
    (part,) = device.parts
    assert part.params.mecom.session_baud == 460800
    assert part.params.labjack.averaging == 20e-3
    assert part.params.flux_noise == 20.0  # of one sample, as before
    assert bench_wire.rewire(scenes / "rigs" / "diy.xml", bench_wire.FASTER["460800 baud for the session"]) == 0


def reported(*, late: bool = False, flux: float = 0.01, force: float = 1.0, tracking: float = 0.9) -> dict[str, Any]:
    """Return the report of a run in real time; on twins only its touches count."""
    touch = {"object": "wood", "peak_force_N": force, "true_error_rms": flux}
    woken = {"p50": 80.0, "p99.9": 4e3 if late else 300.0, "max": 2e4 if late else 900.0}
    surface = {"age_ms": {"p50": 2.0, "p99": 4.0}, "speed_times_age_mm": {"p50": 0.1, "p99": 0.8}}
    return {
        "contacts": [touch],
        "faults": [],
        "table": {"tracking_mm": {"p99": tracking}},
        "servo": {"lateness_us": woken},
        "wires": {
            "surfaces": {"table": surface},
            "rig": {"lateness_us": woken},
            "machine": {"lateness_us": woken, "held": not late},
        },
    }


@pytest.mark.parametrize(
    ("found", "code", "said"),
    [
        ({"flux": 0.039, "force": 1.09, "tracking": 1.19}, 0, "| pass |"),
        ({"flux": 0.041}, 1, "missed: wood's flux is 4.1 % off, allowed: 4 %"),
        ({"force": 1.11}, 1, "missed: wood's greatest force differs by 11.0 % from that on twins"),
        ({"tracking": 1.21}, 1, "missed: the surface was further from its command than it may be"),
        ({"tracking": 1.21, "late": True}, 3, "| machine not punctual |"),
        ({"late": True}, 0, "| pass |"),
    ],
)
def test_a_run_in_real_time_passes_fails_or_was_on_a_machine_that_is_late(
    scenes: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    found: dict[str, Any],
    code: int,
    said: str,
) -> None:
    asked: list[list[str]] = []

    def run(words: list[str], folder: Path) -> tuple[dict[str, Any], str]:
        asked.append(words)
        return reported(**(found if "virtual-rig" in words else {})), ""

    monkeypatch.setattr(bench_wire, "_reported", run)
    table = scenes / "rows.json"
    words = ["--real-time", "--only", "as written", "--json", str(table)]
    assert main([str(scenes / "four_materials_wire.xml"), *words]) == code
    out = capsys.readouterr().out
    assert said in out
    assert ("missed:" in out) == (code != 0)
    assert [row["verdict"] == "pass" for row in json.loads(table.read_text())] == [code == 0]
    assert [tuple(words[3:5]) == ("--pace", "real") for words in asked] == [False, True]
    assert main([str(scenes / "four_materials_diy.xml"), *words]) == (0 if found.get("flux") == 0.041 else code)


def test_in_real_time_a_touch_too_few_is_missed_and_every_device_is_on_its_wire(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(words: list[str], folder: Path) -> tuple[dict[str, Any], str]:
        found = reported()
        return {**found, "contacts": []} if "virtual-rig" in words else found, ""

    monkeypatch.setattr(bench_wire, "_reported", run)
    scene = str(scenes / "four_materials_wire.xml")
    assert main([scene, "--real-time", "--only", "as written"]) == 1
    assert "missed: it touched none, not wood" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([scene, "--real-time", "--alone"])
    assert "every device on its wire" in capsys.readouterr().err


@pytest.mark.parametrize(("shaken", "code"), [(0.0139, 0), (0.0141, 1)])
def test_what_each_unsteady_wire_adds_is_held_against_the_plant_as_written(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], shaken: float, code: int
) -> None:
    """One wire that adds too much is told, however little the others add."""
    asked: list[tuple[str, ...]] = []

    def run(scene: Path, mismatch: dict[str, float], duration: str | None, **more: Any) -> dict[str, float | None]:
        asked.append(tuple(more["words"]))
        return {"wood": shaken if "15ms" in more["words"] else 0.004}

    monkeypatch.setattr(bench_wire, "run", run)
    assert main([str(scenes / "four_materials_diy.xml"), "--unsteady"]) == code
    seeds = [(), ("--seed", "1"), ("--seed", "2")]
    assert asked == [(*words, *seed) for words in bench_wire.UNSTEADY.values() for seed in seeds]
    lines = capsys.readouterr().out.splitlines()[-5:]
    assert [line for line in lines if "MISSED" in line] == [line for line in lines if "15 ms" in line and code]
    assert lines[0].startswith("| exchanges 5 ms later, less as written, percentage points | +0.0 | +1.0 |")


def test_a_run_of_one_seed_that_passes_the_bound_is_not_hidden_by_the_others(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(scene: Path, mismatch: dict[str, float], duration: str | None, **more: Any) -> dict[str, float | None]:
        return {"wood": 0.051 if more["words"] == ("--phase", "5ms", "--seed", "2") else 0.03}

    monkeypatch.setattr(bench_wire, "run", run)
    assert main([str(scenes / "four_materials_diy.xml"), "--unsteady", "--only", "5 ms"]) == 1
    assert [line for line in capsys.readouterr().out.splitlines() if "MISSED" in line] == [
        "| exchanges 5 ms later | 3.8 % | 5 % MISSED |"
    ]


@pytest.mark.parametrize(
    ("words", "phases"), [("5 ms", {"5ms"}), ("15 ms later", {"15ms"}), ("exchanges", {"5ms", "10ms", "15ms", "19ms"})]
)
def test_only_chooses_by_whole_words(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, words: str, phases: set[str]
) -> None:
    asked: list[tuple[str, ...]] = []

    def run(scene: Path, mismatch: dict[str, float], duration: str | None, **more: Any) -> dict[str, float | None]:
        asked.append(more["words"])
        return {"wood": 0.004}

    monkeypatch.setattr(bench_wire, "run", run)
    assert main([str(scenes / "four_materials_diy.xml"), "--unsteady", "--only", words]) == 0
    assert {word for words in asked for word in words if word.endswith("ms")} == phases
