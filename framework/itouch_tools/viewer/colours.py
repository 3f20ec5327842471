"""Colour map and palette: the colours of temperatures (skin, plates, objects), of signals and of the window."""

from __future__ import annotations

import math

Colour = tuple[float, float, float]

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
UNKNOWN: Colour = (0.62, 0.62, 0.64)
#: Colours of the arrows of force and of the frame of the workspace.
FORCE: Colour = (0.95, 0.90, 0.35)
SPACE: Colour = (0.30, 0.55, 0.65)

#: Ends of the temperature scale [K].
COLD, WARM = 288.15, 313.15
#: A finger or plate is never beyond these temperatures [K]: a value there means no reading yet, or a broken sensor.
COLDEST, HOTTEST = 200.0, 400.0


def of_temperature(kelvin: float, cold: float = COLD, warm: float = WARM) -> Colour:
    """Return the colour of a temperature [K] on the scale from ``cold`` to ``warm``; beyond it that of the near end."""
    if not math.isfinite(kelvin):
        return UNKNOWN
    place = min(1.0, max(0.0, (kelvin - cold) / (warm - cold))) * (len(_CIVIDIS) - 1)
    index = min(int(place), len(_CIVIDIS) - 2)
    part = place - index
    low, high = _CIVIDIS[index], _CIVIDIS[index + 1]
    return tuple(a + part * (b - a) for a, b in zip(low, high, strict=True))  # type: ignore[return-value]
