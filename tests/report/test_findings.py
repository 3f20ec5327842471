"""What the page tells: the session's own figures, whatever became of the recording, whatever a file says."""

from __future__ import annotations

import io
import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from program import program as cli
from shipped import SCENES

import itouch
from itouch.schema import Place, Problem
from itouch_tools.report import safety, screen, sections
from itouch_tools.report.collect import _Shown, collect
from itouch_tools.report.curves import thinned
from itouch_tools.report.markup import number, table
from itouch_tools.report.problem_formats import as_sarif
from itouch_tools.report.screen import _closing
from itouch_tools.report.session_page import page

SCENE = """<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="1.2 N/mm" damping="1 N*s/m" static-friction="0.4"/></material>
    <material name="foam" base="wood"><contact stiffness="0.4 N/mm"/></material></materials>
  <world><box name="left" size="60 60 20 mm" pos="-30 0 10 mm" material="wood"/>
    <box name="right" size="60 60 30 mm" pos="30 0 15 mm" material="foam"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion>{motion}</motion></operator></interaction>
  {more}
</itouch>"""


def made(folder, seed: int, *, more: str = "", seconds: float | None = None) -> itouch.Session:
    """Record a random motion into ``run.mcap``."""
    rng = np.random.default_rng(seed)
    steps = (f'<to pos="{x:.1f} {y:.1f} {z:.1f} mm" in="{t:.2f} s"/>' for x, y, z, t in zip(
        rng.uniform(-50, 50, 8), rng.uniform(-20, 20, 8), rng.uniform(15, 60, 8), rng.uniform(0.1, 0.4, 8), strict=True
    ))  # fmt: skip
    (folder / "scene.xml").write_text(SCENE.format(motion="".join(steps), more=more))
    session = itouch.build(folder / "scene.xml", seed=seed)
    session.record(folder / "run.mcap")
    try:
        session.run(seconds)
    except itouch.DeviceFaultError:
        assert "fault" in more
    session.close()
    return session


@pytest.mark.parametrize("seed", range(4))
def test_figures_are_those_of_the_run_recorded_and_replayed(tmp_path, seed, monkeypatch):
    report = json.loads(json.dumps(made(tmp_path, seed).report()))
    shown = collect(tmp_path / "run.mcap")
    assert shown.contacts == report["contacts"] and shown.report["devices"] == report["devices"]
    assert shown.timing["tick_us"] == report["servo"]["tick_us"]
    assert shown.summary["contacts"] == str(len(report["contacts"]))
    monkeypatch.setattr("itouch.recording.Recording.report", None)  # as of an earlier version, or of a killed session
    replayed = collect(tmp_path / "run.mcap")
    assert json.loads(json.dumps(replayed.contacts)) == report["contacts"]
    assert replayed.timing["tick_us"]["p99"] == report["servo"]["tick_us"]["p99"]
    assert replayed.summary == shown.summary


def test_a_fault_is_told_with_what_became_of_it_and_its_safe_sequence_is_drawn(tmp_path):
    fault = '<fault device="arm" kind="disconnect" at="0.9 s"/>'
    session = made(tmp_path, 1, more=fault)
    shown = collect(tmp_path / "run.mcap")
    assert shown.faults == json.loads(json.dumps(session.report()["faults"]))
    assert shown.faults[0]["safe"]["reached"] and shown.summary["faults"] == "2"  # it, and what was injected
    assert shown.curves.whole.times[-1] == pytest.approx(session.seconds, abs=2e-3)
    text = page(shown)
    assert "disconnected" in text and "injected: disconnect" in text


@pytest.mark.parametrize("part", [0.3, 0.6, 0.95])
def test_a_session_that_was_cut_has_a_page_that_says_so(tmp_path, part):
    made(tmp_path, 2)
    data = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(data[: int(part * len(data))])
    shown = collect(tmp_path / "run.mcap")
    assert "not read" in shown.losses[0] and shown.losses[0] in page(shown)
    assert np.isfinite(shown.curves.whole.values).all()


