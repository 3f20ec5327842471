"""Heat that spreads sideways under a finger on a part of the plate: an axisymmetric model of finger and plate.

Finite volumes on rings, implicit in time, for the changes that a touch causes: everything begins at rest, with a
temperature difference across the contact.  In one dimension heat spreads over the whole plate at once, and not at all
in the finger; the same solver can do that, too, so that the difference between both is due to spreading alone.  The
display's twin lets heat spread in the plate (`display.sideways`); it neglects spreading in the finger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from contact_heat.layers import ROOM, Layer
from contact_heat.resistance import DEFAULT_RESISTANCE
from contact_heat.steady import initial_profile
from itouch.plugin import Field, Record, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch_thermal.display.column import Array, tissue_side
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import ALUMINA, FILM, DisplayParams
from itouch_thermal.heat import FINGER

#: Radius of a fingertip [m].
TIP = 8e-3
#: Time step of the twin [s].
_TWIN_STEP = 1e-3
#: Factor on the conduction along the plate that makes its temperature uniform.
EVEN = 1e5
#: Time steps [s], each with the end of its use; numbers of rings to the contact's edge, to the tip's, to the plate's.
_STEPS = ((2e-3, 0.2), (2e-2, math.inf))
_RINGS = (12, 6, 12)
#: Numbers of cells of a plate layer up to a thickness [m], of a thick one with growth, and of all tissue with growth.
_CELLS, _THICK, _TISSUE = ((1e-4, 2), (1e-3, 6)), (18, 1.4), (26, 1.28)


@dataclass(frozen=True, slots=True)
class Touched:
    """A touch whose heat spreads: area [m2] and resistance [K m2/W] of the contact, the display and its layers.

    ``air`` [W/m2K] is the film through which the skin loses heat to a room at the plate's initial temperature.
    ``along_plate`` and ``along_finger`` are factors on the sideways conduction: 1 as it is, 0 none.
    """

    contact_area: float
    resistance: float = DEFAULT_RESISTANCE
    display: DisplayParams = DisplayParams()
    plate: tuple[Layer, ...] = (FILM, ALUMINA)
    air: float = 10.0
    along_plate: float = 1.0
    along_finger: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.contact_area <= self.display.area:
            raise ValueError(
                f"contact_area = {self.contact_area!r} m^2 is out of range: above 0, at most the plate's "
                f"{self.display.area:g} m^2"
            )
        if not 0.0 < self.resistance < math.inf:
            raise ValueError(f"resistance = {self.resistance!r} K*m^2/W is out of range: above 0")


def one_dimensional(touched: Touched) -> Touched:
    """Return the same touch in one dimension: a plate that is uniform at once, and a finger of separate columns."""
    return replace(touched, along_plate=EVEN, along_finger=0.0)


def flux(touched: Touched, times: Array) -> Array:
    """Return the mean flux through the contact [W/m2] per kelvin of initial difference between skin and plate.

    Parameters
    ----------
    touched
        The touch.
    times
        Times since the touch began [s], in ascending order, shape (n,).
    """
    grid = _Grid.of(touched)
    matrix, source, look, driven = _system(touched, grid)
    shown, at, state = [driven], [0.0], np.zeros(len(source))
    last = float(np.max(times))
    for step, until in _STEPS:
        if at[-1] >= last:
            break
        first, gain = _stages(matrix, step)
        while at[-1] < min(until, last) - 1e-9:
            state = first @ state + gain @ source
            at.append(at[-1] + step)
            shown.append(driven + float(look @ state))
    return np.asarray(np.interp(times, at, shown))


def _stages(matrix: Array, step: float) -> tuple[Array, Array]:
    """Return the matrices of a step for state and constant source: two implicit stages, L-stable, second order."""
    gamma, one = 1.0 - math.sqrt(0.5), np.eye(len(matrix))
    inverse = np.linalg.inv(one - gamma * step * matrix)
    k_state, k_source = inverse @ matrix, inverse
    second = inverse @ matrix @ (one + (1.0 - gamma) * step * k_state)
    second_source = inverse @ (one + (1.0 - gamma) * step * matrix @ k_source)
    return (
        one + step * ((1.0 - gamma) * k_state + gamma * second),
        step * ((1.0 - gamma) * k_source + gamma * second_source),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """Rings' edges [m], indices of the contact's and the tip's edge, cells of plate and tissue with thickness [m]."""

    edges: Array
    contact: int
    tip: int
    plate: list[tuple[Layer, float]]
    tissue: list[tuple[Layer, float]]

    @classmethod
    def of(cls, touched: Touched) -> _Grid:
        rim = math.sqrt(touched.display.area / math.pi)
        edge = math.sqrt(touched.contact_area / math.pi)
        tip = max(edge, min(TIP, rim))
        parts = [_towards(0.0, edge, _RINGS[0], end=True)]
        if tip > edge * 1.01:
            parts.append(_towards(edge, tip, _RINGS[1], end=False)[1:])
        else:
            tip = edge
        if rim > tip * 1.001:
            parts.append(_towards(tip, rim, _RINGS[2], end=False)[1:])
        edges = np.concatenate(parts)
        index = {name: int(np.argmin(np.abs(edges - radius))) for name, radius in (("edge", edge), ("tip", tip))}
        plate = [(layer, width) for layer in touched.plate for width in _widths(layer)]
        return cls(edges, index["edge"], index["tip"], plate, _tissue())

    @property
    def areas(self) -> Array:
        """Area of each ring [m2]."""
        found: Array = math.pi * np.diff(self.edges**2)
        return found


