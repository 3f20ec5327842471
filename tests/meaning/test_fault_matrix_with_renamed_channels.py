"""The matrix of faults under random names of channels and fields: the same result, cell for cell."""

from __future__ import annotations

from dataclasses import replace

import pytest
from renamed import OURS, scene
from shipped import SCENES

from itouch.faults import Kind
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch_evidence.faults import Cell, differing, main, prepared, run_cell
from itouch_evidence.faults.phases import phases
from itouch_evidence.faults.truth import Truth
from itouch_evidence.renamed import RenamedCatalog

#: Cells whose supervision differs: of each device, seen by each sort of monitor.
SAMPLE = (
    ("arm", Kind.FREEZE), ("arm", Kind.SPIKE), ("table", Kind.BIAS), ("table", Kind.NAN), ("table", Kind.SATURATED),
    ("peltier", Kind.REVERSED_SIGN), ("peltier", Kind.WRONG_UNITS), ("peltier", Kind.DISCONNECT),
)  # fmt: skip


def cells(catalog: Catalog) -> list:
    session = prepared(loads(scene(OURS, hardware="").encode(), catalog), catalog=catalog)
    stored, truth = phases(session)["contact"], Truth(session)
    return [run_cell(session, truth, "contact", stored, [(device, kind, 0)]) for device, kind in SAMPLE]


def test_a_sample_of_the_matrix_is_the_same_under_other_names() -> None:
    renamed = RenamedCatalog(seed=21)
    ours, others = cells(Catalog()), cells(renamed)
    assert [differing(one, other, renamed.words) for one, other in zip(ours, others, strict=True)] == [[]] * len(SAMPLE)
    assert len({cell.trip for cell in ours}) >= 4, "the sample meets several monitors"


def test_a_cell_that_differs_is_seen() -> None:
    renamed = RenamedCatalog(seed=22)
    word = renamed.words("plate_temperature")
    one = a_cell("device 'peltier' reads plate_temperature 400 K")
    assert differing(one, replace(one, cause=f"device 'peltier' reads {word} 400 K"), renamed.words) == []
    assert differing(one, replace(one, cause=f"device 'peltier' reads {word} 401 K"), renamed.words) == ["cause"]
    assert differing(one, replace(one, trip="plate-rate"), renamed.words) == ["trip"]


def a_cell(cause: str) -> Cell:
    return Cell((("peltier", "bias"),), "contact", "sensor-range", cause, 0.0, 0.1, True, (), True)


@pytest.mark.long
@pytest.mark.parametrize("paired", [[], ["--pairs"]], ids=["every cell", "every pair"])
def test_the_whole_matrix_is_the_same_under_other_names(paired: list[str]) -> None:
    assert main([str(SCENES / "four_materials.xml"), *paired, "--renamed", "1"]) == 0
