"""Which runs a sweep has: every combination once, and more of them later without touching those that are."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeping import COLLECT, written

from itouch.plugin.discovery import Catalog
from itouch_tools.sweeps import sampling
from itouch_tools.sweeps.run_plan import Axis, Level, Plan, digest_of
from itouch_tools.sweeps.sampling import Points, value_of
from itouch_tools.sweeps.sweep_elements import Draws, Over
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.sweepfile import SweepFile

OVER = (
    Over(name="a", set_="x.a", low=1.0, high=100.0, scale="log"),
    Over(name="b", set_="x.b", values="red green blue"),
)
NORMAL = Over(name="n", set_="x.n", mean=5.0, deviation=2.0, low=4.0, high=9.0)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> SweepFile:
    return load_sweep(written(tmp_path_factory.mktemp("plan") / "here"), Catalog())


def drawn(kind: str, count: int, seed: int = 1, block: int | None = None) -> list[list[float | str]]:
    points = Points(Draws(kind=kind, count=count, over=OVER, block=block), seed)
    return [points.point(index) for index in range(count)]


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["random", "sobol"]), st.integers(1, 40), st.integers(0, 40), st.integers(0, 2**40))
def test_more_points_leave_those_that_are(kind: str, count: int, more: int, seed: int) -> None:
    assert drawn(kind, count + more, seed)[:count] == drawn(kind, count, seed)


def test_whole_latin_hypercubes_stay_and_each_has_every_stratum_once() -> None:
    assert drawn("latin", 24, block=8)[:16] == drawn("latin", 16, block=8)
    strata = sorted(int(8 * np.log(float(a)) / np.log(100.0)) for a, _ in drawn("latin", 8))
    assert strata == list(range(8))


def test_chunks_are_one_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = drawn("sobol", 64)
    monkeypatch.setattr(sampling, "CHUNK", 16)
    assert drawn("sobol", 64) == whole


def test_sobol_is_more_even_than_chance() -> None:
    counts = np.histogram([np.log(float(a)) / np.log(100.0) for a, _ in drawn("sobol", 256)], bins=64, range=(0, 1))[0]
    assert counts.min() == counts.max() == 4
    assert {b for _, b in drawn("random", 64)} == {"red", "green", "blue"}


@given(st.floats(0.0, 1.0, exclude_max=True))
def test_a_cut_normal_stays_inside_and_grows(u: float) -> None:
    value = value_of(NORMAL, u)
    assert isinstance(value, float)
    assert 4.0 - 1e-9 <= value <= 9.0 + 1e-9
    assert value_of(NORMAL, min(u + 0.1, 1.0 - 1e-9)) >= value or u > 0.89


def test_a_plan_has_every_combination_once(file: SweepFile) -> None:
    plan = file.plan("base")
    runs = [plan.run(number) for number in range(len(plan))]
    assert len(runs) == 8
    assert plan.structures == 4
    assert len({run.digest for run in runs}) == 8
    assert {(run.values["mass"], run.seed) for run in runs} == set(itertools.product((60.0, 80.0), (0, 1)))
    sets = dict(runs[0].sets)
    assert sets["operator.mass"] == "60 g"
    assert sets["wood/contact.stiffness"] == f"{runs[0].values['stiffness']:.12g} N/mm"


def test_more_of_anything_keeps_the_digests(file: SweepFile) -> None:
    plan = file.plan("base")
    known = {plan.run(number).digest for number in range(len(plan))}
    axis = plan.axes[0]
    more = Level((99.0,), (("operator.mass", "99 g"),))
    for larger in (replace(plan, seeds=5), replace(plan, axes=[Axis(axis.names, (*axis.levels, more))])):
        assert known < {larger.run(number).digest for number in range(len(larger))}


def test_a_digest_is_of_the_base_what_is_set_and_the_seed() -> None:
    sets = [("a.b", "1"), ("c.d", "2")]
    assert digest_of("x", sets, 1) == digest_of("x", sets[::-1], 1)
    assert len({digest_of("x", sets, 1), digest_of("y", sets, 1), digest_of("x", sets, 2), digest_of("x", [], 1)}) == 4


def test_lists_set_together_and_notes_set_nothing(tmp_path: Path) -> None:
    listed = """<list name="hand" levels="light heavy"><set path="operator.mass" values="60 g; 0.1 kg"/>
      <set path="operator.damping" values="4; 6"/><note name="cost" values="1 2.5"/></list>"""
    plan = load_sweep(written(tmp_path / "here", listed + COLLECT), Catalog()).plan()
    assert [dict(plan.run(n).values) for n in range(2)] == [
        {"hand": "light", "cost": 1.0},
        {"hand": "heavy", "cost": 2.5},
    ]
    assert dict(plan.run(1).sets) == {"operator.mass": "0.1 kg", "operator.damping": "6"}


def test_a_study_gives_its_conditions(tmp_path: Path) -> None:
    from shipped import SCENES

    path = tmp_path / "s.xml"
    study = SCENES / "studies" / "four_materials.xml"
    path.write_text(
        f'<sweep version="1.0" study="{study}"><collect><report name="n" key="seed"/></collect></sweep>',
        encoding="utf-8",
    )
    plan: Plan = load_sweep(path, Catalog()).plan()
    assert [plan.run(n).values["material"] for n in range(len(plan))] == ["aluminium", "pyrex", "wood", "polystyrene"]
    assert dict(plan.run(1).sets) == {"sample.material": "pyrex"}
