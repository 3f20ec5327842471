"""Power, campaigns, the logistic model and exports of a study."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from run_scene import write_study
from scipy import linalg, special

from itouch.plugin import Field, Modality, Role
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch_tools.cli import main
from itouch_tools.study import statistics as s
from itouch_tools.study.coverage import coverage, difference_errors, equivalence_errors, regression_errors
from itouch_tools.study.exports import write_bids, write_parquet
from itouch_tools.study.observers import Felt
from itouch_tools.study.power import FINGERS, TOUCHES, PowerError, library, power
from itouch_tools.study.reading import StudyFile, load_study
from itouch_tools.study.statistics.regression import _spread
from itouch_tools.study.study_page import _chance
from itouch_tools.study.study_store import Row, Store
from itouch_tools.study.touches import Presented, TouchError, felt_by, figures
from itouch_tools.study.trial_table import table_of

CATALOG = Catalog()
ROWS = [
    Row("P-01", 0, "main", "identify", {"material": "wood"}, [{"material": "wood"}], 1.0, 2.0, "P-01-1", "now",
        answer="cork", right=0, reaction_s=0.75, felt=[{"mean_flux_W_m2": 830.5, "plate_ready": True}]),
    Row("P-01", 1, "main", "identify", {"material": "cork"}, [{"material": "cork"}], 3.0, 4.0, "P-01-1", "now",
        void="released\tearly", felt=[{"mean_flux_W_m2": None}]),
    Row("P2", 0, "practice", "identify", {"material": "wood"}, [{"material": "wood"}], 1.0, 2.0, "P2-1", "now",
        answer="wood", right=1, reaction_s=0.5, felt=[{"mean_flux_W_m2": 800.0, "plate_ready": False, "wobble": 2.0}]),
]  # fmt: skip


def test_the_logistic_model_against_one_written_here() -> None:
    """Against Newton's method and the sandwich of Kauermann and Carroll, by matrices, for independent trials."""
    rng = np.random.default_rng(7)
    people, each = 12, 1  # one trial a person: exchangeable correlation is none
    codes = [f"P{n}" for n in range(people * 4) for _ in range(each)]
    source = ["a", "b"] * (len(codes) // 2)
    right = (rng.random(len(codes)) < np.where(np.array(source) == "a", 0.4, 0.7)).astype(int)
    found = s.logistic_gee(right.tolist(), {"source": source}, codes)
    x = np.column_stack([np.ones(len(codes)), np.array(source) == "b"]).astype(float)
    beta = np.zeros(2)
    for _ in range(30):
        mu = 1.0 / (1.0 + np.exp(-x @ beta))
        bread = np.linalg.inv(x.T @ (x * (mu * (1 - mu))[:, None]))
        beta += bread @ x.T @ (right - mu)
    leverage = np.einsum("ij,jk,ik->i", x, bread, x) * mu * (1 - mu)
    score = x * ((right - mu) / np.sqrt(1.0 - leverage))[:, None]
    errors = np.sqrt(np.diag(bread @ score.T @ score @ bread))
    assert [term.name for term in found] == ["intercept", "source=b"]
    assert [term.estimate for term in found] == pytest.approx(beta, abs=1e-6)
    assert [term.error for term in found] == pytest.approx(errors, rel=1e-4)
    assert found[1].low < found[1].estimate < found[1].high
    backwards = s.logistic_gee(right.tolist(), {"source": source}, codes, levels={"source": ("b", "a")})
    assert backwards[1].estimate == pytest.approx(-found[1].estimate)


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0])
def test_errors_of_correlated_trials_against_whole_matrices(power: float) -> None:
    """Leverage taken out by matrices of trials, as the papers write it; its ends are what statsmodels offers."""
    rng = np.random.default_rng(11)
    sizes = [3, 8, 5, 12, 7, 9, 4, 6, 10]  # unequal panels, shuffled: nothing hangs on a balanced table
    people = np.repeat(np.arange(len(sizes)), sizes)
    own = rng.normal(0.4, 1.2, len(sizes))[people]
    table = np.column_stack([np.ones(len(people)), rng.integers(0, 2, len(people)), people % 2]).astype(float)
    right = (rng.random(len(people)) < special.expit(own + 0.5 * table[:, 1])).astype(float)
    sm = pytest.importorskip("statsmodels.api")  # takes as long to load as all else here
    model = sm.GEE(right, table, groups=people, family=sm.families.Binomial(), cov_struct=sm.cov_struct.Exchangeable())
    fit = model.fit(maxiter=200)
    likeness = float(model.cov_struct.dep_params)
    assert abs(likeness) > 0.02
    mixed = rng.permutation(len(people))
    found = _spread(right[mixed], table[mixed], people[mixed], np.asarray(fit.params), likeness, power)

    shares = np.asarray(fit.fittedvalues)
    parts = []
    for person, size in enumerate(sizes):
        one = people == person
        spread = np.sqrt(shares[one] * (1.0 - shares[one]))
        within = np.outer(spread, spread) * (likeness + (1.0 - likeness) * np.eye(size))
        parts.append((table[one] * (spread**2)[:, None], np.linalg.inv(within), (right - shares)[one]))
    bread = np.linalg.inv(sum(d.T @ v @ d for d, v, _ in parts))
    scores = [
        d.T @ v @ linalg.fractional_matrix_power(np.eye(len(r)) - d @ bread @ d.T @ v, -power) @ r for d, v, r in parts
    ]
    wanted = bread @ sum(np.outer(score, score) for score in scores) @ bread
    assert found == pytest.approx(np.real(wanted), rel=1e-9, abs=1e-12)
    if power != 0.5:
        theirs = model.fit(cov_type="robust" if power == 0.0 else "bias_reduced", maxiter=200)
        assert np.sqrt(np.diag(found)) == pytest.approx(np.asarray(theirs.bse), rel=1e-4)


