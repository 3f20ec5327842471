"""A solved contact as a table: the columns of a CSV file, in degC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from contact_heat.casefile import CELSIUS
from contact_heat.contact import COLUMNS, Contact
from contact_heat.stack import Array

if TYPE_CHECKING:
    from contact_heat.stepper import Stepper

#: Number of steps that are taken at once.
_PART = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns by name: t [s], j [W/m2], T_skin, T_object [degC], Q [J/m2], probes; ``fluxes`` names those in W/m2."""

    columns: dict[str, Array]
    fluxes: tuple[str, ...]

    def csv(self) -> str:
        """Return the table as CSV text with 17 significant digits."""
        rows = zip(*self.columns.values(), strict=True)
        lines = [",".join(self.columns), *(",".join(f"{value:.17g}" for value in row) for row in rows)]
        return "\n".join(lines) + "\n"


def solution_table(contact: Contact, times: Sequence[float], method: Literal["exact", "paper"]) -> Table:
    """Solve a contact and return its table."""
    from contact_heat.exact import solve

    found = solve(contact, times) if method == "exact" else solve(contact, times, method="paper")
    skin, touched = found.skin_temperature - CELSIUS, found.object_temperature - CELSIUS
    columns = dict(zip(COLUMNS, (found.times, found.flux, skin, touched, found.heat), strict=True))
    for probe in contact.probes:
        if probe.what == "j":
            columns[probe.name] = found.flux_at(probe.side, probe.depth)
        else:
            columns[probe.name] = found.temperature(probe.side, probe.depth) - CELSIUS
    return Table(columns, _fluxes(contact))


def live_table(contact: Contact, times: Sequence[float], period: float) -> Table:
    """Step a contact as the servo loop does; times are rounded to steps, and dropped before the first.

    Raises
    ------
    ValueError
        If the period is out of range, or all times are before the first step.
    """
    from contact_heat.stepper import Stepper

    stepper = Stepper(contact, period)
    rows, done = [], 0
    for step in sorted({round(time / period) for time in times if round(time / period) >= 1}):
        while done < step:  # in parts, as all fluxes of an hour in microseconds fit in no memory
            part = min(step - done, _PART)
            flux = stepper.advance(contact.resistance, part)[-1]
            done += part
        row = [step * period, flux, stepper.skin_temperature - CELSIUS, stepper.object_temperature - CELSIUS]
        rows.append([*row, stepper.heat, *(_probed(stepper, contact))])
    if not rows:
        raise ValueError(f"times: none reaches the first step at {period:g} s")
    names = [*COLUMNS, *(probe.name for probe in contact.probes)]
    return Table(dict(zip(names, np.array(rows).T, strict=True)), _fluxes(contact))


def _probed(stepper: Stepper, contact: Contact) -> list[float]:
    return [
        stepper.flux_at(probe.side, probe.depth)
        if probe.what == "j"
        else stepper.temperature(probe.side, probe.depth) - CELSIUS
        for probe in contact.probes
    ]


def _fluxes(contact: Contact) -> tuple[str, ...]:
    return ("j", *(probe.name for probe in contact.probes if probe.what == "j"))