def _towards(begin: float, end_: float, count: int, *, end: bool) -> Array:
    """Return ring edges [m] that become dense towards the end that belongs to the contact."""
    part: Array = np.linspace(0.0, 1.0, count + 1, dtype=np.float64)
    part = 1.0 - (1.0 - part) ** 1.6 if end else part**1.6
    found: Array = begin + (end_ - begin) * part
    return found


def _widths(layer: Layer) -> list[float]:
    """Return the thickness of each cell in a layer of the plate [m], from the face down."""
    thickness = layer.thickness or 0.0
    count, growth = next(((n, 1.0) for most, n in _CELLS if thickness <= most), _THICK)
    widths = growth ** np.arange(count)
    return [float(width) for width in widths / widths.sum() * thickness]


def _tissue() -> list[tuple[Layer, float]]:
    """Return the tissue's cells from the skin inwards: thin at the skin, each of the layer at its middle."""
    depth = sum(layer.thickness or 0.0 for layer in FINGER)
    count, growth = _TISSUE
    widths = growth ** np.arange(count)
    widths *= depth / widths.sum()
    middles = np.cumsum(widths) - 0.5 * widths
    ends = np.cumsum([layer.thickness or 0.0 for layer in FINGER])
    return [
        (FINGER[int(np.searchsorted(ends, at))], float(width))
        for at, width in zip(middles.tolist(), widths.tolist(), strict=True)
    ]


def _system(touched: Touched, grid: _Grid) -> tuple[Array, Array, Array, float]:
    """Return matrix [1/s] and source [K/s] of the cells, and weights of the contact's mean flux and its initial value.

    The cells are those of the plate, ring by ring from the face down, then those of the finger from the skin inwards.
    """
    areas, rings, tip = grid.areas, len(grid.areas), grid.tip
    np_, nt = len(grid.plate), len(grid.tissue)
    size = rings * np_ + tip * nt
    book = _Network(np.zeros((size, size)), np.zeros(size))
    h = touched.display
    for i in range(rings):
        column = [i * np_ + k for k in range(np_)]
        book.stack(column, grid.plate, float(areas[i]))
        book.matrix[column[-1], column[-1]] += areas[i] * h.conductance / h.area  # through the legs to the sink
        if i >= grid.contact:
            book.matrix[column[0], column[0]] += areas[i] * h.film_coefficient
    base = rings * np_
    for i in range(tip):
        column = [base + i * nt + k for k in range(nt)]
        book.stack(column, grid.tissue, float(areas[i]))
        layer, width = grid.tissue[-1]
        book.matrix[column[-1], column[-1]] += areas[i] * layer.conductivity / (0.5 * width)  # to the core
        if i >= grid.contact:
            book.matrix[column[0], column[0]] += areas[i] * touched.air
    book.sideways(0, rings, grid.plate, grid.edges, touched.along_plate)
    book.sideways(base, tip, grid.tissue, grid.edges, touched.along_finger)
    (film, thin), (skin, outer) = grid.plate[0], grid.tissue[0]
    whole = 0.5 * thin / film.conductivity + 0.5 * outer / skin.conductivity + touched.resistance
    look, source = np.zeros(size), np.zeros(size)
    total = float(areas[: grid.contact].sum())
    for i in range(grid.contact):
        below, above, link = i * np_, base + i * nt, float(areas[i]) / whole
        book.join(below, above, link)
        source[below], source[above] = link, touched.air * float(areas[i]) - link  # the plate replaces the air
        look[below], look[above] = -link / total, link / total
    matrix = -book.matrix / book.capacity[:, None]
    return matrix, source / book.capacity, look, 1.0 / whole


