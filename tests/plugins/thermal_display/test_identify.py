"""Fingers and samples from recorded touches: intervals hold what they say, and what cannot be told is said."""

import contextlib
import io
import json
import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

import itouch
from contact_heat.contact import Contact
from contact_heat.exact import solve
from itouch_thermal import bench_identify
from itouch_thermal.film.film_params import FilmParams
from itouch_thermal.heat import finger_side
from itouch_thermal.identify import estimate
from itouch_thermal.identify.coverage import Row, campaign, touched
from itouch_thermal.identify.film_differences import readings
from itouch_thermal.identify.fit import ASSUMED, Problem, edges_for
from itouch_thermal.identify.forward import Forward, Known, Values, tissue
from itouch_thermal.identify.posterior import Mixture
from itouch_thermal.identify.records import load, problem_of
from itouch_thermal.paper.setup import lagged, sample
from itouch_thermal.rendering.materials import material

SKIN, ROOM, NOISE, FORCES = 306.15, 296.15, 20.0, (0.5, 1.0, 2.0)
TIMES = np.arange(1, 2001) * 2e-3
FILM = FilmParams().film


def known(name=None, **changes):
    layer = material(name)[1].layer(0.02) if name else None
    return replace(Known(SKIN, ROOM, FILM, FORCES, sample=layer), **changes)


def fitted(of, truth, rng, *, readings=None, draw=None):
    """Return the problem of touches with noise, and its fit."""
    exact = Forward(of, TIMES)(truth) if readings is None else readings
    noise = rng.normal(size=exact.shape) if draw is None else draw(exact.shape)
    problem = Problem(of, TIMES, exact + NOISE * noise, NOISE)
    return problem, problem.fit()


def test_the_closed_form_is_the_exact_solver():
    of, values = known("wood", forces=(1.0,)), Values(exponent=0.0, lag=1e-9)
    finger = finger_side(tissue(values), values.core, SKIN, ROOM)
    body = sample("wood")
    body = replace(body, layers=(FILM, *body.layers))
    times = np.array([0.05, 0.3, 1.0, 4.0])
    exact = solve(Contact(finger=finger, object=body, resistance=values.resistance), times)
    assert Forward(of, times)(values)[0] == pytest.approx(exact.flux_at("object", 0.5 * FILM.thickness), rel=1e-6)


@pytest.mark.long
def test_intervals_hold_the_truth():
    """A few fingers; the other one has 2000."""
    rows = campaign(6, 3, "wood")
    assert np.mean([row.coverage for row in rows]) > 0.85
    assert np.median([row.median for row in rows]) < 1.2


@pytest.mark.long
@pytest.mark.parametrize("other", [False, True])
@pytest.mark.parametrize("name", ["", "aluminium"])
def test_intervals_of_two_thousand_fingers_hold_95_of_100(name, other):
    for row in campaign(2000, 11, name, other=other):
        assert 0.93 <= row.coverage <= 0.97, row
        assert 0.6 < row.median < 0.8, row  # of a normal number it is 0.674


@pytest.fixture(scope="module")
def benched(tmp_path_factory):
    """The table and the document of `bench identify` for a few fingers, and its exit code."""
    path, said = tmp_path_factory.mktemp("bench") / "rows.json", io.StringIO()
    with contextlib.redirect_stdout(said):
        code = bench_identify.main(["--fingers", "2", "--seed", "5", "--sample", "wood", "--json", str(path)])
    return code, said.getvalue(), json.loads(path.read_text())


def test_the_bench_prints_coverage_and_the_bound_beside_the_error(benched):
    code, said, stored = benched
    assert code == 0 and "2 fingers, 93 to 97 % must hold the truth" in said
    assert (stored["fingers"], stored["seed"], stored["sample"]) == (2, 5, "wood")
    lines = {line.split()[0]: line.split() for line in said.splitlines()[1:-1]}
    assert set(lines) == set(stored["values"]) == set(ASSUMED) - {"effusivity"}
    for name, found in stored["values"].items():
        assert float(lines[name][1]) == pytest.approx(100 * found["coverage"], abs=0.05)
        assert float(lines[name][3]) == pytest.approx(found["error"], abs=1e-4)
        assert float(lines[name][4]) == pytest.approx(found["cramer_rao"], abs=1e-4)
    assert stored["values"]["perfusion"]["told"] == 0.0 and stored["values"]["resistance"]["told"] == 1.0