@pytest.mark.parametrize(
    ("right", "source", "codes"),
    [([], [], []), ([1], ["a"], ["P1"]), ([1, 0] * 4, ["a", "b"] * 4, ["P1"] * 8),
     ([1] * 12, ["a", "b"] * 6, [f"P{n}" for n in range(12)])],
)  # fmt: skip
def test_a_model_that_is_not_defined_is_an_answer(right: list[int], source: list[str], codes: list[str]) -> None:
    found = s.logistic_gee(right, {"source": source}, codes)
    assert found[0].name == "intercept"
    assert all(math.isnan(term.p) for term in found)


def test_a_short_campaign_keeps_its_promises() -> None:
    assert coverage(120, 16, draws=400).kept
    assert equivalence_errors(300, 16).kept
    assert difference_errors(300, 40).kept
    assert regression_errors(60, 16).high > 0.04


def test_intervals_that_are_too_narrow_fail_the_campaign(monkeypatch: pytest.MonkeyPatch) -> None:
    def narrow(panel: list[float], statistic: object, *, seed: int, draws: int) -> tuple[float, float]:
        mean, error = float(np.mean(panel)), float(np.std(panel)) / math.sqrt(len(panel))
        return mean - 1.2 * error, mean + 1.2 * error

    monkeypatch.setattr(s, "participant_interval", narrow)
    assert not coverage(120, 16).kept


def test_the_campaign_is_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    main(["study", "coverage", "--studies", "20", "--null", "40"])
    out = capsys.readouterr().out
    assert out.count("participants") == 11
    assert main(["study", "coverage", "--studies", "1"]) == 2