@dataclass(frozen=True, slots=True, eq=False)
class _Network:
    """Conductances [W/K] between cells, and heat capacities [J/K]."""

    matrix: Array
    capacity: Array

    def join(self, one: int, other: int, link: float) -> None:
        """Connect two cells by a conductance [W/K]."""
        self.matrix[one, one] += link
        self.matrix[other, other] += link
        self.matrix[one, other] -= link
        self.matrix[other, one] -= link

    def stack(self, column: Sequence[int], cells: Sequence[tuple[Layer, float]], area: float) -> None:
        """Stack the cells of one ring, with their perfusion."""
        for index, (layer, width) in zip(column, cells, strict=True):
            self.capacity[index] = area * width * layer.heat_capacity
            self.matrix[index, index] += area * width * layer.perfusion
        for k in range(len(column) - 1):
            (one, above), (other, below) = cells[k], cells[k + 1]
            self.join(
                column[k], column[k + 1], area / (0.5 * above / one.conductivity + 0.5 * below / other.conductivity)
            )

    def sideways(
        self, base: int, rings: int, cells: Sequence[tuple[Layer, float]], edges: Array, factor: float
    ) -> None:
        """Connect neighbouring rings."""
        if factor <= 0.0:
            return
        middles = 0.5 * (edges[1:] + edges[:-1])
        for i in range(rings - 1):
            shape = factor * 2.0 * math.pi * float(edges[i + 1]) / float(middles[i + 1] - middles[i])
            for k, (layer, width) in enumerate(cells):
                self.join(
                    base + i * len(cells) + k, base + (i + 1) * len(cells) + k, shape * width * layer.conductivity
                )


def flux_of_twin(touched: Touched, times: Array) -> Array:
    """Return the same as `flux`, for the display's twin under a finger that presses with 1 N, shape (n,).

    ``times`` has shape (n,) [s]; the flux is in [W/m2].
    """
    display = replace(
        touched.display, contact_area=touched.contact_area, area_exponent=0.0, contact_resistance=touched.resistance
    )
    twin = DisplayTwin(display)
    state, command = Record.of(twin.fields()), Record.of([Field("current", "f8", 1)])
    twin.reset(state, np.random.default_rng(0))
    gap = display.skin_temperature - state["true_plate"].item()
    found, bound, touch = list[float](), BoundTwin(twin), TwinInputs(force=1.0, gap=0.0)
    for _ in range(math.ceil(float(np.max(times)) / _TWIN_STEP)):
        bound.step(state, command, touch, _TWIN_STEP)
        found.append(state["true_flux"].item() / gap)
    return np.asarray(np.interp(times, np.arange(1, len(found) + 1) * _TWIN_STEP, found))


def error(touched: Touched, times: Array, *, even: bool = True) -> Array:
    """Return the relative excess of a simpler flux over that of heat spreading in finger and plate, shape (n,).

    The simpler flux is that of one dimension, with a plate that is ``even`` at once, or that of the display's twin, in
    which heat spreads in the plate but not in the finger.

    ``times`` has shape (n,) [s]; the result has no unit.
    """
    if even:
        return np.asarray(flux(one_dimensional(touched), times) / flux(touched, times) - 1.0)
    # The skin's loss to the air is that of the twin's finger at rest.
    loss = resting_loss(touched.display)
    return np.asarray(flux_of_twin(touched, times) / flux(replace(touched, air=loss), times) - 1.0)


def resting_loss(display: DisplayParams) -> float:
    """Return the film [W/m2K] through which the twin's skin at rest loses its heat to a room at 23 degC."""
    rest = tissue_side(display.tissue or FINGER, display.core, display.skin_temperature)
    return -float(initial_profile(rest).flux_at(0.0)) / (display.skin_temperature - ROOM)


def passed(times: Array, off: Array, bound: float) -> float | None:
    """Return the first time [s] at which an error exceeds a bound; None if it never does.

    ``times`` has shape (n,) [s], ``off`` (n,) in the unit of the bound.
    """
    beyond = np.flatnonzero(np.abs(off) > bound)
    return float(times[beyond[0]]) if len(beyond) else None
