"""The laws of every monitor, for faults after which a surface withdraws whose place is not believed, behind wires."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import campaign
import pytest
from exchange_phases import Phases, wired, wired_phases
from shipped import SCENES

from itouch.faults import Kind
from itouch_evidence.faults import behind_wires, differing
from itouch_evidence.faults.behind_wires import Pair, run, stored
from itouch_evidence.faults.matrix import DELAY, Cell
from itouch_evidence.renamed import RenamedCatalog

SCENE = SCENES / "four_materials.xml"
#: How a table lies about its place from one reading to the next, whatever it was before.
LIES = (Kind.NAN, Kind.WRONG_UNITS, Kind.GARBAGE)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Phases, dict[tuple[str, ...], Cell]]:
    """Return the States of a host and its world in each phase, and what comes of each lie under the scene's limits."""
    pair, phases = wired(), wired_phases(tmp_path_factory)
    cells = {(lie.label, *more): cell(pair, phases, lie, *more) for lie in LIES for more in ((), ("reversed-sign",))}
    pair.close()
    return phases, cells


def cell(pair: Pair, phases: Phases, lie: Kind, *more: str) -> Cell:
    faults = [("table", lie, 0), *(("table", Kind.REVERSED_SIGN, 1) for _ in more)]
    return run(pair, "contact", phases["contact"], faults)


def tighter(number: int, folder: Path) -> tuple[Path, str]:
    """Write the scene with some limits tighter than it asks for, in units that it does not use; return what was asked."""
    rng = random.Random(f"tighter {number}")
    drawn = {
        "force": f"{rng.uniform(300.0, 3000.0):.0f} mN", "speed": f"{rng.uniform(2.0, 25.0):.1f} cm/s",
        "plate-force": f"{rng.uniform(500.0, 2000.0):.0f} mN", "flux": f"{rng.uniform(1.0, 15.0):.1f} kW/m^2",
        "plate-rate": f"{rng.uniform(60.0, 600.0):.0f} K/min", "dose": f"{rng.uniform(0.05, 2.0):.2f} min",
        "cold-time": f"{rng.uniform(1.0, 120.0):.0f} s", "contact-time": f"{rng.uniform(500.0, 9000.0):.0f} ms",
        "watchdog": f"{rng.uniform(30.0, 100.0):.0f} ms",
        "temperature": f"{rng.uniform(288.2, 291.0):.1f} {rng.uniform(309.0, 313.1):.1f} K",
    }  # fmt: skip
    chosen = rng.sample(sorted(drawn), rng.randint(1, 4))
    asked = " ".join(f'{name}="{drawn[name]}"' for name in sorted({"force", *chosen}))
    text = SCENE.read_text(encoding="utf-8")
    for included in ("materials.xml", "rigs/twin.xml"):
        (folder / included).parent.mkdir(exist_ok=True)
        shutil.copyfile(SCENES / included, folder / included)
    path = folder / f"tighter_{number}.xml"
    assert text.count('<safety force="3 N"/>') == 1
    path.write_text(text.replace('<safety force="3 N"/>', f"<safety {asked}/>"), encoding="utf-8")
    return path, asked


@pytest.mark.parametrize("number", campaign.seeds(3, 40))
def test_tightening_limits_never_delays_or_removes_a_trip_that_leads_into_a_blind_retreat(
    found: tuple[Phases, dict[tuple[str, ...], Cell]], tmp_path: Path, number: int
) -> None:
    """Nor does it leave a surface nearer or harder than it may: a slower one has the time that it needs."""
    phases, cells = found
    path, asked = tighter(number, tmp_path)
    lie, more = LIES[number % 3], ((), ("reversed-sign",))[number // 3 % 2]
    pair = Pair(path, 20, threads=False, slots=2)
    tight = cell(pair, phases, lie, *more)
    pair.close()
    loose = cells[lie.label, *more]
    assert loose.after is not None and tight.after is not None, asked
    assert tight.after <= loose.after, asked
    assert tight.good and tight.safe, asked


def test_names_change_nothing_about_a_blind_retreat(found: tuple[Phases, dict[tuple[str, ...], Cell]]) -> None:
    _, cells = found
    other: list[RenamedCatalog] = []

    def catalog(finder: behind_wires.Finder) -> RenamedCatalog:
        other.append(RenamedCatalog(1, finder))
        return other[0]

    pair = Pair(SCENE, 20, threads=False, slots=2, catalog=catalog)
    phases = stored(pair)
    assert not {"wrench", "plate_temperature"} & {c.name for d in pair.host.model.devices.values() for c in d.reads}
    for (lie, *more), one in cells.items():
        assert differing(one, cell(pair, phases, Kind.of(lie), *more), other[0].words) == []
    pair.close()


@pytest.mark.parametrize("shift", campaign.some(range(1, 20), lambda ticks: ticks == 13))
def test_another_phase_of_the_exchanges_changes_no_time_by_more_than_their_interval(
    found: tuple[Phases, dict[tuple[str, ...], Cell]], shift: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A table that is exchanged with every 5 ms; the display, every 20."""
    phases, cells = found
    monkeypatch.setattr(behind_wires, "DELAY", DELAY + shift * 1e-3)
    pair = Pair(SCENE, 20, threads=False, slots=2)
    for (lie, *more), one in cells.items():
        shifted = cell(pair, phases, Kind.of(lie), *more)
        assert one.after is not None and shifted.after is not None
        assert abs(shifted.after - one.after) <= 0.005 + 1e-9
        assert shifted.trip == one.trip or lie == "garbage"  # whose numbers are others in another tick
        assert shifted.good and one.good
    pair.close()
