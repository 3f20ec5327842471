"""The main job: four materials of four heights, touched in turn, all of it computed."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import REPOSITORY, SCENES

import itouch
from itouch_tools.report.screen import Screen

SCENE = SCENES / "four_materials.xml"
ORDER = ("polystyrene", "wood", "pyrex", "aluminium")


@pytest.fixture(scope="module")
def shown() -> tuple[itouch.Session, str]:
    """Return the finished session, and what `itouch-py` prints of it."""
    session, printed = itouch.build(SCENE), io.StringIO()
    screen = Screen(session, printed)
    session.run()
    screen.finish(session.report())
    return session, printed.getvalue()


@pytest.fixture(scope="module")
def finished(shown: tuple[itouch.Session, str]) -> itouch.Session:
    return shown[0]


@pytest.fixture(scope="module")
def contacts(finished: itouch.Session) -> dict[str, dict[str, Any]]:
    return {entry["material"]: entry for entry in finished.report()["contacts"]}


def test_the_readme_shows_what_is_printed_today(shown: tuple[itouch.Session, str]) -> None:
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    captured = readme.split("<!-- capture: itouch-py scenes/four_materials.xml -->\n```text\n")[1].split("```")[0]
    speed = re.compile(r"in [\d.]+ s \([\d.]+ x real time\); tick p50 .* us, p99 .* us;")  # of a machine
    assert speed.sub("", shown[1]) == speed.sub("", captured)


def test_each_block_is_touched_once_through_the_plate(contacts: dict[str, dict[str, Any]]) -> None:
    assert tuple(contacts) == ORDER
    assert all(entry["plate"] for entry in contacts.values())
    assert all(entry["end_s"] - entry["begin_s"] > 5.0 for entry in contacts.values())


def test_fluxes_come_in_the_order_of_the_paper(contacts: dict[str, dict[str, Any]]) -> None:
    fluxes = [contacts[name]["mean_flux_W_m2"] for name in ORDER]
    assert fluxes == sorted(fluxes)
    assert all(second > 1.2 * first for first, second in zip(fluxes, fluxes[1:], strict=False))
    assert all(contacts[name]["flux_source"] == "twin" for name in ORDER)


def test_all_four_materials_are_followed(contacts: dict[str, dict[str, Any]]) -> None:
    assert all(contacts[name]["flux_error_rms"] < 0.2 for name in ORDER)
    assert all(abs(contacts[name]["peak_flux_W_m2"]) >= contacts[name]["mean_flux_W_m2"] for name in ORDER)


def test_conductors_cool_the_skin_more(contacts: dict[str, dict[str, Any]]) -> None:
    drops = [contacts[name]["skin_drop_K"] for name in ORDER]
    assert drops[3] > drops[2] > drops[1] > 0.3
    assert drops[3] < 6.0


def test_the_plate_is_where_the_surface_is(finished: itouch.Session, contacts: dict[str, dict[str, Any]]) -> None:
    assert all(abs(contacts[name]["plate_gap_mm"]) < 0.1 for name in ORDER)
    assert all(abs(contacts[name]["plate_lead_ms"]) <= 5.0 for name in ORDER)
    table = finished.report()["table"]
    assert table["tracking_mm"]["p99"] < 0.3
    assert table["height_error_mm_max"] < 0.3


def test_forces_stay_gentle_and_nothing_failed(finished: itouch.Session, contacts: dict[str, dict[str, Any]]) -> None:
    assert all(0.5 < contacts[name]["peak_force_N"] < 2.5 for name in ORDER)
    assert finished.report()["faults"] == []


def test_touch_off_finds_the_height_of_the_mount(finished: itouch.Session) -> None:
    assert finished.state["table.calibration"][2] == pytest.approx(-0.003, abs=5e-5)
    assert finished.state["table.calibration"][3] == 1.0


@pytest.mark.parametrize("error", [(0, 0, 0.004), (1, 1, -0.0035), (2, -1.5, 0.001)])
def test_touch_off_finds_other_heights(scenes: Path, error: tuple[float, float, float]) -> None:
    rig = scenes / "rigs" / "twin.xml"
    written = " ".join(f"{1e3 * value if abs(value) < 0.1 else value:g}" for value in error)
    rig.write_text(rig.read_text().replace("2 -1.5 3 mm", f"{written} mm"))
    engine = itouch.build(scenes / "four_materials.xml")
    while not engine.state["ready"]:
        engine.tick()
    assert engine.state["table.calibration"][2] == pytest.approx(-error[2], abs=5e-5)


def test_without_touch_off_the_error_shows(scenes: Path) -> None:
    rig = scenes / "rigs" / "twin.xml"
    rig.write_text(rig.read_text().replace('method="touch-off"', 'method="none"'))
    engine = itouch.build(scenes / "four_materials.xml")
    engine.run(9.0)
    (first, *_) = engine.report()["contacts"]
    assert first["plate_gap_mm"] == pytest.approx(3.0, abs=0.3)


def test_no_force_is_given_twice(scenes: Path) -> None:
    """Where the plate renders the contact, the arm's force has no part along the normal."""
    engine = itouch.build(scenes / "four_materials.xml")
    seen = 0
    while seen < 500:
        engine.tick()
        if int(engine.state["finger.contact.object"]) < 0 or engine.seconds < 8.5:
            continue
        seen += 1
        wrench, gap = engine.state["arm.sent.wrench"], float(engine.state["finger.plate_gap"])
        assert abs(gap) < 1e-4
        assert abs(wrench[2]) < 0.2  # the gap of some micrometres gives the arm its share of a thousandth each


