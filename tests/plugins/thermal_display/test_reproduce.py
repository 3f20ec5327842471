"""The paper's figures and claims from one command."""

import contextlib
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest

from itouch_thermal import reproduce
from itouch_thermal.flux.curve import read_curve
from itouch_thermal.paper import claims_display, claims_touch, drawing, figures, page
from itouch_thermal.paper.claim import FAILS, HOLDS, PARTLY, UNKNOWN, VERDICTS, Check, Claim
from itouch_thermal.paper.setup import MATERIALS, Setup, halfspaces, measure, touch
from itouch_thermal.paper.work import Work
from itouch_thermal.rendering.closedloop import Case, Course, desired_course

#: Figures that cost little; all of them are drawn in the long form.
QUICK = (2, 5, 10)


@pytest.fixture(scope="module")
def work():
    return Work()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduced")
    lab = out / "lab"
    lab.mkdir()
    (lab / "wood.csv").write_text("# by hand\nt,j\n0.0,100\n1.0,1500\n9.0,500\n", encoding="utf-8")
    numbers = [word for number in QUICK for word in ("--figure", str(number))]
    assert reproduce.main(["--out", str(out), "--csv", "--measured", str(lab), *numbers]) == 0
    return out


@pytest.mark.parametrize("number", QUICK)
def test_each_figure_is_drawn_twice(made, number):
    picture = (made / f"figure{number:02d}.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 10_000
    assert ElementTree.parse(made / f"figure{number:02d}.svg").getroot().tag.endswith("svg")


def test_only_the_figures_that_are_asked_for_are_made(made, capsys):
    assert not (made / "figure03.png").exists() and not (made / "claims.md").exists()
    assert reproduce.main(["--out", str(made), "--figure", "8"]) == 0
    assert capsys.readouterr().out.startswith(f"wrote figure 8 to {made} in ")


def test_every_curve_is_a_file_that_can_be_played(made):
    for name in MATERIALS:
        curve = read_curve(str(made), f"figure02-{name}.csv")
        assert curve.times[1] == 1.0 and curve.times[-1] == pytest.approx(11.0)
    rows = [row for row in (made / "figure05a-current.csv").read_text().splitlines() if not row.startswith("#")]
    assert rows[0] == "t [s],i [A]" and len(rows) == 10_001
    assert len(list(made.glob("figure05*.csv"))) == 6


def test_a_labs_curve_is_laid_over(made):
    lines = [line for line in (made / "figure02-wood-measured.csv").read_text().splitlines() if line[0] != "#"]
    assert lines[1:] == ["1,100", "2,1500", "10,500"]


def test_beside_it_is_the_models_flux_out_of_the_finger(made, work):
    curve = read_curve(str(made), "figure02-wood-out-of-finger.csv")
    assert curve.times[0] == pytest.approx(1.001)
    assert curve.fluxes == pytest.approx(work.real("wood").flux, rel=1e-6)


def test_a_sign_stays_in_the_name_of_a_file():
    assert drawing._slug("-8 K") == "-8-k" and drawing._slug("+8 K") == "+8-k"
    assert drawing._slug("wood, measured (II)") == "wood-measured-ii"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--figure", "12"], "figure 12 is left out: a photograph"),
        (["--figure", "14"], "no figure 14"),
        (["--measured", "nowhere"], "not a folder"),
        (["--measured", "."], "holds none of aluminium.csv"),
    ],
)
def test_what_cannot_be_drawn_is_said(words, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert reproduce.main(["--out", "out", *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error:") and said in error


def test_the_time_left_has_room_in_eighty_columns(monkeypatch):
    """A bar, the part done and a clock leave 34 letters; what is longer is cut at its end, where the time left is."""
    said = []

    class Wait:
        def part(self, done, words):
            said.append(words)

    @contextlib.contextmanager
    def waiting(what):
        said.append(what)
        yield Wait()

    now = iter(range(0, 10_000, 100))
    monkeypatch.setattr(reproduce, "waiting", waiting)
    monkeypatch.setattr(reproduce.time, "monotonic", lambda: float(next(now)))
    reproduce._run([(name, 1.0, lambda: None) for name in ("figure 1", "figure 11", "claims", "a session")])
    what, *parts = said
    assert parts[1].endswith("s left") and max(len(f"{what}: {part}") for part in parts) <= 34


def test_curves_that_are_not_shown_are_told(tmp_path, capsys):
    """A file of another spelling, or a figure without curves, is not passed over in silence."""
    for name in ("wood", "aluminum", "PMMA"):
        (tmp_path / f"{name}.csv").write_text("t,j\n0,100\n1,90\n", encoding="utf-8")
    words = ["--out", str(tmp_path / "out"), "--figure", "8", "--measured", str(tmp_path)]
    assert reproduce.main(words) == 0
    said = capsys.readouterr().err
    assert "note: --measured: the paper has no PMMA.csv, aluminum.csv; shown are aluminium, pyrex" in said
    assert "note: --measured: curves are laid over figures 2, 5, 6, 7, 11 only" in said


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path, capsys):
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert reproduce.main(["--out", str(tmp_path / "file" / "below")]) == 2
    assert capsys.readouterr().err.startswith("error:")


def test_every_figure_of_the_paper_is_drawn_or_left_out_with_its_reason():
    assert set(figures.FIGURES) | set(figures.LEFT_OUT) == set(range(1, 14))
    assert all(len(why) > 20 for why in figures.LEFT_OUT.values())


@pytest.mark.parametrize(("met", "verdict"), [((), UNKNOWN), ((1, 1), HOLDS), ((1, 0), PARTLY), ((0, 0), FAILS)])
def test_a_verdict_follows_from_the_bounds(met, verdict):
    claim = Claim("II", "words", "set-up", tuple(Check("it", value, 0.5) for value in met))
    assert claim.verdict == verdict
    assert claim.row().endswith(f"| {verdict} |")
    assert not Check("nothing", float("nan"), 0.0, 1.0).met


#: A claim, its verdict, what breaks its set-up, and the verdict then.
BROKEN = [
    (claims_touch.faster, HOLDS, {"film": 0.0, "resistance": 1e-7, "press": 0.0}, FAILS),
    (claims_touch.rise, HOLDS, {"press": 0.0, "lag": 0.0}, PARTLY),
    (claims_touch.small_sensor, PARTLY, {"film": 1e-6}, HOLDS),
    (claims_touch.two_steps, HOLDS, {"film": 0.0}, PARTLY),
    (claims_touch.any_situation, HOLDS, {"resistance": 0.0}, PARTLY),
    (claims_touch.wet, HOLDS, {"film": 4e-4}, FAILS),
    (claims_touch.printed, FAILS, {"resistance": 1.0}, HOLDS),
    (claims_display.start_temperatures, HOLDS, {"plate_effusivity": 200.0}, PARTLY),
]


@pytest.mark.parametrize(("maker", "before", "broken", "after"), BROKEN, ids=lambda v: getattr(v, "__name__", None))
def test_a_broken_set_up_changes_the_verdict(work, maker, before, broken, after):
    assert maker(work).verdict == before
    assert maker(Work(replace(work.setup, **broken))).verdict == after


@pytest.mark.parametrize(
    ("maker", "broken"),
    [
        (claims_touch.correlated, lambda case: Course(desired_course(case).flux, -desired_course(case).skin)),
        (claims_touch.temperatures, lambda case: desired_course(Case(case.material, seconds=case.seconds))),
    ],
    ids=["a skin that warms", "a flux that no temperature changes"],
)
def test_what_is_physics_holds_of_other_courses_not(work, maker, broken, monkeypatch):
    assert maker(work).verdict == HOLDS
    monkeypatch.setattr(claims_touch, "desired_course", broken)
    assert maker(work).verdict == FAILS


def test_equation_three_begins_right_without_a_resistance_and_wrong_with_one(work):
    names = claims_display.TRACKED
    with_one = claims_display.initial_flow(work)
    assert with_one.verdict == PARTLY
    assert [check.met for check in with_one.checks] == [True, False, False]
    starts = [work.setup.start(name) - 273.15 for name in names]
    assert starts == pytest.approx([22.33, 30.40, 32.61], abs=0.01)


def test_a_labs_curves_make_the_model_checkable(work):
    """What `measure touch` writes is the flux out of the finger; what the film shows late is no such curve."""
    times, flux = work.scheme_flux("wood")
    assert np.abs(work.scheme("wood")[1] / flux - 1.0).max() > 0.2
    from itouch_thermal.flux.curve import Curve

    for factor, verdict in ((1.05, HOLDS), (1.3, FAILS)):
        own = Work(work.setup, {"wood": Curve.of(times, factor * flux)})
        own._kept = work._kept
        assert claims_touch.accurate_model(own).verdict == verdict


def _report(**changes):
    contacts = [
        {"end_s": 1.0, "material": name, "plate_lead_ms": 1.0, "plate_gap_mm": 0.002, "mean_flux_W_m2": 100.0}
        for name in MATERIALS
    ]
    report = {
        "contacts": contacts,
        "table": {"tracking_mm": {"p99": 0.1}, "height_error_mm_max": 0.02},
        "servo": {"rate_hz": 1000.0, "tick_us": {"p50": 60.0}},
    }
    return report | changes


@pytest.mark.parametrize(
    ("changes", "verdicts"),
    [
        ({}, [HOLDS] * 5),
        ({"contacts": []}, [FAILS, FAILS, PARTLY, HOLDS, HOLDS]),
        ({"table": {"tracking_mm": {"p99": 3.0}, "height_error_mm_max": 0.5}}, [HOLDS, HOLDS, PARTLY, FAILS, HOLDS]),
        ({"servo": {"rate_hz": 1000.0, "tick_us": {"p50": 1500.0}}}, [HOLDS] * 4 + [FAILS]),
    ],
)
def test_the_session_speaks_for_section_five(changes, verdicts):
    assert [claim.verdict for claim in claims_display.session_claims(_report(**changes))] == verdicts


def test_without_a_session_its_claims_are_unknown():
    assert {claim.verdict for claim in claims_display.session_claims(None)} == {UNKNOWN}


def test_the_page_has_set_up_claims_and_figures(work):
    claim = Claim("II", "words", "set-up", (Check("it", 1.0, 0.5),))
    text = page.page([claim], [figures.FIGURES[8](work), figures.FIGURES[10](work)])
    for what in ("Phantom Omni", "contact area", "module", "15e-6", "Equation 10", "Left out:", "* Figure 13:"):
        assert what in text
    assert "| II | words | set-up | it 1 | ≥ 0.5 | holds |" in text
    assert "(figure08.png)" in text and "\nFigure 10. " in text and "nan" not in text


def test_the_page_tells_the_contact_area_that_figures_are_made_with(work):
    rows = {what: here for what, _, here in page.DIFFERENCES}
    module = work.setup.module
    assert module.contact_area < module.area
    assert f"{1e4 * module.contact_area:g} cm² at 1 N of its {1e4 * module.area:g} cm²" in rows["contact area"]
    assert rows["flux film's area"].startswith(f"{1e4 * module.sensor_area:g} cm²")


def test_the_film_reads_less_than_crosses_the_contact_and_the_same_later():
    setup = Setup(seconds=3.0)
    found = measure("aluminium", setup)
    assert np.all(found.reading[:100] < found.flux[:100])
    # A first-order sensor follows a slope late by its time constant.
    late = found.flux[-1 - round(setup.lag * 1e3)]
    assert found.reading[-1] == pytest.approx(late, rel=2e-3)


def test_insulators_fall_faster_only_under_the_film():
    def fall(flux):
        return flux[999] / flux[99]

    bare = {name: fall(touch(name, 1e-4, 1.0)) for name in ("aluminium", "polystyrene")}
    film = {name: fall(touch(name, 1e-4, 1.0, film=Setup().film)) for name in ("aluminium", "polystyrene")}
    assert bare["aluminium"] == pytest.approx(bare["polystyrene"], rel=0.06)
    assert film["polystyrene"] < 0.5 * film["aluminium"]
    assert film["polystyrene"] == pytest.approx(0.128, abs=0.005)


def test_halfspaces_begin_at_the_resistance_and_end_as_equation_two():
    ours, other = 1167.0, 352.4
    first, late = halfspaces(np.array([1e-9, 100.0]), 1e-4, ours, other)
    assert first == pytest.approx(10.0 / 1e-4, rel=0.01)
    assert late == pytest.approx(10.0 / (1 / ours + 1 / other) / (3.14159 * 100.0) ** 0.5, rel=0.01)


def test_the_module_is_slow(work):
    step = work.step(seconds=3.0, touched=True)
    assert abs(step[:1000]).max() < 1e-6
    assert step[1010] < 0.01 * step[-1]
    assert 0.02 < step[1100] / step[-1] < 0.2


@pytest.mark.long
def test_the_whole_page(tmp_path):
    assert reproduce.main(["--out", str(tmp_path)]) == 0
    text = (tmp_path / "claims.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.endswith(tuple(f"| {verdict} |" for verdict in VERDICTS))]
    assert len(rows) >= 38 and "nan" not in text
    assert sum(row.endswith(f"| {UNKNOWN} |") for row in rows) == 2
    for number in figures.FIGURES:
        assert (tmp_path / f"figure{number:02d}.png").read_bytes().startswith(b"\x89PNG")