class Hands:
    """Touches without a scene: flux by the material, and by the source for one of them."""

    FLUX = {"wood": 1500.0, "steel": 2200.0, "cork": 900.0}

    def __init__(self, kelvin: float, gain: float) -> None:
        self.gain, self.skin = gain, kelvin

    def touch(self, condition: dict[str, str], seed: int) -> Presented:
        apart = self.gain if condition.get("source") == "rendered" else 1.0
        flux = np.full(100, 1500.0 * (self.FLUX[condition["material"]] / 1500.0) ** apart * (self.skin - 290.0) / 12.0)
        skin = np.full(100, self.skin)
        return Presented(Felt(flux, skin, skin, 0.01), {}, "")


def crossed(folder: Path) -> StudyFile:
    path = write_study(folder)
    more = '<factor name="source" levels="real rendered" values="0.4;0.5" set="wood/contact.static-friction"/>'
    path.write_text(path.read_text().replace("  <task", f"  {more}\n  <task"))
    return load_study(path, CATALOG)


def test_the_touches_of_a_power_analysis_are_told_as_they_are_made(tmp_path: Path) -> None:
    file, told = crossed(tmp_path), list[tuple[float, str]]()
    library(file, lambda kelvin: Hands(kelvin, 1.0), told=lambda share, words: told.append((share, words)))
    many = len(file.conditions())
    assert [share for share, _ in told] == pytest.approx(np.arange(1, 3 * many + 1) / (3 * many))
    assert told[many][1] == f"condition 1 of {many} with finger 2 of 3"


def test_power_grows_with_the_panel_and_falls_with_the_difference(tmp_path: Path) -> None:
    file = crossed(tmp_path)
    found = {}
    for gain in (1.0, 0.3):
        felt = library(file, lambda kelvin, gain=gain: Hands(kelvin, gain))  # type: ignore[misc]
        assert len(felt) == len(FINGERS)
        assert all(len(each) == TOUCHES for each in felt[0].values())
        found[gain] = power(file, felt, (4, 12, 40), repetitions=(6,), pool=40, studies=40)
        assert found[gain] == power(file, felt, (4, 12, 40), repetitions=(6,), pool=40, studies=40)
    name = "source: real, rendered"
    same, other = ([one.equivalence[name] for one in found[gain]] for gain in (1.0, 0.3))
    assert same[0] < same[1] < same[2]
    assert other[2] < 0.2 < 0.6 < same[2]
    widths = [one.half_width for one in found[1.0]]
    assert widths[0] > widths[1] > widths[2]
    assert widths[0] / widths[2] == pytest.approx(math.sqrt(10) * 3.18 / 2.02, rel=0.25)  # Student's, and root of n


@pytest.mark.parametrize(("kind", "right"), [("colder", (0.74, 0.86)), ("odd", (0.42, 0.62))])
def test_power_of_comparisons_counts_right_answers(tmp_path: Path, kind: str, right: tuple[float, float]) -> None:
    """Of two intervals Phi(ln(ratio) / (0.375 sqrt 2)), 2 % at random: 79 %; the standard by itself does not count."""
    path = write_study(tmp_path)
    task = f'kind="{kind}" factor="material" standard="wood"'
    path.write_text(path.read_text().replace('kind="identify" factor="material"', task))
    file = load_study(path, CATALOG)
    felt = library(file, lambda kelvin: Hands(kelvin, 1.0))
    (found,) = power(file, felt, (12,), repetitions=(20,), pool=60, studies=20)
    assert right[0] < found.proportion < right[1]
    assert 0.0 < found.half_width < 0.2