def test_a_session_that_was_cut_behind_the_head_of_its_file_still_has_a_page(tmp_path):
    made(tmp_path, 2)
    data = (tmp_path / "run.mcap").read_bytes()
    head = make_reader(io.BytesIO(data)).get_summary().chunk_indexes[0]
    (tmp_path / "run.mcap").write_bytes(data[: head.chunk_start_offset + head.chunk_length + 5])
    shown = collect(tmp_path / "run.mcap")
    assert "not read" in shown.losses[0] and shown.losses[0] in page(shown)


def test_a_session_without_ticks_or_without_contacts_has_a_page(tmp_path):
    made(tmp_path, 3, seconds=0.0)
    shown = collect(tmp_path / "run.mcap")
    assert shown.summary["duration"] == "0.000 s" and shown.contacts == []
    assert "none" in page(shown)


def test_figures_that_are_none_do_not_stop_the_page(tmp_path):
    made(tmp_path, 4)
    shown = collect(tmp_path / "run.mcap")
    nan, text = float("nan"), "?"
    for contact in shown.report["contacts"]:
        contact |= {"peak_force_N": nan, "impact_speed_m_s": text, "material": None, "skin_drop_K": -float("inf")}
    shown.faults = [{"time_s": text, "safe": {"reached": True, "after_s": nan}}, {}]
    shown.marks = [{"time": nan, "payload": [1]}]
    shown.timing = {"tick_us": {"p50": nan, "p99": "x"}, "histograms_us": [], "parts_us": 3, "culprits": None}
    shown.timing |= {"worst": [{"tick": nan, "us": text}, {}, 3], "rate_hz": text}
    shown.curves.whole.values[:, ::3] = np.nan
    assert "NaN" not in page(shown).split('id="data"')[1].split("</script>")[0]


@settings(max_examples=100, deadline=None)
@given(st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text()), st.sampled_from([".6g", ".2f"]))
def test_any_cell_is_text_that_can_be_written(value, form):
    table(["a"], [[number(value, form)]]).encode()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 3000), st.integers(10, 800), st.integers(0, 2), st.integers(0, 99))
def test_thinning_keeps_extremes_order_and_gaps(count, most, gaps, seed):
    rng = np.random.default_rng(seed)
    ticks = np.arange(count) + 0.0
    for place in rng.integers(1, max(count, 2), gaps):
        ticks[place:] += 50.0
    values = rng.standard_normal((count, 3)).astype(np.float32)
    block = thinned(ticks * 1e-3, values, most, 1e-3)
    holes = np.isnan(block.values).any(axis=0)
    assert holes.sum() == len(set(np.flatnonzero(np.diff(ticks) > 1.0)))
    assert len(block.times) == block.values.shape[1] <= max(most, 0) + 4 * (gaps + 1)
    assert (np.diff(block.times) >= 0.0).all()
    if count:
        np.testing.assert_array_equal(np.nanmax(block.values, axis=1), values.max(axis=0))
        np.testing.assert_array_equal(np.nanmin(block.values, axis=1), values.min(axis=0))


def test_a_page_that_can_not_be_written_is_refused_in_a_sentence(tmp_path):
    made(tmp_path, 5, seconds=0.1)
    session = str(tmp_path / "run.mcap")
    (tmp_path / "old.html").write_text("old")
    for target in (str(tmp_path), str(tmp_path / "none" / "x.html"), session, ""):
        done = cli("report", session, "-o", target)
        assert done.returncode == 2 and "Traceback" not in done.stderr and len(done.stderr.splitlines()) < 6, target
    assert cli("report", session).returncode == 2
    assert cli("report", session, "-o", str(tmp_path / "old.html")).returncode == 0
    assert "<!DOCTYPE html>" in (tmp_path / "old.html").read_text()
    assert cli("report", str(SCENES / "first_touch.xml"), "-o", str(tmp_path / "x.html")).returncode == 2


def test_what_rounds_to_nothing_has_no_sign() -> None:
    from itouch.plugin import Measured

    assert Measured("gap_mm", "mm", "a gap", digits=3).formatted(-0.0004) == "0.000"
    assert Measured("gap_mm", "mm", "a gap", digits=3).formatted(-0.0006) == "-0.001"
    assert number(-0.0004, ".3f") == "0.000"


