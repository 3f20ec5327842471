"""The plants on which the display is measured: the nominal one, and sixteen corners of its possible mismatches."""

from __future__ import annotations

from itouch_thermal.display.params import Mismatch

#: Relative deviation of each parameter in a corner, and offset of the plate's sensor [K].
PART, OFFSET = 0.1, 0.05

#: Signs of contact resistance, Seebeck, legs, electrical resistance, plate, finger, sensor lag, offset: a fractional
#: two-level design in eight factors, of which any three occur in all combinations.
SIGNS: tuple[tuple[int, ...], ...] = tuple(
    (a, b, c, d, b * c * d, a * c * d, a * b * c, a * b * d)
    for a in (-1, 1) for b in (-1, 1) for c in (-1, 1) for d in (-1, 1)
)  # fmt: skip
SEEDS: tuple[int, ...] = (1, 2, 3)


def corners(*, exact_finger: bool = False) -> tuple[Mismatch, ...]:
    """Return the sixteen corners; with ``exact_finger`` the finger's effusivity is as modelled."""
    found = []
    for r, s, k, e, p, f, lag, offset in SIGNS:
        found.append(
            Mismatch(
                contact_resistance=PART * r,
                seebeck=PART * s,
                conductance=PART * k,
                resistance=PART * e,
                plate_effusivity=PART * p,
                finger_effusivity=0.0 if exact_finger else PART * f,
                sensor_lag=PART * lag,
                plate_offset=OFFSET * offset,
            )  # fmt: skip
        )
    return tuple(found)
