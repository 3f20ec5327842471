"""Numbers of the shipped sweeps' pages, out of rows whose answer is known."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from types import FunctionType
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from itouch.schema import ItouchError
from itouch_tools.cli import main
from itouch_tools.sweeps import pages
from itouch_tools.sweeps.figures import bits, confusion, proportion
from itouch_tools.sweeps.pages import maker, names

choose, identify, safety, tuning, people = (
    maker(name)
    for name in ("choose-a-display", "identify-materials", "safety-by-number", "one-tuning", "how-many-people")
)


@given(st.integers(1, 400), st.floats(0.0, 1.0))
def test_an_interval_of_a_proportion_is_that_of_clopper_and_pearson(of: int, share: float) -> None:
    count = round(of * share)
    low, high = proportion(count, of)
    assert low <= count / of <= high
    if 0 < count < of:
        assert binom.sf(count - 1, of, low) == pytest.approx(0.025)
        assert binom.cdf(count, of, high) == pytest.approx(0.025)
    if count == 0:
        assert high == pytest.approx(1.0 - 0.05 ** (1.0 / of))


def test_the_number_of_safe_rigs_says_what_it_proves() -> None:
    row = {"truth_passed": 0.0, "trip": "plate-high", "truth_low_K": 288.15, "truth_high_K": 313.15,
           "truth_plate_force_N": 2.0, "digest": "abc"}  # fmt: skip
    lines, _ = safety([dict(row) for _ in range(99)] + [{**row, "truth_passed": None}])
    assert "99 rigs with two faults each, 1 without a verdict" in lines[0]
    assert "passed in 0: with 95 % confidence in less than 2.98 %" in lines[0]
    lines, _ = safety([row, {**row, "truth_passed": 1.0, "digest": "def"}])
    assert "- WRONG: `def`" in lines


def touches(spread: float) -> list[dict[str, object]]:
    rng = np.random.default_rng(1)
    return [
        {"status": "done", "material": name, "cue_flux": place + spread * rng.standard_normal(),
         "cue_fall": place + spread * rng.standard_normal(), "cue_receptors": spread * rng.standard_normal()}
        for name, place in (("a", 0.0), ("b", 3.0), ("c", 9.0)) for _ in range(30)
    ]  # fmt: skip


def test_what_is_far_apart_is_told_apart_and_a_person_less_so() -> None:
    lines, _ = identify(touches(0.01))
    assert (
        "ideal observer, noise of skin and contact only: 100.0 % right (chance 33.3 %), 1.58 of 1.58 bits" in lines[1]
    )
    lines, _ = identify(touches(4.0))
    ideal, human = (float(line.split(": ")[1].split(" %")[0]) for line in lines[1:3])
    assert 35.0 < ideal < 95.0
    assert human <= ideal + 5.0


def test_a_classifier_does_not_recognize_a_touch_by_itself() -> None:
    features = np.random.default_rng(2).standard_normal((400, 1))
    labels = np.arange(400) % 200
    matrix = confusion(features, labels, 200, 0.0)
    assert matrix.sum() == 400
    assert np.trace(matrix) < 20  # by chance two of four hundred


def test_bits_of_known_tables() -> None:
    assert bits(np.eye(8)) == pytest.approx(3.0)
    assert bits(np.ones((4, 4))) == pytest.approx(0.0, abs=1e-12)
    assert bits(np.array([[0.9, 0.1], [0.1, 0.9]])) == pytest.approx(1.0 + 0.9 * math.log2(0.9) + 0.1 * math.log2(0.1))


def test_tuning_counts_errors_and_names_the_worst() -> None:
    rows = [{"status": "done", "error": 0.01 + 0.001 * n, "ready": 1.0, "limited": 0.0, "digest": f"{n:012d}", "material":
             "wood", "skin": 30.0, "resistance": 2e-3} for n in range(40)]  # fmt: skip
    lines, _ = tuning([*rows, {"status": "fault", "error": None}])
    assert lines[0] == "41 runs, 40 with a touch and its error."
    assert "more than 3 % in 19 of 40: 47.50 %" in lines[1]
    assert "`000000000039` | 4.90 %" in "".join(lines)


def test_what_is_beaten_in_everything_is_not_on_the_front(tmp_path: Path) -> None:
    rows = [
        {"status": "done", "module": module, "delay": 5.0, "sensor": "fast", "material": material, "cost": cost,
         "ohm": 1.0, "current": current, "realism_correct": correct + 0.001 * seed}
        for module, cost, current, correct in (("good", 1.0, 1.0, 0.55), ("bad", 2.0, 2.0, 0.6), ("best", 3.0, 2.0, 0.5))
        for material in ("foam", "wood") for seed in range(3)
    ]  # fmt: skip
    lines, draw = choose(rows)
    table = {line.split(" | ")[0].strip("| "): line for line in lines if " | 5 | " in line}
    assert "front" in table["good"]
    assert "front" in table["best"]
    assert "front" not in table["bad"]
    assert "55.1 ± 0.1 %" in table["good"]
    assert pages._drawn(draw, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_more_people_make_narrower_intervals_and_more_power(monkeypatch: pytest.MonkeyPatch) -> None:
    module = cast("FunctionType", people).__globals__
    monkeypatch.setitem(module, "power", partial(module["power"], pool=24, studies=24))
    flux = {"aluminium": 3700.0, "pyrex": 3100.0, "wood": 1900.0, "pmma": 2300.0, "polystyrene": 430.0}
    rows = [
        {"status": "done", "material": material, "source": source, "finger": finger, "felt_flux": own * (finger / 30.0)}
        for material, own in flux.items() for source in ("real", "rendered") for finger in (25.7, 28.5, 31.3)
    ]  # fmt: skip
    lines, draw = people([*rows, {**rows[0], "status": "crashed", "felt_flux": None}])
    assert lines[0].startswith("'real and rendered', 30 touches")
    cells = [line.split(" | ") for line in lines if line.startswith(("| 8 ", "| 40 "))]
    widths = {(row[0].strip("| "), row[1]): float(row[3].split()[1]) for row in cells}
    assert widths["8", "10"] > 1.5 * widths["40", "10"]
    powers = {(row[0].strip("| "), row[1]): float(row[4].split()[0]) for row in cells}
    assert powers["40", "20"] >= powers["8", "5"]  # both sources are the same here
    assert powers["40", "20"] > 95.0
    with pytest.raises(ValueError, match="no shipped study has these conditions"):
        people([{**row, "source": "dreamt"} for row in rows])


def test_the_shipped_pages_are_those_of_the_shipped_sweeps() -> None:
    assert names() == ["choose-a-display", "how-many-people", "identify-materials", "one-tuning", "safety-by-number"]
    with pytest.raises(ItouchError, match="did you mean 'one-tuning'"):
        maker("one-tunin")


def test_a_stranger_makes_a_page_of_words_that_nobody_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.py").write_text(
        "def wobble(rows):\n    return [f\"{sum(r['frob'] for r in rows):g} frobs\"], lambda axes: axes.plot([1, 2])\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pages, "rows", lambda folder: [{"digest": "b", "frob": 2.0}, {"digest": "a", "frob": 3.0}])
    monkeypatch.setattr(pages, "table", lambda folder: type("Table", (), {"num_rows": 2}))
    assert main(["sweep", "page", "mine.py:wobble", ".", "-o", "out"]) == 0
    assert (tmp_path / "out" / "mine.py-wobble.md").read_text().startswith("5 frobs")
    assert (tmp_path / "out" / "mine.py-wobble.png").read_bytes().startswith(b"\x89PNG")
    assert main(["sweep", "page", "mine.py:wibble", "."]) == 2
