"""What a modality measures of a contact: its key in the report, and how the figure is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass

from itouch.moved import with_old_fields
from itouch.plugin.quantity import Role

_SQUARES = str.maketrans({"2": "²", "3": "³"})


@with_old_fields(
    must="required_value", otherwise="failure_reason", worst="maximum_label", head="short_title",
    error="relative_error", broken="violated_by", told="formatted",
)  # fmt: skip
@dataclass(frozen=True, slots=True)
class Measured:
    """One figure of a contact, which `Modality.measures` returns under its key.

    Attributes
    ----------
    key
        Its key in the report's entry of a contact; null there if the contact has no such figure.
    unit
        SI unit of the number in the report, in the notation of scenes (``m/s^2``); ``"1"`` is a plain number, a text,
        or a yes or no.
    doc
        One sentence that says what is measured.
    title
        Its title in the head of a table; default: the key.
    short_title
        Head of its column on a terminal, where space is short; default: title and unit.
    digits
        How many digits after the decimal point are shown.
    percent
        Whether it is a share of 1, shown in per cent.  On a terminal such columns, which say how good a contact was,
        come last.
    show
        ``""``: on the terminal and on the page; ``"page"``: on the page only; ``"no"``: in the report's data only.
    maximum_label
        Label under which the summary shows the greatest value of all contacts; empty: it does not.
    required_value
        Of a yes or no: the value it must have for a touch to count in a study; None: either.
    failure_reason
        What is said of a touch with the other value.
    role
        What it is for: ``HEAT_FLUX``, the mean flux of the contact; ``SKIN_TEMPERATURE``, by how much the skin cooled.
        A study uses these if nothing tells what was truly felt.
    relative_error
        Whether it is the relative difference of what was rendered from what was wanted: in a study a touch counts only
        if it is at most the study's ``flux-error``.
    """

    key: str
    unit: str
    doc: str
    title: str = ""
    short_title: str = ""
    digits: int = 2
    percent: bool = False
    show: str = ""
    maximum_label: str = ""
    required_value: bool | None = None
    failure_reason: str = ""
    role: Role = Role.SIGNAL
    relative_error: bool = False

    def __post_init__(self) -> None:
        if not self.key or not self.unit or not self.doc.strip():
            raise ValueError(
                f"measured '{self.key}': a key, a unit and one sentence are needed, "
                "such as Measured('vibration_m_s2', 'm/s^2', 'strongest vibration of the contact')"
            )
        if self.show not in ("", "page", "no"):
            raise ValueError(f"measured '{self.key}': show is '', 'page' or 'no', not '{self.show}'")
        if (self.required_value is None) != (not self.failure_reason):
            wanted = (
                "required_value and failure_reason go together: what the value must be, and what to say if it is not"
            )
            raise ValueError(f"measured '{self.key}': {wanted}")

    def violated_by(self, value: object) -> bool:
        """Tell whether a figure is known and does not have the value that it must have."""
        return self.required_value is not None and value is not None and bool(value) is not self.required_value

    @property
    def scale(self) -> float:
        """The factor on the number when it is shown."""
        return 100.0 if self.percent else 1.0

    @property
    def shown_unit(self) -> str:
        """The unit in which it is shown; empty for a plain number."""
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
        return self.short_title or (f"{self.title} {self.shown_unit}".strip() if self.title else self.key)

    def formatted(self, value: object) -> str:
        """Return a figure as a cell of a terminal's table; a text stays as it is, a missing figure is a dash."""
        if value is None or isinstance(value, bool):
            return "-" if value is None else "yes" if value else "no"
        if not isinstance(value, int | float):
            return str(value)
        number = float(value) * self.scale
        return f"{number:z.{self.digits}f}{' %' if self.percent else ''}" if math.isfinite(number) else "-"
