"""What a modality measures of a contact: the report's key, and how the figure is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass

from itouch.plugin.quantity import Role

_SQUARES = str.maketrans({"2": "²", "3": "³"})


@dataclass(frozen=True, slots=True)
class Measured:
    """One figure of a contact, which `Modality.measures` returns under its key.

    Attributes
    ----------
    key
        Key of the report's entry; null there where the contact has no such figure.
    unit
        SI unit of the number in the report, in the notation of scenes (``m/s^2``); ``"1"`` is a plain number, a text
        or a yes or no.
    doc
        One sentence that says what is measured.
    title
        What it is called in a table's head; default: the key.
    head
        Head of its column on a terminal, where room is short; default: title and unit.
    digits
        How many digits after the point are shown.
    percent
        A share of 1, shown in per cent.  On a terminal such columns, which say how good a contact was, stand last.
    show
        ``""``: on the terminal and on the page; ``"page"``: on the page only; ``"no"``: in the report's data only.
    worst
        Under what words the summary shows the greatest of all contacts; empty: not there.
    must
        Of a yes or no: which of the two it must be, so that a touch counts in a study; None: either.
    otherwise
        What is said of a touch where it is the other.
    role
        What it is for: ``HEAT_FLUX``, the mean flux of the contact; ``SKIN_TEMPERATURE``, by how much the skin fell.  A
        study takes these where nothing tells what was truly felt.
    error
        Whether it is by how much what was rendered differs from what was wanted, as a share: a touch counts in a study
        only up to the study's ``flux-error``.
    """

    key: str
    unit: str
    doc: str
    title: str = ""
    head: str = ""
    digits: int = 2
    percent: bool = False
    show: str = ""
    worst: str = ""
    must: bool | None = None
    otherwise: str = ""
    role: Role = Role.SIGNAL
    error: bool = False

    def __post_init__(self) -> None:
        if not self.key or not self.unit or not self.doc.strip():
            raise ValueError(
                f"measured '{self.key}': a key, a unit and one sentence are needed, "
                "such as Measured('vibration_m_s2', 'm/s^2', 'strongest vibration of the contact')"
            )
        if self.show not in ("", "page", "no"):
            raise ValueError(f"measured '{self.key}': show is '', 'page' or 'no', not '{self.show}'")
        if (self.must is None) != (not self.otherwise):
            raise ValueError(f"measured '{self.key}': must says what it has to be, otherwise what is said if it is not")

    def broken(self, value: object) -> bool:
        """Tell whether a figure is known, and is not what it must be."""
        return self.must is not None and value is not None and bool(value) is not self.must

    @property
    def scale(self) -> float:
        """What the number is multiplied with to be shown."""
        return 100.0 if self.percent else 1.0

    @property
    def shown_unit(self) -> str:
        """The unit of what is shown; empty for a plain number."""
        return "%" if self.percent else "" if self.unit == "1" else self.unit

    @property
    def page_head(self) -> str:
        """Head of its column on a page: title and unit."""
        before, *powers = self.shown_unit.split("^")
        unit = before + "".join(power[:1].translate(_SQUARES) + power[1:] for power in powers)
        return f"{self.title or self.key} [{unit}]" if unit else self.title or self.key

    @property
    def short_head(self) -> str:
        """Head of its column on a terminal."""
        return self.head or (f"{self.title} {self.shown_unit}".strip() if self.title else self.key)

    def told(self, value: object) -> str:
        """Return a figure as a cell of a terminal's table; what is no number stays as it is, nothing is a dash."""
        if value is None or isinstance(value, bool):
            return "-" if value is None else "yes" if value else "no"
        if not isinstance(value, int | float):
            return str(value)
        number = float(value) * self.scale
        return f"{number:z.{self.digits}f}{' %' if self.percent else ''}" if math.isfinite(number) else "-"