def test_equal_seeds_give_equal_bytes_and_other_seeds_other_noise() -> None:
    runs = []
    for seed in (7, 7, 8):
        engine = itouch.build(SCENE, seed=seed)
        engine.run(9.0)
        runs.append(engine.state.tobytes())
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


@pytest.mark.parametrize("stop", [2741, *(pytest.param(stop, marks=pytest.mark.long) for stop in (77, 8123))])
def test_a_saved_run_goes_on_in_a_new_process_to_the_same_bytes(tmp_path: Path, stop: int) -> None:
    straight = itouch.build(SCENE, seed=5)
    straight.run(10.5)
    half = itouch.build(SCENE, seed=5)
    half.run(stop * half.model.period)
    half.save(tmp_path / "half.itouch")
    code = (
        "import sys, itouch\n"
        f"engine = itouch.restore({str(tmp_path / 'half.itouch')!r})\n"
        f"engine.run(10.5 - {stop} * engine.model.period)\n"
        "sys.stdout.buffer.write(engine.state.tobytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout == straight.state.tobytes()


@pytest.mark.long  # compiles everything; the short form sees in tests/loop that no tick has a first call
def test_no_tick_compiles(tmp_path: Path) -> None:
    """From an empty cache every kernel is compiled while the engine is built: no tick of a touch compiles any."""
    code = (
        "import itouch\nfrom numba.core import event\n"
        f"engine = itouch.build({str(SCENE)!r})\n"
        "with event.install_recorder('numba:compile') as recorder:\n"
        "    engine.run(9.0)\n"
        "assert int(engine.state['finger.contact.object']) >= 0\n"
        "print(sorted({e.data['dispatcher'].__qualname__ for _, e in recorder.buffer}))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


def test_what_is_not_in_state_does_not_change(finished: itouch.Session) -> None:
    """A copy of the bytes put into a fresh engine gives the same next ticks."""
    other = itouch.build(SCENE, seed=99)
    other.adopt(finished.state.tobytes())
    finished_again = itouch.build(SCENE, seed=1)
    finished_again.adopt(finished.state.tobytes())
    for engine in (other, finished_again):
        engine.run(0.2)
    assert other.state.tobytes() == finished_again.state.tobytes()
    assert np.isfinite(other.state["finger.hip"]).all()


def test_every_touch_begins_with_a_skin_that_has_recovered(
    finished: itouch.Session, contacts: dict[str, dict[str, Any]]
) -> None:
    waits = finished.report()["waits"]
    assert all(32.45 < entry["skin_begin_degC"] < 33.1 for entry in contacts.values())
    assert [entry["waited_s"] for entry in waits if entry["back"] is False] == [60.0, 60.0]
    assert waits[-1]["back"] is True


def test_in_a_hurry_the_order_of_touches_is_felt(contacts: dict[str, dict[str, Any]]) -> None:
    short = itouch.build(SCENES / "four_materials_hurried.xml", seed=1)
    short.run()
    hurried = {entry["material"]: entry for entry in short.report()["contacts"]}
    assert hurried["wood"]["skin_begin_degC"] < 30.5
    assert contacts["wood"]["mean_flux_W_m2"] > 1.25 * hurried["wood"]["mean_flux_W_m2"]
