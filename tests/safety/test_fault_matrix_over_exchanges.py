"""The matrix of faults through the entrance that hardware uses: devices behind exchanges, in step and in threads."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import campaign
import pytest
from exchange_phases import Phases, wired, wired_phases
from punctuality import skip_unless_punctual
from shipped import SCENES

from itouch.faults import Kind
from itouch_evidence.faults import KINDS, behind_wires
from itouch_evidence.faults.behind_wires import Pair, cells, run, stored

#: The whole matrix has 180 cells; the short form takes one in 30, of every device and every phase.
EVERY = 31


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Pair, Phases]]:
    """Return a host and its world, with the display exchanged with every 20 ms, in step."""
    pair = wired()
    yield pair, wired_phases(tmp_path_factory)
    pair.close()


def test_no_fault_passes_an_absolute_limit_through_exchanges(
    found: tuple[Pair, Phases],
) -> None:
    pair, phases = found
    every = EVERY if not campaign.FULL else 1
    done = list(cells(pair, phases, every=every))
    assert len(done) == -(-180 // every)
    assert [cell for cell in done if not cell.good] == []
    pair.adopt(phases["contact"])
    pair.enable()
    pair.checks, pair.watched = 0, 0.0
    pair.host.run(2.0)
    assert pair.checks / pair.watched > 90.0  # on a clock of its own, whatever the exchanges do
    campaign.tell(f"{len(done)} cells at 20 ms in step, {pair.checks / pair.watched:.0f} checks of heat a second")


def test_a_device_behind_a_wire_is_verified_though_it_answers_in_few_ticks(
    found: tuple[Pair, Phases],
) -> None:
    """The arm fails; table and display, whose readings hardly ever come in one tick, are seen to be safe."""
    pair, phases = found
    cell = run(pair, "contact", phases["contact"], [("arm", Kind.NAN, 0)])
    (fault,) = pair.host.report()["faults"]
    assert cell.good and fault["trip"] == "not-a-number"
    seen = fault["safe"]["devices"]
    assert seen["table"].startswith("retracted") and seen["peltier"].startswith("current off")


def test_a_display_that_is_lost_is_said_not_to_be_verified_and_makes_itself_safe(
    found: tuple[Pair, Phases],
) -> None:
    pair, phases = found
    cell = run(pair, "contact", phases["contact"], [("peltier", Kind.DISCONNECT, 0)])
    (fault,) = pair.host.report()["faults"]
    assert cell.good and fault["trip"] == "device-error"
    assert not fault["safe"]["reached"]
    assert fault["safe"]["devices"]["peltier"].startswith("can't be verified")


def test_a_surface_whose_place_is_not_believed_retracts_all_the_same(
    found: tuple[Pair, Phases],
) -> None:
    """Jumps of its sensor were once taken for a plate that comes nearer: it was held where it was."""
    pair, phases = found
    cell = run(pair, "idle", phases["idle"], [("table", Kind.SPIKE, 0)])
    (fault,) = pair.host.report()["faults"]
    assert cell.good and fault["trip"] == "sensor-jump"
    assert pair.truly_safe(fault["time_s"])


#: How a table may lie about its place.
LIES = (Kind.NAN, Kind.SPIKE, Kind.WRONG_UNITS, Kind.GARBAGE)


@pytest.mark.parametrize("lies", LIES, ids=[kind.label for kind in LIES])
def test_a_table_that_is_reversed_and_lies_about_its_place_lets_go_of_the_finger(
    found: tuple[Pair, Phases], lies: Kind
) -> None:
    """It rose to the end of its travel: nobody knows the way of what nobody believes, but the finger that it pushes."""
    pair, phases = found
    cell = run(pair, "contact", phases["contact"], [("table", lies, 0), ("table", Kind.REVERSED_SIGN, 1)])
    (fault,) = [entry for entry in pair.host.report()["faults"] if entry["trip"] is not None]
    assert cell.good
    assert "it pushed as it was told to go back" in fault["safe"]["devices"]["table"]
    assert pair.truth.plate_force < 4.0


def test_a_fault_that_is_there_when_all_is_stopped_lasts_until_the_stop_is_over(
    found: tuple[Pair, Phases], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The drive of a table that was withdrawn backwards was mended in the middle, and it came up as it was told to."""
    pair, phases = found
    both = [("table", Kind.SPIKE, 0), ("table", Kind.REVERSED_SIGN, 1)]
    after = run(pair, "contact", phases["contact"], both).after
    assert after is not None
    monkeypatch.setattr(behind_wires, "LASTS", after + 0.3)
    assert run(pair, "contact", phases["contact"], both).good
    assert all((runner.gate.twin_state["fault.end"] > pair.world.ticks).all() for runner in pair.world.runners)


