"""``bench tick``: its figures are there and belong together, and measuring leaves a session as it was."""

from __future__ import annotations

import json

import pytest
from shipped import SCENES

from itouch.session import build, load_scene
from itouch_evidence import bench_tick
from itouch_tools.cli import main


def test_the_command_prints_its_figures(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["bench", "tick", "--ticks", "60", "--json"])
    found = json.loads(capsys.readouterr().out)
    held = [bench_tick.is_near(found), bench_tick.is_cheap(found), *map(bench_tick.fits, found["turns"])]
    assert code == (not all(held))
    assert found["compiled_us"] > 0.0  # how long a tick takes beside it is no matter of a test: machines are shared
    assert 0.0 < found["tick_us"]["p50"] <= found["tick_us"]["p99"]
    assert 0 < found["joined_steps"] == found["steps"]  # nothing of it is Python
    assert [row["rate_hz"] for row in found["turns"]] == [1000.0, 4000.0]
    assert all(row[turn] > 0.0 for row in found["turns"] for turn in bench_tick.TURNS)
    code = main(["bench", "tick", "--ticks", "30"])
    out = capsys.readouterr().out
    assert "compiled steps" in out and "at 4 kHz: begins" in out and "(bound 250 us" in out
    assert code == ("MISSED" in out)


def test_measuring_a_part_puts_the_state_back() -> None:
    session = build(bench_tick.scene_of(probes=2, devices=3))
    assert bench_tick.in_contact(session)
    before = session.state.tobytes()
    whole, compiled, left = bench_tick.beside_the_limit(session, 3)
    assert whole > 0.0 and compiled > 0.0 and left == 0
    assert isinstance(bench_tick.cost_of_a_split(session, 20), float)
    assert session.state.tobytes() == before
    session.close()


@pytest.mark.parametrize("name", ["four_materials.xml", ""])
def test_the_limit_has_all_that_a_tick_has(name: str) -> None:
    """The compiled loop to which a tick is compared makes the same State: no step of the touch is missing in it."""
    session = build(load_scene(SCENES / name) if name else bench_tick.scene_of())
    assert bench_tick.in_contact(session)
    kept, found = session.state.tobytes(), []
    for whole in (True, False):
        session.adopt(kept)
        session.tick()
        if whole:
            for _ in range(100):
                session.tick()
        else:
            (chain,) = session.plan.chains
            assert chain.repeat(100, session.state["tick"].reshape(1)) == 0
        found.append(session.state.tobytes())
    assert found[0] == found[1]
    session.close()


def test_a_scene_without_a_touch_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_tick, "SEARCH", 0.01)
    with pytest.raises(SystemExit):
        main(["bench", "tick", "--scene", str(SCENES / "first_touch.xml")])


def test_the_scenes_have_what_they_count() -> None:
    scene = bench_tick.scene_of(probes=2, objects=40, devices=5)
    assert (len(scene.probes), len(scene.objects), len(scene.devices)) == (2, 40, 5)