def test_a_table_of_several_fingers_says_which() -> None:
    lines = cli("run", str(SCENES / "two_fingers.xml"), "--headless", "--no-record", "--for", "1s").stdout.splitlines()
    found = [line.split()[:3] for line in lines if " wood " in line]
    assert found == [["thumb", "block", "wood"], ["index", "block", "wood"]]
    assert any(line.startswith("probe  object  material  begin s") for line in lines)


def test_a_run_without_contacts_says_so_in_place_of_a_table() -> None:
    lines = cli(
        "run", str(SCENES / "first_touch.xml"), "--headless", "--no-record", "--for", "0.1s"
    ).stdout.splitlines()
    assert "no contact with a virtual object" in lines
    assert not any("begin s" in line for line in lines)


def test_a_late_tick_is_told_by_its_time_in_the_session() -> None:
    timing = {"rate_hz": 500, "ticks": 10, "worst": [{"tick": 3, "us": 41.6, "culprit": "arm"}]}
    told = sections.timing(SimpleNamespace(timing=timing), 0)
    assert told["period"] == "2000"
    assert told["tables"][-1].rows == [["3", "0.006", "42", "arm"]]


def test_the_last_line_of_a_run_says_what_is_known_of_it() -> None:
    report = {
        "simulated_s": 3.0, "ran_s": 3.0, "wall_s": 1.5, "faults": [{}, {}],
        "servo": {"tick_us": {"p50": None, "p99": None}, "overruns": None}, "table": {"tracking_mm": {"p99": None}},
    }  # fmt: skip
    assert _closing(report) == "3.000 s simulated in 1.5 s (2.0 x real time); 2 faults"
    restored = {**report, "simulated_s": 4003.0}
    assert _closing(restored) == "4003.000 s simulated, 3.000 s of them in 1.5 s (2.0 x real time); 2 faults"
    report["servo"] = {"tick_us": {"p50": 20.4, "p99": 31.6}, "overruns": 1}
    report["table"] = {"tracking_mm": {"p99": 0.256}}
    assert _closing(report) == (
        "3.000 s simulated in 1.5 s (2.0 x real time); tick p50 20 us, p99 32 us; 1 overrun; "
        "table within 0.26 mm of its command (p99); 2 faults"
    )


def test_a_number_beyond_all_bounds_is_a_dash() -> None:
    assert [number(value, ".2f") for value in (10**400, float("inf"), float("nan"))] == ["-", "-", "-"]
    assert number(1e300, ".2g", 1e300) == "-"


def test_what_a_contact_was_not_stands_below_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(screen, "_noted", lambda engine: ())
    entry = {"probe": "finger", "object": "pad", "material": "foam", "begin_s": 1.0, "end_s": 2.0, "plate_missed": True}
    engine = SimpleNamespace(
        statistics=SimpleNamespace(contacts=[]), model=SimpleNamespace(modalities=(), probes=("finger",))
    )
    out = io.StringIO()
    screen.Screen(engine, out).finish({
        "contacts": [entry], "waits": [{"probe": "finger", "waited_s": 3.21, "back": False, "ended": True}],
        "simulated_s": 1.0, "ran_s": 1.0, "wall_s": 0.0, "devices": {"arm": {}}, "faults": [],
        "servo": {"tick_us": {"p50": None, "p99": None}, "overruns": None}, "table": {"tracking_mm": {"p99": None}},
    })  # fmt: skip
    assert out.getvalue().splitlines()[-3:] == [
        "pad at 1.000 s: the plate was not felt where it should have been; the arm gave its force",
        "finger waited for its skin: 3.2 s (not back)",
        "1.000 s simulated in 0.0 s (0.0 x real time); 0 faults",
    ]


