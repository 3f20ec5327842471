"""What a number is: name, size, unit, meaning and role, the same for channels of devices and fields of State."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from itouch.schema.roles import HURTING, NEVER_HARMLESS, SIZES, Role

__all__ = ["HURTING", "NEVER_HARMLESS", "PLAIN", "SIZES", "Bound", "Quantity", "Role"]

#: What stands in place of a unit: for a plain number, a number of ticks, and numbers with different units.
PLAIN = frozenset({"1", "tick", "mixed"})
#: One number for all components, or one each.
Bound = float | tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A named vector of numbers with a unit and a meaning.

    Attributes
    ----------
    name, size
        It has ``size`` numbers; for a field of State 0 is a plain scalar, and a tuple a shape.
    unit
        SI unit in the notation of scenes (``N*s/m``); ``"1"`` is a plain number, ``"tick"`` a number of ticks,
        ``"mixed"`` numbers each in an SI unit of its own; empty: not declared.  For a pose or a wrench it is the unit
        of the linear part.
    low, high
        Bounds in that unit; subclasses define what they do.
    dtype
        NumPy scalar type.
    doc
        One sentence that says what is measured, commanded or remembered.
    role
        What it is for; the framework acts on this and on nothing else.
    show
        Where it is plotted.  ``""``: in the chart of its unit, if it is a channel, or a single number with a unit of a
        twin or a modality; ``"no"``: nowhere; any other text: in the chart with that title, together with all others of
        the same title and unit.  ``"wish: TITLE"`` draws it dashed, as a wanted and not a measured quantity;
        ``"page: TITLE"`` shows it on the report's page only.  The title may be left out: ``"wish:"``.
        ``"TITLE | NAME"`` names the curve, if the name of its field would not do.
    """

    name: str
    size: int | tuple[int, ...] = 1
    unit: str = ""
    low: Any = ()
    high: Any = ()
    dtype: Any = field(default="f8", kw_only=True)
    doc: str = field(default="", kw_only=True)
    role: Role = field(default=Role.SIGNAL, kw_only=True)
    show: str = field(default="", kw_only=True)

    @property
    def shown_unit(self) -> str:
        """The unit in tables and charts: empty for plain numbers, ticks, mixed units, and if it is not declared."""
        return "" if self.unit in PLAIN else self.unit
