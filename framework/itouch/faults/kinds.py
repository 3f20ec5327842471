"""The kinds of fault that can be injected, and the plan of one."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass


class Kind(enum.IntEnum):
    """How a device fails."""

    NONE = 0
    DISCONNECT = 1
    FREEZE = 2
    NAN = 3
    BIAS = 4
    DRIFT = 5
    SPIKE = 6
    DELAY = 7
    DROP = 8
    REVERSED_SIGN = 9
    SATURATED = 10
    WRONG_UNITS = 11
    GARBAGE = 12

    @property
    def label(self) -> str:
        """Its name in scenes and reports."""
        return self.name.lower().replace("_", "-")

    @classmethod
    def of(cls, label: str) -> Kind:
        """Return the kind with a label.

        Raises
        ------
        ValueError
            If there is none.
        """
        for kind in cls:
            if kind.label == label and kind is not cls.NONE:
                return kind
        raise ValueError(f"kind = {label!r} is not one of {', '.join(kind.label for kind in cls if kind)}")


#: The kinds that have a size, in the order of `AMOUNTS`.
SIZED = (Kind.BIAS, Kind.DRIFT, Kind.SPIKE)
#: End [tick] of a fault that lasts to the end of the session.
FOREVER = 1 << 62

#: By how many readings or commands a delay is late, share of them that is dropped, share of samples that are spikes.
LATE, DROPPED, SPIKES = 10, 0.2, 0.05

#: By unit: size of a bias, of a drift per second, and of a spike.
AMOUNTS: dict[str, tuple[float, float, float]] = {
    "m": (0.005, 0.002, 0.05), "N": (1.0, 0.5, 20.0), "K": (5.0, 1.0, 30.0), "W/m^2": (3e3, 1e3, 15e3),
    "m/s": (0.2, 0.1, 2.0),
}  # fmt: skip
#: By unit: factor and offset of a reading that comes in the wrong unit (mm, mN, degC, kW/m2).
UNITS: dict[str, tuple[float, float]] = {
    "m": (1e3, 0.0), "N": (1e3, 0.0), "K": (1.0, -273.15), "W/m^2": (1e-3, 0.0), "m/s": (1e3, 0.0),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Injection:
    """One fault: its kind, first tick and tick of its end, channel (empty: all), and size (NaN: that of `AMOUNTS`).

    Raises
    ------
    ValueError
        If a size is given to a kind that has none.
    """

    kind: Kind
    begin: int
    end: int = FOREVER
    channel: str = ""
    amount: float = math.nan

    def __post_init__(self) -> None:
        if self.kind not in SIZED and not math.isnan(self.amount):
            sized = ", ".join(kind.label for kind in SIZED)
            raise ValueError(f"a fault of kind '{self.kind.label}' has no amount: of {sized} only it is the size")