def test_a_step_does_not_leap_into_a_false_valley():
    """The tenth finger of this seed: its first step was so long that the fit ended 240 times as far off."""
    of, rng, shape = touched("aluminium"), np.random.default_rng(12), (len(FORCES), len(TIMES))
    problem = Problem(of, TIMES, np.zeros(shape), NOISE)
    for _ in range(10):
        place, noise = rng.normal(size=len(problem.names)), NOISE * rng.normal(size=shape)
    truth = problem.values(place)
    problem = Problem(of, TIMES, Forward(of, TIMES)(truth) + noise, NOISE)
    point, cost = problem.solve()
    assert cost < 1.6 * problem.data.size
    assert problem.values(point).resistance == pytest.approx(truth.resistance, rel=0.05)


def test_a_mixture_along_a_coordinate_is_the_distribution_that_it_walks():
    """A normal one: the walked coordinate has deviation 1, the other is twice it with 0.5 of its own."""
    places = np.linspace(-4.0, 4.0, 17)
    middle = np.stack((places, 2.0 * places), axis=1)
    mixture = Mixture.of(0, places, -0.5 * places**2, middle, np.tile([0.0, 0.5], (17, 1)))
    assert mixture.quantile(0.975) == pytest.approx([1.96, 1.96 * math.hypot(2.0, 0.5)], abs=0.01)
    assert mixture.quantile(0.5) == pytest.approx([0.0, 0.0], abs=1e-3)


def test_an_epidermis_that_may_be_thin_or_thick_has_an_interval_of_both():
    """Its curvature at the better valley alone gave an interval that the truth was 14 deviations from."""
    of, rng = touched("wood"), np.random.default_rng(4)
    place = np.array([-1.27, -0.72, -0.63, 1.33, 0.48, 0.05, -0.27, 0.79, -0.55, 0.25])
    truth = Problem(of, TIMES, np.zeros((len(FORCES), len(TIMES))), NOISE).values(place)
    shown = Forward(of, TIMES)(truth) + NOISE * rng.normal(size=(len(FORCES), len(TIMES)))
    fit = Problem(of, TIMES, shown, NOISE).fit()
    for name in ("epidermis", "gain", "resistance", "core"):
        assert fit.found[name].low < getattr(truth, name) < fit.found[name].high, name


def test_intervals_that_are_too_narrow_are_seen(monkeypatch, capsys):
    monkeypatch.setattr("itouch_thermal.identify.fit.HELD", 0.08)
    assert bench_identify.main(["--fingers", "3", "--sample", "wood"]) == 1
    assert "MISSED by" in capsys.readouterr().out


def test_many_fingers_must_hold_and_few_may():
    assert Row("x", 2000, 1900, 1.0, 1.0, 1.0).holds
    assert not Row("x", 2000, 1720, 1.0, 1.0, 1.0).holds
    assert not Row("x", 5000, 4990, 1.0, 1.0, 1.0).holds
    assert Row("x", 10, 10, 1.0, 1.0, 1.0).holds


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--fingers", "0"], "--fingers must be 1 or more"), (["--sample", "kryptonite", "--fingers", "1"], "kryptonite")],
)
def test_a_wrong_word_of_the_bench_is_one_message(words, said, capsys):
    assert bench_identify.main(words) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("name", ["", "wood"])
def test_the_other_solver_reads_what_the_closed_form_does(name):
    """They share the numbers of the tissue and nothing else; noise of a sample is 20 W/m2."""
    of = touched(name)
    truth = Values(resistance=1.4e-3, exponent=0.35, curve=0.02, effusivity=900.0, lag=0.045, gain=1.01, late=4e-3,
                   offset=3.0)  # fmt: skip
    shown, own = readings(of, truth, TIMES), Forward(of, TIMES)(truth)
    assert np.abs(shown - own)[:, 25:].max() < 2.0
    assert np.abs(own).max() > 1000.0


def test_more_is_told_of_what_is_known():
    rng = np.random.default_rng(5)
    truth = Values(resistance=1.2e-3, effusivity=900.0)
    _, blind = fitted(known(), truth, rng)
    assert blind.found["effusivity"].low < 900.0 < blind.found["effusivity"].high
    assert blind.found["effusivity"].told and blind.found["resistance"].told
    assert not blind.found["perfusion"].told
    assert "effusivity" not in fitted(known("wood"), truth, rng)[1].found
    assert "exponent" not in fitted(known("wood", forces=(1.0,)), truth, rng)[1].found