def test_how_long_a_run_takes_yet_is_told_once_its_rate_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now=100.0, simulated=0.0)
    monkeypatch.setattr(screen, "_noted", lambda engine: ())
    monkeypatch.setattr(screen, "is_terminal", lambda stream: True)
    monkeypatch.setattr(screen.time, "monotonic", lambda: clock.now)
    monkeypatch.setattr(screen.Screen, "_parts", lambda shown: shown._progress())
    out = io.StringIO()
    engine = SimpleNamespace(statistics=SimpleNamespace(contacts=[]))
    shown = screen.Screen(engine, out, left=lambda: 200.0 - clock.simulated)
    told = []
    for clock.now, clock.simulated in ((100.0, 0.0), (100.9, 10.0), (101.0, 10.0), (108.0, 80.0), (300.0, 100.0),
                                       (301.0, 199.9), (302.0, 200.2)):  # fmt: skip
        out.seek(out.truncate(0))
        shown.show()
        told.append(out.getvalue().rsplit("\x1b[2K", 1)[-1].strip())
    assert told == ["", "5%", "5%, about 19 s left", "40%, about 12 s left", "50%, about 3 min left",
                    "99%, about 0 s left", "99%, about 0 s left"]  # fmt: skip


def test_contacts_are_told_as_they_end_unless_only_results_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(screen, "_noted", lambda engine: ())
    entry = {"probe": "finger", "object": "pad", "material": "foam", "begin_s": 1.0, "end_s": 2.0}
    engine = SimpleNamespace(
        statistics=SimpleNamespace(contacts=[]), model=SimpleNamespace(modalities=(), probes=("finger",))
    )
    for quiet, told in ((False, True), (True, False)):
        monkeypatch.setattr(screen.VERBOSITY, "quiet", quiet)
        engine.statistics.contacts = []
        out = io.StringIO()
        shown = screen.Screen(engine, out)
        engine.statistics.contacts = [entry]
        shown.show()
        assert out.getvalue().startswith("   2.000 s  finger left pad") == told
        assert bool(out.getvalue()) == told


def test_of_a_fault_times_are_numbers_and_the_rest_are_words() -> None:
    fault = {"time_s": 1.5, "device": "arm", "trip": "finger-force", "cause": "too strong", "scene": "a.xml:3:1"}
    told = sections.faults(SimpleNamespace(faults=[fault]))  # type: ignore[arg-type]
    assert told is not None and len(told.rows[0]) == len(told.heads)
    assert [head for index, head in enumerate(told.heads) if index not in told.words] == ["time [s]", "safe after [s]"]
    assert max(told.words) < len(told.heads)


@pytest.mark.parametrize(("length", "end"), [(0, 8), (1, 8), (4, 11)])
def test_a_code_review_marks_as_many_letters_as_are_wrong_and_one_at_least(length: int, end: int) -> None:
    problem = Problem("bad-value", "'x' is not a number", Place("a scene.xml", 3, 7, length))
    (result,) = as_sarif({"a scene.xml": [problem]}, version="1.0")["runs"][0]["results"]
    (location,) = result["locations"]
    assert location["physicalLocation"] == {
        "artifactLocation": {"uri": "a%20scene.xml"}, "region": {"startLine": 3, "startColumn": 7, "endColumn": end},
    }  # fmt: skip


def test_a_contact_is_told_in_millimetres_a_second_and_newtons() -> None:
    contact = {
        "object": "wood",
        "material": "oak",
        "begin_s": 1.0,
        "end_s": 2.5,
        "impact_speed_m_s": 2.0,
        "peak_force_N": 1.25,
    }
    found = sections.contacts(SimpleNamespace(contacts=[contact], model=None, curves=None))
    told = dict(zip(found.table.heads, found.table.rows[0], strict=True))
    assert (told["impact [mm/s]"], told["peak force felt [N]"], told["begin [s]"]) == ("2000", "1.25", "1.000")


@pytest.mark.parametrize(("rate", "period"), [(1000.0, "1000"), (0.5, "2000000"), (0, ""), (None, ""), ("fast", "")])
def test_the_period_of_a_tick_is_told_in_microseconds_if_the_rate_is_known(rate: object, period: str) -> None:
    assert sections.timing(SimpleNamespace(timing={"rate_hz": rate}), 0)["period"] == period