@pytest.mark.parametrize(("table", "display"), campaign.some([(13, 29), (7, 29), (13, 7), (29, 13)], 1))
def test_devices_with_odd_periods_of_their_own_let_go_of_the_finger(
    found: tuple[Pair, Phases], table: int, display: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Table and display are exchanged with at periods [ms] that have nothing in common."""
    monkeypatch.setattr(behind_wires, "_SURFACE_TICKS", table)
    pair = Pair(SCENES / "four_materials.xml", display, threads=False, slots=2)
    state = found[1]["contact"]
    lies = LIES if campaign.FULL else (Kind.NAN, Kind.GARBAGE)
    plans = [[("table", lie, 0), *more] for lie in lies for more in ((), (("table", Kind.REVERSED_SIGN, 1),))]
    devices = product(("arm", "table", "peltier"), KINDS) if campaign.FULL else [("table", Kind.REVERSED_SIGN)]
    plans += [[(device, kind, 0)] for device, kind in devices]
    done = [run(pair, "contact", state, plan) for plan in plans]
    pair.close()
    assert [cell for cell in done if not cell.good] == []
    campaign.tell(f"{table} and {display} ms: {len(done)} cells")


@pytest.mark.punctual
def test_a_cell_through_threads_reaches_its_fault(found: tuple[Pair, Phases]) -> None:
    """While a host was enabled no new reading of the arm came: each cell ended in its first tick, and none was wrong."""
    _, phases = found
    pair = Pair(SCENES / "four_materials.xml", 20, threads=True, slots=2)
    try:
        for _ in range(6):  # of a busy machine one is enough
            cell = run(pair, "contact", phases["contact"], [("table", Kind.NAN, 0)])
            if not cell.early:
                break
    finally:
        pair.close()
    if cell.early and cell.trip == "silent":
        skip_unless_punctual(0.004)  # world, wire, thread and loop wait for one another: 20 ms are soon over
    assert not cell.early and cell.trip == "not-a-number" and cell.good


@pytest.mark.long
@pytest.mark.punctual
@pytest.mark.parametrize("ticks", [20, 23])
def test_reversed_tables_that_lie_through_threads(ticks: int) -> None:
    """In real time, at whatever phase of its exchanges the fault comes; a busy machine stops some before it does."""
    scene = SCENES / "four_materials.xml"
    pair = Pair(scene, ticks, threads=False, slots=2)
    phases = stored(pair)
    pair.close()
    pair = Pair(scene, ticks, threads=True, slots=2)
    faults = [[("table", lies, 0), ("table", Kind.REVERSED_SIGN, 1)] for lies in LIES]
    done = [run(pair, "contact", phases["contact"], both) for both in faults * 5]
    pair.close()
    assert [cell for cell in done if not cell.good] == []
    reached = sum(not cell.early for cell in done)
    campaign.tell(f"{ticks} ms: {reached} of {len(done)} reached their fault")
    assert 2 * reached > len(done), "this machine had no time for it: nothing is shown"


@pytest.mark.long
@pytest.mark.punctual
@pytest.mark.parametrize("ticks", [20, 23])
def test_the_whole_matrix_through_threads(ticks: int) -> None:
    """In real time: on a busy machine cells end early, because a device was silent; nothing may pass a limit then."""
    scene = SCENES / "four_materials.xml"
    pair = Pair(scene, ticks, threads=False)
    phases = stored(pair)
    pair.close()
    pair = Pair(scene, ticks, threads=True)
    done = list(cells(pair, phases))
    pair.close()
    assert len(done) == len(KINDS) * 3 * 5
    assert [cell for cell in done if not cell.good] == []
    assert 2 * sum(not cell.early for cell in done) > len(done), "this machine had no time for it: nothing is shown"
