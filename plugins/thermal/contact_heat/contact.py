"""The contact problem: two sides, the resistance between them, and the outputs wanted; from Python or from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contact_heat import casefile
from contact_heat.layers import Probe, Side, SideName, check_choice
from contact_heat.resistance import DEFAULT_RESISTANCE, check_resistance

#: Names of the columns that every solved contact has.
COLUMNS = ("t", "j", "T_skin", "T_object", "Q")


@dataclass(frozen=True, slots=True)
class Contact:
    """A finger side that touches an object side at t = 0 through a contact resistance [K m2/W]."""

    finger: Side
    object: Side
    resistance: float = DEFAULT_RESISTANCE
    probes: tuple[Probe, ...] = ()
    times: tuple[float, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        check_resistance(self.resistance)
        columns = list(COLUMNS)
        for probe in self.probes:
            if probe.name in columns:
                raise ValueError(
                    f"probes.name = {probe.name!r} is taken: each column of the result has its own name, and "
                    f"{', '.join(COLUMNS)} are those of the contact"
                )
            columns.append(probe.name)
            if probe.depth > self.side(probe.side).depth:
                raise ValueError(
                    f"probes.depth = {probe.depth!r} is out of range: 0 to {self.side(probe.side).depth:g} m "
                    f"on the {probe.side}"
                )

    def side(self, name: SideName) -> Side:
        """Return the side called ``finger`` or ``object``."""
        check_choice("side", name, ("finger", "object"))
        return self.finger if name == "finger" else self.object

    @staticmethod
    def from_json(path: str | Path) -> Contact:
        """Read a case file; see `contact_heat.casefile`.

        Raises
        ------
        ValueError
            If the file is wrong; the message names the file, the field, the value given and what is allowed.
        OSError
            If the file can't be read.
        """
        data = casefile.read_file(path)
        try:
            return case_of(data)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None


def case_of(data: Any) -> Contact:
    """Build a contact from the content of a case file.

    Raises
    ------
    ValueError
        If a field is wrong; the message names the field, the value given and what is allowed.
    """
    return Contact(**casefile.fields_of(data))
