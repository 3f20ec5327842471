"""Every kind of fault in every device in every phase of a touch: no absolute limit is passed, and all is told."""

from __future__ import annotations

from collections import Counter

import pytest
from shipped import SCENES

from itouch.safety.sequence import SAFE_TIME
from itouch_evidence.faults import KINDS, PHASES, Cell, pairs, phases, prepared, single


@pytest.fixture(scope="module")
def cells() -> list[Cell]:
    session = prepared(SCENES / "four_materials_hurried.xml")
    return list(single(session, phases(session)))


def test_every_kind_in_every_device_in_every_phase(cells: list[Cell]) -> None:
    assert len(cells) == len(KINDS) * 3 * len(PHASES) == 180
    assert len({(cell.faults, cell.phase) for cell in cells}) == 180


def test_the_plant_never_passes_an_absolute_limit(cells: list[Cell]) -> None:
    assert [cell for cell in cells if cell.broken] == []


def test_what_trips_is_safe_within_the_deadline(cells: list[Cell]) -> None:
    tripped = [cell for cell in cells if cell.after is not None]
    assert len(tripped) > 80
    assert [cell for cell in tripped if not cell.safe or (cell.safe_after or 0.0) > SAFE_TIME] == []


def test_every_fault_is_in_the_report(cells: list[Cell]) -> None:
    assert [cell for cell in cells if not cell.told] == []


#: Faults that no device survives unnoticed, with the longest time [s] that this may take in any phase but the first.
AT_ONCE = {"disconnect": 0.0, "nan": 0.0, "wrong-units": 0.001, "garbage": 0.001, "spike": 0.1}


@pytest.mark.parametrize("kind", AT_ONCE)
def test_gross_faults_trip_at_once(cells: list[Cell], kind: str) -> None:
    chosen = [cell for cell in cells if cell.faults[0][1] == kind]
    assert len(chosen) == 15
    for cell in chosen:
        assert cell.trip, cell
        assert cell.after is None or cell.after <= AT_ONCE[kind] + 1e-9, cell


def test_a_step_of_a_sensor_is_noticed_wherever_the_device_is_used(cells: list[Cell]) -> None:
    biased = [cell for cell in cells if cell.faults[0][1] == "bias" and cell.phase != "closed-open"]
    assert all(cell.trip for cell in biased)


def test_faults_differ_in_how_they_are_noticed(cells: list[Cell]) -> None:
    trips = Counter(cell.trip for cell in cells)
    for trip in ("refused", "device-error", "not-a-number", "sensor-range", "sensor-jump", "tracking", "speed",
                 "sensor-frozen", "sensor-disagree", "runaway", "plate-temperature"):  # fmt: skip
        assert trips[trip] > 0, trips


@pytest.mark.long
def test_all_pairs_of_faults_in_contact() -> None:
    session = prepared(SCENES / "four_materials_hurried.xml", slots=2)
    found = list(pairs(session, "contact", phases(session)["contact"]))
    assert len(found) == 36 * 35 // 2
    assert [cell for cell in found if not cell.good] == []