def test_the_profile_is_flat_where_nothing_is_told_and_steep_where_it_is():
    problem, fit = fitted(known("wood"), Values(), np.random.default_rng(6))
    flat = [cost for _, cost in problem.profile("perfusion", fit, (-1.0, 0.0, 1.0))]
    steep = [cost for _, cost in problem.profile("resistance", fit, (-1.0, fit.point[0], 1.0))]
    assert max(flat) < 4.0 and min(flat) == 0.0
    assert steep[1] == pytest.approx(0.0, abs=1e-6) and min(steep[0], steep[2]) > 100.0


def differences(values, name, force):
    """Return a film's reading by implicit differences on a graded mesh, a solver of its own."""
    body = (FILM, material(name)[1].layer(0.02))
    cells, sides = [], []
    for layers in (tissue(values), body):
        rows = []
        for layer in layers:
            count = 6 if layer.thickness < 1e-4 else 40 if layer.thickness < 5e-3 else 90
            width = np.geomspace(1.0, 12.0 if count > 6 else 1.0, count)
            rows += [(w, layer) for w in width / width.sum() * layer.thickness]
        cells.append(rows)
    for rows in cells:
        width = np.array([w for w, _ in rows])
        k = np.array([layer.conductivity for _, layer in rows])
        c = np.array([layer.heat_capacity for _, layer in rows]) * width
        blood = np.array([layer.perfusion for _, layer in rows]) * width
        sides.append((0.5 * width / k, c, blood))
    (hf, cf, bf), (hb, cb, _) = sides
    half = np.concatenate((hf[::-1], hb))
    capacity, blood = np.concatenate((cf[::-1], cb)), np.concatenate((bf[::-1], np.zeros(len(cb))))
    joint, n = len(hf), len(half)
    link = half[:-1] + half[1:]
    still = 1.0 / link
    link[joint - 1] += values.resistance * force**-values.exponent
    still[joint - 1] = 0.0
    matrix = np.zeros((n, n))

    def conduct(g):
        found = np.diag(blood.copy())
        for i, value in enumerate(g):
            found[i, i] += value
            found[i + 1, i + 1] += value
            found[i, i + 1] -= value
            found[i + 1, i] -= value
        found[0, 0] += 1.0 / half[0]
        found[-1, -1] += 1.0 / (half[-1] + 0.1)
        return found

    source = blood * values.core
    source[0] += values.core / half[0]
    source[-1] += ROOM / (half[-1] + 0.1)
    # At rest the skin has its temperature: the loss is what makes it so.
    matrix = conduct(still)
    skin, pulled = source.copy(), matrix.copy()
    pulled[joint - 1, joint - 1] += 1.0 / half[joint - 1]
    skin[joint - 1] += SKIN / half[joint - 1]
    state = np.linalg.solve(pulled, skin)
    state[joint:] = ROOM
    matrix, shown, film = conduct(1.0 / link), [], joint + 2
    step = 1e-3
    gamma = 1.0 - np.sqrt(0.5)
    inverse = np.linalg.inv(np.diag(capacity) + gamma * step * matrix)
    for _ in range(round(TIMES[-1] / step)):  # two stages, L-stable, second order
        first = inverse @ (source - matrix @ state)
        second = inverse @ (source - matrix @ (state + (1.0 - gamma) * step * first))
        state = state + step * ((1.0 - gamma) * first + gamma * second)
        shown.append((state[film] - state[film + 1]) / link[film])
    return values.gain * lagged(np.array(shown), values.lag)[1::2] + values.offset


