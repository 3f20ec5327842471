"""The readings of a film on a sample in a touch, in closed form: fast enough for thousands of fits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact_heat.contour import talbot
from contact_heat.layers import Layer
from contact_heat.resistance import DEFAULT_RESISTANCE
from itouch_thermal.display.column import Array
from itouch_thermal.heat import FINGER

Complex = NDArray[np.complex128]

#: Nodes of the contour: the inverse is accurate to some 1e-9.
_Z, _WEIGHTS = talbot(16)
#: Heat transfer coefficient at a sample's back [W/m2K]; value of `s` that represents a field at rest [1/s].
_BACK, _REST = 10.0, 1e-9
#: Number of cached impedances.
_KEPT = 8


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of the touches: temperatures [K], film, sample, forces [N].

    ``delay`` [s] is the time constant with which the skin flattens: some time later, the touch looks as if it had begun
    that much later with its final resistance.
    """

    skin: float
    room: float
    film: Layer | None
    forces: tuple[float, ...]
    depth: float = 0.02
    sample: Layer | None = None
    delay: float = 0.0


@dataclass(frozen=True, slots=True)
class Values:
    """The values to estimate; ``effusivity`` [W s^1/2/m2K] only if the sample is not known.

    ``late`` [s] is the delay of a touch's start beyond the known one, as caused by the flattening of the skin.
    """

    resistance: float = DEFAULT_RESISTANCE
    exponent: float = 0.3
    curve: float = 0.0
    effusivity: float = 350.0
    epidermis: float = 7e-4
    core: float = 310.15
    perfusion: float = 5000.0
    lag: float = 0.05
    gain: float = 1.0
    late: float = 0.0
    offset: float = 0.0


class Forward:
    """Computes the readings of touches at given times, shape (touches, times)."""

    def __init__(self, known: Known, times: Array) -> None:
        self.known = known
        self.times = times = np.maximum(times - known.delay, 1e-3)
        self._points: Complex = (_Z / times[:, None]).ravel()
        self._kept: dict[tuple[float, ...], tuple[Complex, ...]] = {}

    def _once(self, key: tuple[float, ...], make: Callable[[], tuple[Complex, ...]]) -> tuple[Complex, ...]:
        """Return impedances, cached for the last few values, as most steps of a fit change only some of them."""
        if key not in self._kept:
            if len(self._kept) >= _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = make()
        return self._kept[key]

    def __call__(self, values: Values) -> Array:
        """Return the film's readings [W/m2]."""
        s, known = self._points, self.known
        rest = np.array([_REST + 0j])
        finger, still = self._once(
            (1.0, values.epidermis, values.perfusion), lambda: (_finger(s, values), _finger(rest, values))
        )
        body, passed = self._once((2.0, values.effusivity), lambda: _body(s, known, values))
        loss = (values.core - known.skin) / float(still[0].real)
        driven = (known.skin - known.room) / s + finger * loss / s
        seen = driven * passed * values.gain * np.exp(-s * values.late) / (1.0 + s * values.lag)
        rows = []
        for force in known.forces:
            resistance = resistance_at(values, force)
            shown = (seen / (finger + body + resistance)).reshape(len(self.times), -1)
            rows.append((_WEIGHTS * shown).real.sum(axis=1) / self.times + values.offset)
        return np.stack(rows)


def resistance_at(values: Values, force: float) -> float:
    """Return the contact resistance [K m2/W] at a force [N]; its exponent may vary with the force."""
    return float(values.resistance * force ** -(values.exponent + values.curve * np.log(force)))


def tissue(values: Values) -> tuple[Layer, ...]:
    """Return the finger's layers."""
    from dataclasses import replace

    outer, *inner = FINGER
    deep = (replace(layer, perfusion=values.perfusion) for layer in inner)
    return (replace(outer, thickness=values.epidermis), *deep)


def _finger(s: Complex, values: Values) -> Complex:
    """Return the impedance of the finger at its skin; its back is held at a temperature."""
    found: Complex = np.zeros(s.shape, dtype=np.complex128)
    for layer in reversed(tissue(values)):
        found = _through(s, layer, found)[0]
    return found


def _body(s: Complex, known: Known, values: Values) -> tuple[Complex, Complex]:
    """Return the impedance of film and sample, and the share of the flux into them that crosses the film's middle."""
    sample = known.sample
    if sample is None:
        # Only the effusivity of a thick sample matters: any conductivity with that effusivity will do.
        below: Complex = np.asarray(1.0 / (values.effusivity * np.sqrt(s)), dtype=np.complex128)
    else:
        below = _through(s, sample, np.full_like(s, 1.0 / _BACK))[0]
    if known.film is None:
        return below, np.ones_like(s)
    half = _halved(known.film)
    middle, _ = _through(s, half, below)
    face, passed = _through(s, half, middle)
    return face, passed


def _halved(film: Layer) -> Layer:
    from dataclasses import replace

    return replace(film, thickness=0.5 * (film.thickness or 0.0))


def _through(s: Complex, layer: Layer, below: Complex) -> tuple[Complex, Complex]:
    """Return the impedance at the top of a layer on an impedance, and the share of its flux that leaves below."""
    q = np.sqrt((layer.heat_capacity * s + layer.perfusion) / layer.conductivity)
    own = 1.0 / (layer.conductivity * q)
    far = np.exp(-2.0 * q * (layer.thickness or 0.0))
    tanh, cosh = (1.0 - far) / (1.0 + far), 0.5 * (1.0 + far)
    up = own * (below + own * tanh) / (own + below * tanh)
    passed = np.exp(-q * (layer.thickness or 0.0)) / (cosh * (1.0 + below / own * tanh))
    return up, passed


def binned(times: Array, rows: Array, edges: Array) -> tuple[Array, Array]:
    """Return the means of rows (touches, samples) in bins between edges (bins + 1,), and each bin's number of samples.

    ``times`` (samples,) and ``edges`` are in [s]; the means are in the unit of the rows.
    """
    index = np.searchsorted(edges, times, side="right") - 1
    count = np.array([(index == k).sum() for k in range(len(edges) - 1)], dtype=np.float64)
    found: Array = np.array([rows[:, index == k].mean(axis=1) for k in range(len(edges) - 1)]).T
    return found, count


def inside(edges: Array) -> tuple[Array, Any]:
    """Return two times in each bin at which the mean approximates the bin's mean, and a function that takes it.

    ``edges`` is (bins + 1,) [s], the times are (2 bins,) [s].
    """
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    points = np.stack((middle - half / np.sqrt(3.0), middle + half / np.sqrt(3.0)), axis=1).ravel()
    return points, lambda rows: rows.reshape(len(rows), -1, 2).mean(axis=2)
