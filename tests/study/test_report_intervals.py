"""What a report says of small, equal and unequal panels: its intervals must cover what they promise."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr
from test_study import Hands, written

from itouch_tools.cli import main
from itouch_tools.study import simulate as simulation
from itouch_tools.study import statistics as stats
from itouch_tools.study.study_store import Row, Store

LEVELS = '<factor name="gain" levels="0.6 0.8 1.0 1.2 1.4" set="wood/contact.static-friction"/>'
ODD = 'kind="odd" factor="material" standard="wood"'


def row(person: int, place: int, level: str, **other: Any) -> Row:
    """Return a trial of one interval with this material."""
    block, task = other.pop("block", "main"), other.pop("task", "identify")
    condition = {"material": level}
    return Row(f"P{person}", place, block, task, condition, [condition], 0.0, 1.0, "s", "", **other)


def reported(study: Path, rows: list[Row]) -> tuple[dict[str, Any], str]:
    """Store the rows as a session does, ask for the report, and return its numbers and its page."""
    folder = study.parent / "rows"
    folder.mkdir()
    with Store.open(folder, create=True) as store:
        for one in rows:
            store.add(one)
    assert main(["study", "report", str(study), str(folder)]) == 0
    return json.loads((folder / "report.json").read_text()), (folder / "report.html").read_text()


def test_people_who_never_err_are_not_certain(tmp_path: Path) -> None:
    """Twelve people with ten right answers each: a truth of 99 % would look like this in three studies of ten."""
    rows = [row(p, t, ("wood", "steel")[t % 2], answer=("wood", "steel")[t % 2], right=1) for p in range(12)
            for t in range(10)]  # fmt: skip
    found, text = reported(written(tmp_path), rows)
    assert found["correct"]["panel_95"] == pytest.approx(stats.wilson(120, 120))
    matrix = found["identification"][0]
    assert matrix["intervals_95"][0][1] == pytest.approx(stats.wilson(0, 60))
    assert matrix["intervals_95"][0][0] == pytest.approx(stats.wilson(60, 60))
    assert found["conditions"][0]["panel_95"] == pytest.approx(stats.wilson(60, 60))
    assert "100 % right [97, 100]" in text


def test_the_interval_of_a_share_near_one_covers_it() -> None:
    rng, hits = np.random.default_rng(5), 0
    for study in range(200):
        counts = [(int(right), 10) for right in rng.binomial(10, 0.99, 12)]
        low, high = stats.share_interval(counts, seed=study, draws=400)
        hits += low <= 0.99 <= high
    assert hits >= 190
    assert stats.share_interval([(4, 5), (0, 0)], seed=1) == pytest.approx(stats.wilson(4, 5))
    assert all(math.isnan(end) for end in stats.share_interval([], seed=1))


def test_sensitivity_has_an_interval_over_people(tmp_path: Path) -> None:
    """Four people are always right and four guess: the answers of one person are no independent trials."""
    rows = [row(p, t, "steel", task="odd", answer="0", right=int(p < 4 or t % 3 == 0)) for p in range(8)
            for t in range(60)]  # fmt: skip
    found, text = reported(written(tmp_path, task=ODD), rows)
    entry = next(one for one in found["sensitivity"] if one["level"] == "steel")
    assert entry["d_prime"] == pytest.approx(stats.d_prime_of_oddity(2 / 3))
    low, high = entry["d_prime_95"]
    independent = [stats.d_prime_of_oddity(end) for end in stats.wilson(320, 480)]
    assert low < independent[0] - 0.3
    assert high > independent[1] + 0.3
    assert f"[{low:.2f}, {high:.2f}]" in text
    shown = next(one for one in found["conditions"] if one["condition"] == {"material": "steel"})
    assert f"[{100 * shown['panel_95'][0]:.0f}, {100 * shown['panel_95'][1]:.0f}]" in text


def test_an_up_down_staircase_whose_trials_run_out_has_a_threshold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twelve reversals do not come within 40 small steps from far above: of 200 people 147 had no threshold."""
    monkeypatch.setattr(simulation, "TouchRunner", Hands)
    factor = (
        '<staircase name="gain" procedure="up-down" set="wood/contact.static-friction" low="0" high="2" start="1.4" '
        'standard="0" step="0.06" trials="40"/>'
    )
    study = str(written(tmp_path, factor=factor, task='kind="colder" factor="gain" standard="0"'))
    folder = str(tmp_path / "rows")
    assert main(["study", "simulate", study, "-o", folder, "--observers", "6", "--processes", "1"]) == 0
    assert main(["study", "report", study, folder]) == 0
    found = json.loads((tmp_path / "rows" / "report.json").read_text())["staircases"][0]
    assert len(found["thresholds"]) == 6
    assert all(value is not None for value in found["thresholds"].values())
    assert found["mean"] == pytest.approx(0.52, abs=0.4)


