"""The matrix: every kind of fault in every device in every phase of a touch, on the virtual clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from itouch.faults import Kind
from itouch.loop import DeviceFaultError
from itouch.plugin import DeviceError
from itouch.session import Session
from itouch_evidence.faults.truth import Truth

#: How long after its phase a fault begins, how long it lasts, and how long the cell runs [s].
DELAY, LASTS, RUN = 0.02, 1.0, 1.1
KINDS = tuple(kind for kind in Kind if kind is not Kind.NONE)


@dataclass(frozen=True, slots=True)
class Cell:
    """The result of one fault, or of two: which trip stopped it, after what time, and which limits the truth broke.

    ``told`` says whether the report names the faults, ``cause`` what it says of the trip; times are in [s].
    """

    faults: tuple[tuple[str, str], ...]
    phase: str
    trip: str
    cause: str
    after: float | None
    safe_after: float | None
    safe: bool
    broken: tuple[str, ...]
    told: bool

    @property
    def good(self) -> bool:
        """Whether no absolute limit was passed, every trip made all safe in time, and the report has the fault."""
        return not self.broken and self.safe and self.told

    @property
    def early(self) -> bool:
        """Whether it was stopped before its fault began, because the machine was busy: it shows nothing then."""
        return self.after is not None and self.after < -1e-9


def single(session: Session, stored: Mapping[str, bytes]) -> Iterator[Cell]:
    """Run every kind of fault in every device in every phase."""
    truth = Truth(session)
    for phase, state in stored.items():
        for device in session.model.devices:
            for kind in KINDS:
                yield run_cell(session, truth, phase, state, [(device, kind, 0)])


def pairs(session: Session, phase: str, state: bytes) -> Iterator[Cell]:
    """Run every pair of faults at once: of two kinds, or of one kind in two devices."""
    truth = Truth(session)
    every = [(device, kind) for device in session.model.devices for kind in KINDS]
    for (one, first), (other, second) in combinations(every, 2):
        slot = 1 if one == other else 0
        yield run_cell(session, truth, phase, state, [(one, first, 0), (other, second, slot)])


def run_cell(session: Session, truth: Truth, phase: str, state: bytes, faults: Sequence[tuple[str, Kind, int]]) -> Cell:
    """Run one cell of the matrix from the stored State of its phase."""
    session.adopt(state)
    session.statistics.faults.clear()
    session.statistics.contacts.clear()
    truth.clear()
    begin = session.seconds + (0.0 if phase == "closed-open" else DELAY)
    for device, kind, slot in faults:
        session.inject(device, kind.label, at=begin, duration=LASTS, slot=slot)
    session.taps.append(truth.note)
    refused = ""
    try:
        session.run(RUN)
    except DeviceFaultError:
        pass
    except DeviceError as error:
        refused = str(error)
    finally:
        session.taps.remove(truth.note)
    return _cell(session, truth, phase, faults, begin, refused)


def _cell(
    session: Session, truth: Truth, phase: str, faults: Sequence[tuple[str, Kind, int]], begin: float, refused: str
) -> Cell:
    entries: list[dict[str, Any]] = session.report()["faults"]
    trips = [entry for entry in entries if entry["trip"] is not None]
    told = {(entry["device"], entry["kind"]) for entry in entries if entry["trip"] is None}
    wanted = tuple((device, kind.label) for device, kind, _ in faults)
    first = trips[0] if trips else None
    safe = first["safe"] if first is not None and "safe" in first else None
    return Cell(
        faults=wanted,
        phase=phase,
        trip=first["trip"] if first is not None else "refused" if refused else "",
        cause=first["cause"] if first is not None else refused,
        after=first["time_s"] - begin if first is not None else None,
        safe_after=safe["after_s"] if safe is not None else None,
        safe=bool(refused) or safe is None or bool(safe["reached"]),
        broken=tuple(truth.broken()),
        told=set(wanted) <= told,
    )