def test_the_worst_that_a_script_does_is_told_in_degrees_where_it_is_a_temperature() -> None:
    worst = SimpleNamespace(
        low={"plate [K]": 293.15, "push [N]": 0.0}, high={"plate [K]": 313.65, "push [N]": 1.5},
        dose=0.0, longest=0.25, session=SimpleNamespace(seconds=4.0),
    )  # fmt: skip
    *_, rows = safety._worst_case(SimpleNamespace(), worst, "")
    assert rows.rows[:2] == (("plate", "20.00 °C", "40.50 °C"), ("push", "0 N", "1.5 N"))


def test_the_dose_of_the_skin_is_told_in_minutes_at_43_degrees() -> None:
    worst = SimpleNamespace(low={"plate [K]": 300.0}, high={"plate [K]": 316.0}, dose=90.0, longest=12.0,
                            session=SimpleNamespace(seconds=100.0))  # fmt: skip
    *_, rows = safety._worst_case(SimpleNamespace(), worst, "")
    assert rows.rows[1:] == (
        ("thermal dose of the skin", "0", "1.5 CEM43"), ("longest contact with the plate", "", "12.00 s"),
    )  # fmt: skip


@pytest.mark.parametrize(("count", "shown", "more"), [(3, 3, 0), (12, 12, 0), (14, 12, 2)])
def test_a_dozen_remarks_stand_below_the_table_and_the_others_are_counted(
    count: int, shown: int, more: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sections, "measured", lambda model, entries: ())
    monkeypatch.setattr(sections.columns, "shortcomings", lambda model, entry: [])
    monkeypatch.setattr(sections.columns, "contact_warnings", lambda model, entry: [f"remark {entry['begin_s']}"])
    entries = [{"object": "wood", "begin_s": float(n)} for n in range(count)]
    found = sections.contacts(SimpleNamespace(contacts=entries, model=SimpleNamespace(probes=[1]), curves=None))
    assert list(found.remarks) == [f"remark {n}.0" for n in range(shown)]
    assert found.more == more


class _State(dict[str, int]):
    """A State that can be kept."""

    def copy(self) -> _State:
        return _State(self)


def test_the_picture_is_of_the_first_touch_that_lasts_half_a_second() -> None:
    model = SimpleNamespace(period=0.1, probes=[SimpleNamespace(name="thumb"), SimpleNamespace(name="finger")])
    shown = _Shown(model)
    ticks = [-1] * 3 + [2] * 4 + [-1] + [0] * 8 + [1] * 9  # four ticks are too short
    for tick, touched in enumerate(ticks):
        shown.look(_State({"thumb.object": -1, "finger.object": touched, "tick": tick}))
    assert shown.state == {"thumb.object": -1, "finger.object": 0, "tick": 12}


def test_without_such_a_touch_there_is_no_picture_of_one() -> None:
    shown = _Shown(SimpleNamespace(period=0.1, probes=[SimpleNamespace(name="finger")]))
    for touched in [-1] * 9 + [2] * 4 + [-1] * 9:
        shown.look(_State({"finger.object": touched}))
    assert shown.state is None


@pytest.mark.parametrize(
    ("twins", "simulated"), [((True, True), True), ((True, False), False), ((False, False), False), ((), False)]
)
def test_only_where_every_device_was_a_twin_a_session_is_said_to_be_simulated(
    twins: tuple[bool, ...], simulated: bool
) -> None:
    model = SimpleNamespace(devices={str(n): SimpleNamespace(twin=twin) for n, twin in enumerate(twins)})
    findings = SimpleNamespace(contacts=[], summary={}, faults=[], losses=[], model=model)
    assert ("simulated" in sections.answer(findings)["said"]) == simulated


def test_where_nothing_was_touched_for_long_the_end_is_pictured(tmp_path):
    made(tmp_path, 3, seconds=0.02)
    shown = collect(tmp_path / "run.mcap")
    assert not shown.touching and shown.state["tick"] == 20