def constant(
    folder: Path, equal: float, spread: float, levels: tuple[str, ...], each: int, seed: int
) -> tuple[Any, str]:
    rng, rows = np.random.default_rng(seed), []
    for place in range(each * len(levels)):
        level = levels[place % len(levels)]
        where = int(rng.integers(2))
        chosen = rng.random() < ndtr((float(level) - equal) / spread)
        shown = [{"gain": level if index == where else "1.0"} for index in range(2)]
        rows.append(Row("P1", place, "main", "colder", {"gain": level}, shown, 0.0, 1.0, "s", "",
                        answer=str(where if chosen else 1 - where), right=int(chosen)))  # fmt: skip
    return reported(written(folder, factor=LEVELS, task='kind="colder" factor="gain" standard="1.0"'), rows)


def test_one_person_s_equal_level_has_an_interval(tmp_path: Path) -> None:
    found, text = constant(tmp_path, 1.05, 0.2, ("0.6", "0.8", "1.2", "1.4"), 60, 3)
    low, high = found["constant"]["equal"]["people_95"]["P1"]
    assert low < found["constant"]["equal"]["people"]["P1"] < high
    assert low < 1.05 < high and 0.02 < high - low < 0.2
    assert f"[{low:.2f}, {high:.2f}]" in text


def test_an_equal_level_that_nobody_was_shown_is_not_told(tmp_path: Path) -> None:
    """All levels feel colder than the standard: where they would not is a guess."""
    found, _ = constant(tmp_path, 0.1, 0.9, ("0.6", "0.8", "1.2", "1.4"), 100, 7)
    assert found["constant"]["equal"]["people"]["P1"] is None
    assert found["constant"]["equal"]["mean"] is None
    assert found["constant"]["threshold"]["people"]["P1"] is None


def test_ratings_above_nought_have_a_geometric_mean(tmp_path: Path) -> None:
    """Magnitude estimation: one person counts to 10 and the other to 1000."""
    rows = [row(p, t, level, task="rate", answer=repr(scale * size)) for p, scale in ((1, 1.0), (2, 100.0))
            for t, (level, size) in enumerate((("wood", 2.0), ("steel", 8.0), ("wood", 2.0), ("steel", 8.0)))]  # fmt: skip
    rows += [row(1, 9, "cork", task="rate", answer="5.0", block="catch")]
    found, text = reported(
        written(tmp_path, task='kind="rate" factor="material"', more='<catch trials="1" where="material=cork"/>'), rows
    )
    by = {one["condition"]["material"]: one for one in found["ratings"]}
    assert by["wood"]["geometric_mean"] == pytest.approx(20.0)
    assert by["steel"]["geometric_mean"] == pytest.approx(80.0)
    assert by["wood"]["mean"] == pytest.approx(101.0)
    assert "geometric mean" in text
    assert "1 catch trial, in which no answer is right or wrong" in text  # none of one is not an error of somebody