def test_power_of_a_study_whose_standard_is_not_a_condition(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    more = '<factor name="source" levels="real rendered" values="0.4;0.5" set="wood/contact.static-friction"/>'
    text = path.read_text().replace("  <task", f"  {more}\n  <task").replace(
        'kind="identify" factor="material"/>', 'kind="colder" factor="material" standard="wood"/>'
        '<exclude where="material=wood source=rendered"/><exclude where="material=steel source=real"/>'
        '<exclude where="material=cork source=real"/>')  # fmt: skip
    path.write_text(text)
    file = load_study(path, CATALOG)
    (found,) = power(file, library(file, lambda kelvin: Hands(kelvin, 1.0)), (4,), repetitions=(2,), pool=8, studies=4)
    assert found.proportion > 0.5
    assert not found.equivalence  # all that is judged is rendered: there is no pair


def test_power_of_a_standard_alone_is_refused(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    path.write_text(
        path.read_text().replace('kind="identify" factor="material"', 'kind="odd" factor="material" standard="wood"')
        .replace('levels="wood steel cork"', 'levels="wood"')
    )  # fmt: skip
    with pytest.raises(PowerError, match="standard alone, wood"):
        library(load_study(path, CATALOG), lambda kelvin: Hands(kelvin, 1.0))


def test_power_of_what_has_no_right_answer_is_refused(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    path.write_text(path.read_text().replace('kind="identify"', 'kind="rate"'))
    with pytest.raises(PowerError, match="right answers"):
        power(load_study(path, CATALOG), [], (8,))


@pytest.mark.parametrize("panel", ["x", "0..4", "9..8", "8..", "1,,2"])
def test_panel_sizes_are_checked(panel: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["study", "power", str(write_study(tmp_path)), "--panel", panel])
    assert stopped.value.code == 2
    assert panel in capsys.readouterr().err


def test_parquet_holds_numbers_as_numbers(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    write_parquet(ROWS, tmp_path / "trials.parquet")
    table = pq.read_table(tmp_path / "trials.parquet").to_pydict()
    assert table["place"] == [0, 1, 0]
    assert table["mean_flux_W_m2_1"] == [830.5, None, 800.0]
    assert table["right"] == [0, None, 1]
    assert table["void"] == [None, "released\tearly", None]
    assert [path.name for path in tmp_path.iterdir()] == ["trials.parquet"]


def installed() -> list[type[Modality]]:
    names = [(plugin, local) for plugin in CATALOG.plugin_names for local in CATALOG.modality_names(plugin)]
    found = (CATALOG.modality(*name) for name in names)
    return [modality for modality in found if modality is not None]


def test_bids_tables_describe_every_column(tmp_path: Path) -> None:
    write_bids(ROWS, tmp_path, name="four materials")
    assert json.loads((tmp_path / "dataset_description.json").read_text())["BIDSVersion"]
    people = (tmp_path / "participants.tsv").read_text().splitlines()
    assert people == ["participant_id", "sub-P01", "sub-P2"]
    for subject in ("P01", "P2"):
        stem = tmp_path / f"sub-{subject}" / "beh" / f"sub-{subject}_task-fourmaterials_beh"
        sidecar = json.loads(stem.with_suffix(".json").read_text())
        with stem.with_suffix(".tsv").open() as stream:
            rows = list(csv.DictReader(stream, delimiter="\t"))
        assert rows
        assert set(rows[0]) == set(sidecar) - {"TaskName"}
        assert all(each["Description"] for name, each in sidecar.items() if name != "TaskName")
    assert sidecar["mean_flux_W_m2_1"]["Units"] == "W/m^2"
    assert "material" in sidecar
    with pytest.raises(ItouchError, match="same BIDS label"):
        write_bids([*ROWS, ROWS[0].__class__("P2-", *[getattr(ROWS[0], n) for n in ROWS[0].__slots__[1:]])], tmp_path, name="x")  # fmt: skip


@pytest.mark.parametrize(("name", "label"), [("touch " * 60, ("touch" * 60)[:64]), ("木", "study")])
def test_a_study_of_any_name_becomes_bids_files(tmp_path: Path, name: str, label: str) -> None:
    """A name of 300 characters was more than a file's name may have, and nothing but the first tables was written."""
    write_bids(ROWS, tmp_path, name=name)
    assert (tmp_path / "sub-P2" / "beh" / f"sub-P2_task-{label}_beh.tsv").exists()
    assert json.loads((tmp_path / "dataset_description.json").read_text(encoding="utf-8"))["Name"] == name


def test_a_study_is_exported_by_a_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Store.open(tmp_path, create=True) as store:
        for row in ROWS:
            store.add(row)
    assert (
        main(["study", "export", str(tmp_path), "--tsv", str(tmp_path / "t.tsv"), "--bids", str(tmp_path / "b")]) == 0
    )
    assert (tmp_path / "b" / "sub-P01").is_dir()
    assert len((tmp_path / "t.tsv").read_text().splitlines()) == 4
    assert main(["study", "export", str(tmp_path)]) == 2
    assert main(["study", "export", str(tmp_path / "none"), "--tsv", "x.tsv"]) == 2
    assert "holds no study" in capsys.readouterr().err
    assert table_of(ROWS)[1]["answer"] == "n/a"


def test_a_full_disk_leaves_the_earlier_export_and_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The earlier table was empty afterwards, and it was said that 'None' could not be written."""

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path, data = write_study(tmp_path), tmp_path / "data"
    data.mkdir()
    with Store.open(data, create=True) as store:
        store.add(ROWS[0])
    targets = {"--tsv": tmp_path / "t.tsv", "--parquet": tmp_path / "t.parquet", "-o": tmp_path / "page.html"}
    monkeypatch.setattr(os, "fsync", full)
    for option, target in targets.items():
        target.write_text("earlier")
        words = ["export", str(data)] if option != "-o" else ["report", str(path), str(data)]
        assert main(["study", *words, option, str(target)]) == 2
        assert f"cannot write '{target}': No space left on device" in capsys.readouterr().err
        assert target.read_text() == "earlier"
    assert not list(tmp_path.glob(".itouch-*"))


def test_a_tiny_probability_is_told_as_a_bound() -> None:
    assert [_chance(p) for p in (None, 0.0, 4.9e-5, 6e-5, 0.05)] == ["-", "< 0.0001", "< 0.0001", "0.0001", "0.0500"]


def test_codes_and_answers_stay_words_in_parquet(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    rows = [Row("007", 0, "main", "identify", {"size": "01"}, [{"size": "01"}], 0.0, 1.0, "007-1", "now",
                answer="1_0", right=0, reaction_s=0.5, felt=[{"mean_flux_W_m2": 830.5}])]  # fmt: skip
    write_parquet(rows, tmp_path / "t.parquet")
    row = pq.read_table(tmp_path / "t.parquet").to_pylist()[0]
    assert (row["participant"], row["answer"], row["size"], row["session"]) == ("007", "1_0", "01", "007-1")
    assert (row["place"], row["right"], row["reaction_s"]) == (0, 0, 0.5)


def test_a_figure_that_nobody_felt_is_what_the_report_tells_of_it() -> None:
    nothing, skin = np.zeros(0), np.array([305.15, 304.65])
    told = {Role.HEAT_FLUX: 812.5, Role.SKIN_TEMPERATURE: 0.25}
    measured = figures(
        Presented(Felt(np.array([400.0, 600.0]), skin, skin, 0.01), {"peak_force_N": 1.0}, "", told=told)
    )
    assert (measured["mean_flux_W_m2"], measured["skin_drop_K"]) == (500.0, 0.5)
    reported = figures(Presented(Felt(nothing, nothing, nothing, 0.01), {"peak_force_N": 1.0}, "", told=told))
    assert (reported["mean_flux_W_m2"], reported["skin_drop_K"]) == (812.5, 0.25)
    assert figures(Presented(Felt(nothing, nothing, nothing, 0.01), {}, ""))["mean_flux_W_m2"] == 0.0  # nothing touched


def test_an_observer_feels_what_twins_say_and_nothing_of_hardware() -> None:
    fields = (Field("flux", role=Role.HEAT_FLUX), Field("skin", role=Role.SKIN_TEMPERATURE))
    twin = SimpleNamespace(twin=True, make_twin=lambda: SimpleNamespace(fields=lambda: fields))
    arm = SimpleNamespace(twin=True, make_twin=lambda: SimpleNamespace(fields=lambda: ()))
    assert felt_by(SimpleNamespace(devices={"arm": arm, "pad": twin})) == ("pad.twin.flux", "pad.twin.skin")
    with pytest.raises(TouchError, match="none declares a true flux and a true skin"):
        felt_by(SimpleNamespace(devices={"arm": arm}))
    twin.twin = False
    with pytest.raises(TouchError, match="'pad' is not a twin"):
        felt_by(SimpleNamespace(devices={"arm": arm, "pad": twin}))


@pytest.mark.parametrize("people", [8, 16])
def test_what_is_promised_of_a_share_is_a_share(people: int) -> None:
    """Of a few participants no coverage is promised, and any would do."""
    low, high = coverage(1, people, draws=10).promised
    assert 0.0 <= low < high <= 1.0
    assert (high - low < 1.0) == (people == 16)


def test_a_factor_called_as_a_column_of_every_trial_hides_no_answer(tmp_path: Path) -> None:
    """A factor ``answer`` had a second column of this name, which the exports took for the first."""
    pq = pytest.importorskip("pyarrow.parquet")
    shown = [{"answer": "warm"}, {"answer": "cold"}]
    rows = [Row("P1", 0, "main", "colder", {"answer": "cold"}, shown, 0.0, 1.0, "P1-1", "now", answer="1", right=1)]
    write_parquet(rows, tmp_path / "t.parquet")
    row = pq.read_table(tmp_path / "t.parquet").to_pylist()[0]
    assert (row["answer"], row["factor_answer"]) == ("1", "cold")
    write_bids(rows, tmp_path / "bids", name="x")
    (path,) = (tmp_path / "bids").rglob("*_beh.tsv")
    with path.open() as stream:
        (told,) = csv.DictReader(stream, delimiter="\t")
    assert (told["answer"], told["factor_answer"]) == ("1", "cold")
    assert len(path.read_text().splitlines()[0].split("\t")) == len(told)


def test_tables_tell_what_each_interval_showed(tmp_path: Path) -> None:
    """Otherwise nobody can tell from them which of two was judged colder."""
    both = {"source": "real"}
    shown = [{**both, "material": "wood"}, {**both, "material": "cork"}]
    rows = [
        Row("P1", 0, "main", "colder", {**both, "material": "cork"}, shown, 0.0, 1.0, "P1-1", "now", answer="1"),
        Row("P1", 1, "main", "colder", {}, [{"k": "0.3"}, {"k": "0.5"}], 0.0, 1.0, "P1-1", "now", staircase="k"),
    ]
    first, second = table_of(rows)
    assert (first["material_1"], first["material_2"], first["source"]) == ("wood", "cork", "real")
    assert (second["material_1"], second["k_1"], second["k_2"]) == ("n/a", "0.3", "0.5")
    assert "source_1" not in first  # it is the same in both
    write_bids(rows, tmp_path, name="x")
    (path,) = tmp_path.rglob("*_beh.json")
    assert json.loads(path.read_text())["material_2"]["Description"] == "level of material that interval 2 showed"


def test_an_export_touches_no_other_file(tmp_path: Path) -> None:
    """Parquet and BIDS were made by way of a file trials.tsv in the same folder, whosever it was."""
    pytest.importorskip("pyarrow.parquet")
    (tmp_path / "data").mkdir()
    with Store.open(tmp_path / "data", create=True) as store:
        for row in ROWS:
            store.add(row)
    table = tmp_path / "trials.tsv"
    words = ["study", "export", str(tmp_path / "data"), "--parquet", str(tmp_path / "trials.parquet")]
    assert main([*words, "--tsv", str(table)]) == 0
    assert len(table.read_text().splitlines()) == 4
    table.write_text("somebody's own")
    assert main(words) == 0
    assert table.read_text() == "somebody's own"
