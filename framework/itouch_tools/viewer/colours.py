"""Colour map and palette: the colours of temperatures, of signals, and of the window, dark and light."""

from __future__ import annotations

import math
from dataclasses import dataclass

from itouch.recording import views

Colour = tuple[float, float, float]
#: A colour with its opacity.
Tint = tuple[float, float, float, float]

#: Samples of the colour map "cividis" (Nunez, Anderton and Renslow 2018, placed in the public domain): its lightness
#: rises evenly from blue to yellow, and it looks alike with and without colour blindness.
_CIVIDIS: tuple[Colour, ...] = (
    (0.000, 0.135, 0.304), (0.000, 0.189, 0.433), (0.165, 0.243, 0.423), (0.255, 0.299, 0.421), (0.333, 0.357, 0.425),
    (0.404, 0.414, 0.436), (0.472, 0.473, 0.454), (0.547, 0.533, 0.469), (0.627, 0.596, 0.460), (0.710, 0.663, 0.441),
    (0.796, 0.733, 0.408), (0.885, 0.806, 0.357), (0.995, 0.909, 0.217),
)  # fmt: skip

#: Colours of curves, distinct with and without colour blindness (Okabe and Ito 2008), lightened for a dark background.
CURVES: tuple[Colour, ...] = (
    (0.34, 0.71, 0.91), (0.90, 0.62, 0.00), (0.00, 0.75, 0.55), (0.95, 0.90, 0.35), (0.86, 0.50, 0.70),
    (0.95, 0.45, 0.20), (0.75, 0.75, 0.75),
)  # fmt: skip

#: Colours of the grid on the ground, of the HIP and of the proxy.
GRID: Colour = (0.27, 0.29, 0.34)
HIP: Colour = (0.95, 0.45, 0.20)
PROXY: Colour = (0.34, 0.71, 0.91)
#: Colour of what has no temperature, such as before the first reading.
UNKNOWN: Colour = views.UNPAINTED
#: Colours of the arrows of force and of the frame of the workspace.
FORCE: Colour = views.FORCE
SPACE: Colour = (0.30, 0.55, 0.65)

#: Ends of the temperature scale [K].
COLD, WARM = 288.15, 313.15
#: A finger or plate is never beyond these temperatures [K]: a value there means no reading yet, or a broken sensor.
COLDEST, HOTTEST = 200.0, 400.0


@dataclass(frozen=True, slots=True)
class Palette:
    """The colours of a picture: backgrounds, lines, words by weight; ``curve`` darkens curves on a light background."""

    panel: Tint
    axis: Tint
    fine: Tint
    words: Colour
    quiet: Colour
    good: Colour
    warn: Colour
    bad: Colour
    help: Tint
    alarm: Tint
    ground: Colour
    sky: Colour
    grid: Colour
    curve: float = 1.0

    def tint(self, weight: str) -> Colour:
        """Return the colour of words of this weight: "plain" or a field's name."""
        found: Colour = self.words if weight == "plain" else getattr(self, weight)
        return found

    def drawn(self, colour: Colour) -> Colour:
        """Return the colour in which a curve is drawn on this background."""
        return (self.curve * colour[0], self.curve * colour[1], self.curve * colour[2])


DARK = Palette(
    panel=(0.045, 0.052, 0.068, 0.86), axis=(0.55, 0.58, 0.63, 0.9), fine=(0.45, 0.48, 0.53, 0.28),
    words=(0.88, 0.90, 0.93), quiet=(0.62, 0.65, 0.70), good=(0.45, 0.85, 0.65), warn=(0.95, 0.80, 0.35),
    bad=(1.00, 0.62, 0.48), help=(0.045, 0.052, 0.068, 0.97), alarm=(0.30, 0.06, 0.04, 0.94),
    ground=(0.105, 0.118, 0.145), sky=(0.045, 0.052, 0.068), grid=GRID,
)  # fmt: skip
LIGHT = Palette(
    panel=(0.975, 0.98, 0.985, 0.92), axis=(0.35, 0.38, 0.43, 0.9), fine=(0.45, 0.48, 0.53, 0.30),
    words=(0.10, 0.12, 0.15), quiet=(0.33, 0.36, 0.41), good=(0.00, 0.40, 0.24), warn=(0.52, 0.36, 0.00),
    bad=(0.68, 0.12, 0.02), help=(0.975, 0.98, 0.985, 0.98), alarm=(1.00, 0.90, 0.87, 0.97),
    ground=(0.80, 0.82, 0.85), sky=(0.93, 0.94, 0.96), grid=(0.62, 0.65, 0.70), curve=0.62,
)  # fmt: skip


class _Shown:
    look = DARK


def look() -> Palette:
    """Return the colours of the picture that is being drawn."""
    return _Shown.look


def draw_in(chosen: Palette) -> None:
    """Draw in these colours from now on."""
    _Shown.look = chosen


def of_temperature(kelvin: float, cold: float = COLD, warm: float = WARM) -> Colour:
    """Return the colour of a temperature [K] on the scale from ``cold`` to ``warm``; beyond it that of the near end."""
    if not math.isfinite(kelvin):
        return UNKNOWN
    place = min(1.0, max(0.0, (kelvin - cold) / (warm - cold))) * (len(_CIVIDIS) - 1)
    index = min(int(place), len(_CIVIDIS) - 2)
    part = place - index
    low, high = _CIVIDIS[index], _CIVIDIS[index + 1]
    return tuple(a + part * (b - a) for a, b in zip(low, high, strict=True))  # type: ignore[return-value]
