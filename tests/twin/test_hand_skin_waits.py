"""A scripted hand waits for its skin: by role, in State, for a minute at most, and it says what happened."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from shipped import SCENES

import itouch
from itouch.plugin.discovery import Catalog
from itouch.scene.canonical_xml import write
from itouch.schema.hold_until import Until
from itouch.twin import waits
from itouch.twin.mechanics import AlongPath
from itouch.world import Model
from itouch.world.skin_source import LONGEST, SkinSource, skin_of, window_ticks
from itouch_tools.authoring.xsd import schemas
from itouch_tools.cli import main
from itouch_tools.report.screen import Screen

Ran = tuple[itouch.Session, list[tuple[int, float, float, float]], bytes]
MOTION = """<to pos="22 0 48 mm" in="0.1 s" hold="0.3 s"/><to pos="22 0 19 mm" in="0.5 s" hold="0.6 s"/>
        <to pos="22 0 48 mm" in="0.3 s"/>
        <to pos="22 0 44 mm" in="0.2 s" hold="until skin 0.4 K"/><to pos="22 0 48 mm" in="0.2 s"/>"""


def text_with(motion: str = MOTION) -> str:
    """Return the shipped scene with another path of its operator."""
    text = (SCENES / "four_materials_hurried.xml").read_text(encoding="utf-8")
    begin, end = text.index("<motion>") + len("<motion>"), text.index("</motion>")
    return text[:begin] + motion + text[end:]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Wood, touched for half a second, and a wait: the names of devices are a stranger's."""
    folder = tmp_path_factory.mktemp("waits")
    rig = (SCENES / "rigs" / "twin.xml").read_text(encoding="utf-8")
    text = text_with().replace('file="rigs/twin.xml"', 'file="twin.xml"')
    for name, other in (("peltier", "thing"), ("finger", "f1")):
        text, rig = text.replace(f'"{name}"', f'"{other}"'), rig.replace(f'"{name}"', f'"{other}"')
    (folder / "twin.xml").write_text(rig, encoding="utf-8")
    (folder / "materials.xml").write_bytes((SCENES / "materials.xml").read_bytes())
    path = folder / "scene.xml"
    path.write_text(text, encoding="utf-8")
    yield path


@pytest.fixture(scope="module")
def run(scene: Path) -> Iterator[Ran]:
    """The session after its script; ticks on the path, sensed and true skin and the hand's height; a half-way save."""
    session, rows, half = itouch.build(scene, seed=4), [], b""
    state = session.state
    session.record(scene.parent / "r.mcap")
    while not session.done:
        session.tick()
        rows.append((
            int(state["f1.hand.ticks"]), state["thing.skin_temperature"].item(), float(state["thing.twin.true_skin"]),
            float(state["f1.hand.target"][2]),
        ))  # fmt: skip
        if not half and int(state["f1.hand.waited"][0]) == 300:
            session.save(scene.parent / "half.itouch")
            half = state.tobytes()
    yield session, rows, half
    session.close()


def test_the_hand_stands_until_the_skin_is_back(run: Ran) -> None:
    session, rows, _ = run
    ticks, sensed, skin, height = np.array(rows).T
    (entry,) = session.report()["waits"]
    waited = round(entry["waited_s"] * 1e3)
    assert entry["back"] is True and entry["ended"] is True and entry["probe"] == "f1" and 300 < waited < 20_000
    still = np.flatnonzero((np.diff(ticks) == 0) & (ticks[1:] > 0))
    assert len(still) == waited and np.all(np.diff(still) == 1)
    assert np.ptp(height[still]) == 0.0 and height[still[0]] == pytest.approx(0.044)
    start = float(sensed[100:1000].mean())
    assert entry["baseline_degC"] == pytest.approx(start - 273.15, abs=0.02)
    assert abs(skin[still[-1]] - start) == pytest.approx(0.4, abs=0.03)  # the mean of 0.1 s of a noisy reading
    assert abs(skin[still[0]] - start) > 0.5
    assert entry["skin_degC"] == pytest.approx(skin[still[-1]] - 273.15, abs=0.03)
    assert entry["scene"].endswith("scene.xml:22:41")


def test_the_path_goes_on_afterwards_and_the_end_waits_for_it(
    run: Ran,
) -> None:
    session, rows, _ = run
    assert rows[-1][0] == 2200 and rows[-1][3] == pytest.approx(0.048, abs=1e-6)  # ticks of all movements and holds
    assert session.report()["simulated_s"] > 2.2 + session.report()["waits"][0]["waited_s"]
    json.dumps(session.report())


def test_a_session_restored_in_a_wait_goes_on_to_the_bit(scene: Path, run: Ran) -> None:
    session, _, half = run
    other = itouch.restore(scene.parent / "half.itouch")
    assert other.state.tobytes() == half
    other.run()
    assert other.state.tobytes() == session.state.tobytes()
    assert other.report()["waits"][0]["waited_s"] == session.report()["waits"][0]["waited_s"]