def test_data_of_another_solver_with_other_noise_are_understood():
    """Implicit differences, and noise that is Laplace's and not normal."""
    rng = np.random.default_rng(8)
    truth = Values(resistance=1.4e-3, exponent=0.35, epidermis=6e-4, perfusion=8000.0, lag=0.045, gain=1.01)
    readings = np.stack([differences(truth, "wood", force) for force in FORCES])
    own = Forward(known("wood"), TIMES)(truth)
    assert np.abs(readings - own)[:, 250:].max() < 5.0  # a mesh is coarse at first
    _, fit = fitted(
        known("wood"), truth, rng, readings=readings, draw=lambda shape: rng.laplace(size=shape) / np.sqrt(2.0)
    )
    off = [not found.low <= getattr(truth, name) <= found.high for name, found in fit.found.items()]
    assert sum(off) <= 2 and fit.misfit < 1.6


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Raw touches of wood at three forces, as `measure touch --raw` writes them."""
    folder = tmp_path_factory.mktemp("raw")
    readings = Forward(known("wood"), TIMES)(Values())
    rng = np.random.default_rng(2)
    for k, force in enumerate(FORCES):
        head = f"# what: wood\n# who: P07\n# skin [degC]: 33\n# room [degC]: 23\n# force [N]: {force}\n"
        head += "# lag [s]: 0.05\n# capacity [J/m2K]: 129\nt [s],j [W/m^2],film [degC],force [N]\n"
        noisy = readings[k] + NOISE * rng.normal(size=len(TIMES))
        rows = (f"{t:.4f},{j:.3f},23,{force}\n" for t, j in zip(TIMES.tolist(), noisy.tolist(), strict=True))
        (folder / f"touch{k}.csv").write_text(head + "".join(rows), encoding="utf-8")
    return folder


def test_the_command_stores_a_participant_and_its_heat(raw, tmp_path, capsys):
    words = [str(raw), "--sample", "wood", "--press", "0", "-o", str(tmp_path / "p.json"), "--heat",
             str(tmp_path / "p.xml"), "--profile"]  # fmt: skip
    assert estimate.main(words) == 0
    said = capsys.readouterr().out
    assert "not determined by the data" in said and "perfusion: " in said
    stored = json.loads((tmp_path / "p.json").read_text())
    assert stored["who"] == "P07" and stored["touches"] == 3
    datetime.strptime(stored["when"], "%Y-%m-%d %H:%M:%S UTC").replace(tzinfo=UTC)  # a calibration has its date
    assert stored["when"][:10] in (tmp_path / "p.xml").read_text(encoding="utf-8").splitlines()[0]
    found = stored["values"]["resistance"]
    assert found["value"] == pytest.approx(Values().resistance, rel=0.03) and found["told"]
    assert set(stored["values"]) <= set(ASSUMED)
    (tmp_path / "s.xml").write_text(
        '<itouch version="1.0"><include file="itouch:rigs/twin.xml"/><include file="p.xml"/><interaction>'
        '<probe name="finger" radius="8 mm" pose-from="arm"/></interaction></itouch>'
    )
    scene = itouch.load(str(tmp_path / "s.xml"))
    heat = next(params for params in scene.modalities if hasattr(params, "params")).params
    assert heat.layers[0].thickness == pytest.approx(stored["values"]["epidermis"]["value"])
    assert heat.law().at(1.0) == pytest.approx(found["value"], rel=1e-6)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere.csv"], "nowhere.csv"),
        (["."], "no touches in"),
        (["RAW", "--sample", "kryptonite"], "kryptonite"),
        (["RAW", "--press", "3"], "must be 0 to 1 s"),
        (["RAW", "--press", "0.5"], "16.00 s are needed"),
    ],
)
def test_wrong_input_is_one_message(words, said, raw, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert estimate.main([str(raw) if word == "RAW" else word for word in words]) == 2
    assert said in capsys.readouterr().err


def test_a_file_that_is_no_touch_is_named(raw, tmp_path, capsys):
    text = (raw / "touch0.csv").read_text(encoding="utf-8")
    for k, broken in enumerate((text.replace("# skin", "# skim"), text.replace("t [s]", "s"), text[:900])):
        (tmp_path / f"b{k}.csv").write_text(broken, encoding="utf-8")
        assert estimate.main([str(tmp_path / f"b{k}.csv")]) == 2
        assert f"b{k}.csv' is not a raw touch" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("# force [N]: 0.5", "# force [N]: 0", "force [N] is 0, out of range: 0.01 to 1000"),
        ("# force [N]: 0.5", "# force [N]: -1", "force [N] is -1, out of range"),
        ("# skin [degC]: 33", "# skin [degC]: 306.15", "skin [degC] is 306.15, out of range"),
        ("# lag [s]: 0.05", "# lag [s]: soon", "no number 'lag [s]'"),
        ("\n0.0040,", "\n0.0040\n0.0041,", "row 2 has 1 cells; a time and a flux are needed"),
        (",23,0.5\n0.0060,", ",23\n0.0060,", "row 2 has 3 cells, and the heading 4: the file was cut off"),
        ("\n0.0040,", "\n" + "9" * 200_000 + ",", "is not a raw touch: field larger"),
        ("# what: wood", "# what: \udcff", "it is not UTF-8 text"),
    ],
)
def test_a_broken_raw_file_is_one_message(old, new, said, raw, tmp_path, capsys):
    text = (raw / "touch0.csv").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "b.csv").write_text(text.replace(old, new, 1), encoding="utf-8", errors="surrogateescape")
    assert estimate.main([str(tmp_path / "b.csv")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and "b.csv" in error and said in error


def test_a_hole_in_the_readings_is_told_with_its_times(raw, tmp_path, capsys):
    lines = (raw / "touch0.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "b.csv").write_text("".join(lines[:600] + lines[900:]), encoding="utf-8")
    assert estimate.main([str(tmp_path / "b.csv")]) == 2
    assert "there is no reading from 1.184 to 1.786 s" in capsys.readouterr().err


def test_a_touch_that_is_given_twice_does_not_narrow_the_intervals(raw, tmp_path, capsys):
    (tmp_path / "again.csv").write_bytes((raw / "touch1.csv").read_bytes())
    assert estimate.main([str(raw), str(tmp_path / "again.csv")]) == 2
    assert "touch1.csv' and '" in (said := capsys.readouterr().err) and "again.csv' have the same readings" in said


def test_the_touch_that_is_too_short_is_named(raw, tmp_path, capsys):
    lines = (raw / "touch0.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "short.csv").write_text("".join(lines[:100]), encoding="utf-8")
    assert estimate.main([str(raw / "touch1.csv"), str(tmp_path / "short.csv")]) == 2
    assert "short.csv' does; 1.60 s are needed" in capsys.readouterr().err


def test_a_raw_file_may_begin_with_a_byte_order_mark(raw, tmp_path):
    (tmp_path / "b.csv").write_bytes(b"\xef\xbb\xbf" + (raw / "touch0.csv").read_bytes())
    assert load([tmp_path / "b.csv"]).what == "wood"


def test_touches_of_two_people_are_not_taken_for_one(raw, tmp_path, capsys):
    text = (raw / "touch0.csv").read_text(encoding="utf-8")
    (tmp_path / "b.csv").write_text(text.replace("# who: P07", "# who: P08"), encoding="utf-8")
    assert estimate.main([str(raw), str(tmp_path / "b.csv")]) == 2
    assert "of several people (P07, P08)" in capsys.readouterr().err


def test_without_an_exponent_the_resistance_is_that_at_the_mean_force(tmp_path):
    one = Problem(known("wood", forces=(2.0, 2.0)), TIMES, np.zeros((2, len(TIMES))), NOISE)
    assert "exponent" not in one.names and one.force == pytest.approx(2.0)
    assert one.unit("resistance") == "m2*K/W at 2 N" and one.unit("lag") == "s"
    several = Problem(known("wood"), TIMES, np.zeros((3, len(TIMES))), NOISE)
    assert several.unit("resistance") == "m2*K/W at 1 N"


def test_lag_and_resistance_of_the_film_are_those_of_its_sheet(raw, tmp_path):
    text = (raw / "touch0.csv").read_text(encoding="utf-8")
    text = text.replace("# lag [s]: 0.05", "# lag [s]: 0.2\n# film resistance [m2K/W]: 8e-05")
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    loaded = load([tmp_path / "t.csv"])
    film = loaded.known.film
    assert film.thickness / film.conductivity == pytest.approx(8e-5)
    problem = problem_of(loaded, "wood", press=0.0, noise=NOISE)
    assert problem.values(np.zeros(len(problem.names))).lag == pytest.approx(0.2)
    unknown = load([raw / "touch0.csv"]).known.film
    assert unknown.thickness / unknown.conductivity == pytest.approx(FilmParams().film_resistance)


def test_bins_hold_samples_and_grow():
    edges = edges_for(TIMES)
    assert np.all(np.diff(edges) > 0.0) and edges[0] == pytest.approx(0.049) and edges[-1] == pytest.approx(4.001)


def test_a_file_that_is_not_there_is_named_with_what_to_do(tmp_path, capsys):
    assert estimate.main([str(tmp_path / "nothing.csv")]) == 2
    said = capsys.readouterr().err
    assert "nothing.csv" in said and "check the path" in said and "Errno" not in said