def test_the_contact_says_how_warm_the_skin_was(run: Ran) -> None:
    session, rows, _ = run
    (contact,) = session.report()["contacts"]
    before = rows[round(contact["begin_s"] * 1e3) - 2][2]
    assert contact["skin_begin_degC"] == pytest.approx(before - 273.15, abs=0.05)


def test_it_is_written_on_the_screen_and_replayed(scene: Path, run: Ran) -> None:
    session, report = run[0], run[0].report()
    told = io.StringIO()
    Screen(session, told).finish(report)
    assert f"f1 waited for its skin: {report['waits'][0]['waited_s']:.1f} s\n" in told.getvalue()
    assert "skin degC" in told.getvalue()
    session.close()
    outcome = itouch.replay(scene.parent / "r.mcap")
    assert (outcome.mismatches, outcome.ticks) == (0, int(session.state["tick"]))


@pytest.mark.parametrize(
    ("hold", "said", "advice"),
    [
        ("until", "it does not say for what", "until skin 0.5 K"),
        ("until skni 0.5 K", "'skni' cannot be waited for", "the skin's temperature"),
        ("until skin", "it does not say how near the skin must be", "until skin 0.5 K"),
        ("until skin 0.5 degC", "this is a temperature difference", "a difference of temperature in K"),
        ("until skin 0.5 s", "'s' is not a unit of K", "until skin 0.5 K"),
        ("until skin 0", "0 K is out of range", "allowed: 0.05 to 10 K"),
        ("until skin nan K", "is not a number", "until skin 0.5 K"),
        ("until skin 50 K", "50 K is out of range", "allowed: 0.05 to 10 K"),
        ("long", "'long' is not a number", "a quantity in s, or a wait such as 'until skin 0.5 K'"),
        ("3 K", "'K' is not a unit of s", "or a wait such as"),
        ("-1 s", "-1 s is out of range", "allowed: 0 to 3600 s"),
    ],
)
def test_a_wrong_hold_is_one_message_with_its_place(hold: str, said: str, advice: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.xml"
    path.write_text(
        '<itouch version="1.0"><include file="itouch:rigs/twin.xml"/><interaction>\n'
        '<probe name="finger" pose-from="arm"/><operator probe="finger"><motion>\n'
        f'<to pos="0 0 40 mm" in="1 s" hold="{hold}"/></motion></operator></interaction></itouch>',
        encoding="utf-8",
    )
    with pytest.raises(itouch.SceneError) as raised:
        itouch.load(path)
    (problem,) = raised.value.problems
    assert said in problem.sentence and advice in problem.advice
    assert (problem.place.line, problem.place.column) == (3, 30)


@pytest.mark.parametrize("within", [0.05, 10.0])
def test_the_nearest_and_the_furthest_that_may_be_waited_for(within: float, tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_text(
        '<itouch version="1.0"><include file="itouch:rigs/twin.xml"/><interaction><probe name="finger" pose-from="arm"/>'
        '<operator probe="finger"><motion>'
        f'<to pos="0 0 40 mm" in="1 s" hold="until skin {within} K"/></motion></operator></interaction></itouch>',
        encoding="utf-8",
    )
    (operator,) = itouch.load(path).operators
    assert operator.motion.targets[0].hold == Until(within)


def test_a_wait_for_a_skin_that_nothing_tells_is_one_message(tmp_path: Path) -> None:
    path = tmp_path / "nothing.xml"
    path.write_text(
        '<itouch version="1.0"><devices><device name="a" plugin="usb-arm"/></devices><interaction>\n'
        '<probe name="p" pose-from="a"/><operator probe="p"><motion>\n'
        '<to pos="0 0 40 mm" in="1 s" hold="until skin 1 K"/></motion></operator></interaction></itouch>',
        encoding="utf-8",
    )
    with pytest.raises(itouch.SceneError) as raised:
        itouch.build(path)
    (problem,) = raised.value.problems
    assert problem.code == "missing-channel" and "'p'" in problem.sentence
    assert (problem.place.line, problem.place.column) == (3, 30)


def test_editors_know_it_and_what_is_written_reads_the_same(scene: Path, tmp_path: Path) -> None:
    for name, text in schemas(Catalog()).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    schema = etree.XMLSchema(etree.parse(str(tmp_path / "itouch.xsd")))
    schema.assertValid(etree.parse(str(scene)))
    wrong = scene.read_text(encoding="utf-8").replace("until skin 0.4 K", "until the skin is back")
    assert not schema.validate(etree.fromstring(wrong.encode()))
    loaded = itouch.load(scene)
    hold = loaded.operators[0].motion.targets[3].hold
    assert hold == Until(0.4) and str(hold) == "until skin 0.4 K"
    assert f'hold="{hold}"' in write(loaded)


def test_a_sensor_comes_before_a_twin_and_each_finger_has_its_own(tmp_path: Path) -> None:
    path = tmp_path / "two.xml"
    path.write_text(
        '<itouch version="1.0"><include file="itouch:rigs/twin.xml"/>'
        '<include file="itouch:rigs/twin.xml" prefix="b-"/><interaction>'
        '<probe name="b" pose-from="b-arm" force-to="b-arm" surface-to="b-table"/>'
        '<probe name="a" pose-from="arm" force-to="arm" surface-to="table"/></interaction></itouch>',
        encoding="utf-8",
    )
    two = Model.of(itouch.load(path), Catalog())
    assert [skin_of(two, probe) for probe in two.probes] == [
        SkinSource("b-peltier.skin_temperature", "b-peltier.skin_valid"),
        SkinSource("peltier.skin_temperature", "peltier.skin_valid"),
    ]


# Ticks: a baseline of 4, a window of 2, and 10 at most; one wait at tick 6 of the path.
SPANS = np.array([4, 2, 10])


def play(skins: list[float], valid: list[bool]) -> tuple[list[int], int, int]:
    """Return the ticks on the path, and how long the wait lasted and how it ended."""
    one, whole = (lambda: np.zeros(1)), (lambda: np.zeros(1, np.int64))
    skin, seen, ticks, tick = one(), whole(), whole(), whole()
    means = waits.Means(baseline=one(), averaged=whole(), skin=one(), fresh=whole())
    table = waits.Table(wait_begin=np.full(1, -1), waited=whole(), wait_end=whole(), wait_skin=one())
    rules = waits.Rules(tick, np.array([6]), np.array([0.5]), SPANS[:1], SPANS[1:2], SPANS[2:])
    along = AlongPath(np.ones(1), np.zeros(1), ticks, one(), 1e-3, np.zeros(3), 1e-4, whole() - 1, 3)
    reading = waits.Reading(skin, seen, np.full(1, -1), one())
    path = []
    for value, good in zip(skins, valid, strict=True):
        skin[0], seen[0] = value, good
        waits.follow_waiting_path(along, reading, rules, means, table)
        tick[0] += 1
        path.append(int(ticks[0]))
    return path, int(table.waited[0]), int(table.wait_end[0])


@given(st.lists(st.tuples(st.floats(300.0, 310.0), st.booleans()), min_size=20, max_size=40))
def test_a_wait_ends_by_the_skin_or_by_time_and_never_otherwise(rows: list[tuple[float, bool]]) -> None:
    path, waited, end = play([value for value, _ in rows], [good for _, good in rows])
    assert all(0 <= after - before <= 1 for before, after in zip(path, path[1:], strict=False))
    assert waited <= 10 and path[-1] == len(rows) - waited
    assert end in (waits.BACK, waits.TOO_LONG)
    assert (end == waits.TOO_LONG) <= (waited == 10)
    if end == waits.BACK:
        at = 6 + waited  # the tick in which it went on
        good = [value for value, seen in rows[: at + 1] if seen]
        assert rows[at][1] and rows[at - 1][1]
        base = sum(good[:4]) / len(good[:4])
        recent = [value for value, _ in rows[at - 1 : at + 1]]
        assert min(recent) - 10.0 < base < max(recent) + 10.0


def test_a_skin_that_is_never_read_or_never_back_ends_the_wait_in_time() -> None:
    assert play([306.0] * 30, [False] * 30)[1:] == (10, waits.TOO_LONG)
    assert play([306.0] * 5 + [304.0] * 25, [True] * 30)[1:] == (10, waits.TOO_LONG)
    assert play([306.0] * 5 + [304.0] * 5 + [306.0] * 20, [True] * 30)[1:] == (5, waits.BACK)
    assert play([306.0] * 30, [True] * 30)[1:] == (0, waits.BACK)
    assert play([306.0] * 5 + [np.nan] * 4 + [306.0] * 21, [True] * 30)[1:] == (4, waits.BACK)
    assert play([306.0] * 5 + [0.0] * 4 + [306.0] * 21, [True] * 30)[1:] == (4, waits.BACK)  # no skin is that cold


def test_a_wait_is_a_minute_at_most() -> None:
    assert LONGEST == 60.0
    assert window_ticks(1e-3) == (1000, 100, 60_000)


@pytest.mark.long
def test_a_skin_that_does_not_come_back_is_told_after_a_minute(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cold.xml"
    rigs = tmp_path / "rigs"
    rigs.mkdir()
    for name in ("materials.xml", "rigs/twin.xml"):
        (tmp_path / name).write_bytes((SCENES / name).read_bytes())
    path.write_text(text_with(MOTION.replace("0.4 K", "0.05 K").replace('hold="0.6 s"', 'hold="4 s"')), "utf-8")
    report = tmp_path / "r.json"
    assert main(["run", str(path), "--headless", "--pace", "fast", "--report", str(report)]) == 0
    told = capsys.readouterr()
    assert "waited 60 s for its skin" in told.err and "and not within 0.05 K of 33.0 degC" in told.err
    assert "finger waited for its skin: 60.0 s (not back)" in told.out
    found = json.loads(report.read_text("utf-8"))
    assert found["waits"][0]["back"] is False and found["waits"][0]["waited_s"] == 60.0
    assert any("waited 60 s" in notice for notice in found["notices"])
