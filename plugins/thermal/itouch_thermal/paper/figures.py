"""The contents of the paper's figures: curves, axes, and where we differ from the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contact_heat.contact import Contact
from itouch_thermal.display.column import Array
from itouch_thermal.flux.curve import LARGEST_FILE, Curve, decode_curve
from itouch_thermal.heat import FINGER
from itouch_thermal.paper.setup import MATERIALS, halfspaces, sample
from itouch_thermal.paper.work import COARSE, SPACING, Work
from itouch_thermal.rendering.closedloop import PERIOD, Run

#: The paper draws metal and polystyrene red in its figures 5 and 7, and wood blue in figure 6.
DESIRED = {"aluminium": "#d1251f", "wood": "#1f4fd1", "polystyrene": "#d1251f"}
COLORS = {"aluminium": "#3f4348", "pyrex": "#00758f", "wood": "#8a4b12", "polystyrene": "#b8327a"}
#: Plate temperatures of figure 3 relative to the room's [K], and dashes that distinguish them without colour.
OFFSETS = (-8, -4, 0, 4, 8, 12, 16)
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
FLUX, CURRENT = "heat flux [W/m²]", "current [A]"

#: The figures over which such curves are drawn.
SHOWN = frozenset((2, 5, 6, 7, 11))


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A curve: times [s] and values, shape (rows,); on the right-hand axis if it is not of the panel's quantity."""

    name: str
    times: Array
    values: Array
    color: str
    style: Any = "-"
    right: bool = False
    column: str = "j [W/m^2]"
    width: float = 1.3


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Curves on common axes."""

    title: str
    lines: tuple[Line, ...]
    left: str = FLUX
    logarithmic: bool = False
    limits: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A figure of the paper: what it shows, how ours differs, and panels (without any, a drawing)."""

    number: int
    caption: str
    differences: tuple[str, ...]
    panels: tuple[Panel, ...] = ()

    @property
    def stem(self) -> str:
        """The stem of its file names."""
        return f"figure{self.number:02d}"


#: The paper's figures that are left out, and why.
LEFT_OUT = {
    12: "a photograph of the positioning table, which we do not have; `itouch-py inspect SCENE --picture FILE` draws "
    "ours",
    13: "a photograph of the whole device with a user; `itouch-py run SCENE --screenshot FILE` shows a session of ours",
}


def times(values: Array, period: float = PERIOD, begin: float = 0.0) -> Array:
    """Return the times [s] of values at the ends of periods, shape (rows,)."""
    return np.asarray(begin + np.arange(1, len(values) + 1) * period, dtype=np.float64)


def _lab(
    work: Work, names: tuple[str, ...], begin: float, model: Callable[[str], tuple[Array, Array]] | None = None
) -> tuple[Line, ...]:  # fmt: skip
    """Return a lab's curves of materials, dotted, and the model's flux out of the finger for comparison, dashed."""
    found = []
    for name, curve in work.curves.items():
        if name in names:
            at, flux = model(name) if model else (times(work.real(name).flux), work.real(name).flux)
            found.append(Line(f"{name}, measured", begin + curve.times, curve.fluxes, COLORS[name], ":", width=2.0))
            found.append(Line(f"{name}, out of finger", begin + at, flux, COLORS[name], "--", width=0.9))
    return tuple(found)


def _touches(work: Work, begin: float = 1.0) -> tuple[Line, ...]:
    found = []
    for name in MATERIALS:
        reading = work.real(name).reading
        at = np.concatenate(([0.0, begin], times(reading, begin=begin)))
        found.append(Line(name, at, np.concatenate(([0.0, 0.0], reading)), COLORS[name]))
    return tuple(found)


def figure2(work: Work) -> Figure:
    """Return figure 2: the flux of real touches through the film."""
    panel = Panel("Flux through the film on four materials", (*_touches(work), *_lab(work, MATERIALS, 1.0)))
    caption = "Flux through the film on four materials, simulated; the touch begins at 1 s."
    told = (
        "Simulated, not measured: nominal finger of three layers, no noise (dotted: a lab's curves, `--measured`, "
        "which are flux out of the finger; dashed beside them what the model has there).",
        f"The paper says neither its contact resistance nor its pressure: R = {work.setup.resistance:g} K m²/W, "
        f"pressed on within some {1e3 * work.setup.press:.0f} ms.",
        f"The sensor follows with a time constant of {1e3 * work.setup.lag:.0f} ms.",
    )
    return Figure(2, caption, told, (panel,))


def figure3(work: Work) -> Figure:
    """Return figure 3: the flux on an undriven plate at various start temperatures."""
    shades = ("#0b3c8c", "#2c7fb8", "#5aa6a0", "#6b6b6b", "#c98a1b", "#d1541f", "#8f1020")
    lines = []
    for k, offset in enumerate(OFFSETS):
        sensed = work.free(offset).sensed
        lines.append(Line(f"{offset:+d} K", times(sensed), sensed, shades[k], DASHES[k % len(DASHES)]))
    told = (
        "The paper's text does not state its temperatures: ours go from the coldest plate that is allowed, 15 °C.",
        "The current is cut when the finger touches; the sensor is read with its lag and noise.",
    )
    panel = Panel("Start temperatures relative to the room", tuple(lines))
    return Figure(3, "Flux on the module, its temperature set before the touch, no current in it.", told, (panel,))


def figure4(work: Work) -> Figure:
    """Return figure 4: the sensor's reading on the bare module after a step of current."""
    bare, touched = work.step(), work.step(touched=True)
    told = (
        "The sensor on the bare module sees only what the air brings (10 W/m²K) and what the film itself stores.",
        "Below, which is ours: the flux out of a finger that rests on the module, less that without current.",
        "1 A, a 40 mm module with 127 couples: the paper names neither.",
    )
    panels = (
        Panel("Sensor on the bare module, 1 A at 1 s", (Line("reading", times(bare), bare, "black"),)),
        Panel(
            "Ours: change under a resting finger",
            (Line("true flux", times(touched), touched, "black"),),
            left="change [W/m²]",
        ),
    )
    return Figure(4, "Step of the current through the module.", told, panels)


def _tracked(work: Work, title: str, name: str, run: Run, *, sensed: bool) -> Panel:
    at = times(run.flux)
    lines = (
        Line("obtained", at, run.sensed if sensed else run.flux, "black", width=0.9),
        Line("desired", at, run.desired, DESIRED[name], "--", width=1.4),
        Line("current", at, run.current, "#1a7f37", right=True, column="i [A]", width=0.7),
    )
    return Panel(title, (*lines, *(_lab(work, (name,), 0.0) if sensed else ())))


def tracking(number: int, name: str) -> Callable[[Work], Figure]:
    """Return the function that makes the figure of a material's replay."""

    def figure(work: Work) -> Figure:
        start = work.setup.start(name) - 273.15
        real, run = work.real(name), work.published(name)
        told = (
            f"Above as in the paper: desired is what the film on {name} recorded (figure 2), obtained is what the film "
            f"on the module reads; start by eq. 3 at {start:.2f} °C, then PI.",
            f"The true flux begins at {run.flux[19] / real.flux[19]:.2f} of the real one (at 20 ms): eq. 3 "
            f"knows no contact resistance, ours is {work.setup.resistance:g} K m²/W.",
            "The paper does not state its gains: ours are the best pair of `itouch-py bench display --grid`; plate and "
            "module keep the limits of our safety.",
            "Below, which is ours: desired is the bare object's flux without a film, obtained the true flux.",
        )
        panels = (
            _tracked(work, f"{name}: eq. 3 + PI on the recorded flux", name, run, sensed=True),
            _tracked(work, f"{name}: ours, without a recording", name, work.ours(name), sensed=False),
        )
        return Figure(number, f"Flux tracking of {name}: desired, obtained, current.", told, panels)

    return figure


def parts(work: Work, name: str = "wood", resistance: float | None = None, step: float = COARSE) -> tuple[Array, ...]:
    """Return times [s], total flux, problem 1 and problem 2 [W/m2] of the paper's decomposition, with the film."""
    from contact_heat.differences import solve_differences
    from itouch_thermal.paper.setup import finger

    at: Array = np.arange(1, round(work.setup.seconds / step) + 1, dtype=np.float64) * step
    of = work.setup.resistance if resistance is None else resistance
    body = sample(name, work.setup.film)
    whole = solve_differences(Contact(finger=finger(), object=body, resistance=of), at, spacing=SPACING).flux
    first = halfspaces(at, of, FINGER[0].effusivity, body.layers[0].effusivity)
    return at, whole, first, whole - first


def figure9(work: Work) -> Figure:
    """Return figure 9: the decomposition of a contact."""
    at, whole, first, second = parts(work)
    lines = (
        Line("whole", at, whole, "black"),
        Line("problem 1", at, first, "#00758f", "--"),
        Line("problem 2", at, second, "#b8327a", "-."),
    )
    told = (
        "Problem 1 is the exact flux of skin and film as half-spaces through R, not the constant flux of eq. 9: it "
        "stays right for longer; problem 2 is what finger, film and sample make of it.",
    )
    return Figure(
        9,
        "A contact with wood under the film, split into two problems.",
        told,
        (Panel("Wood under the film: whole = 1 + 2", lines, logarithmic=True),),
    )


def figure11(work: Work) -> Figure:
    """Return figure 11: the fluxes simulated by the paper's own scheme, with figure 2 for comparison."""
    lines = []
    for name in MATERIALS:
        at, flux = work.scheme(name)
        lines.append(
            Line(name, np.concatenate(([0.0, 1.0], 1.0 + at)), np.concatenate(([0.0, 0.0], flux)), COLORS[name])
        )
    told = (
        "By eqs 4 to 10 with the sensor's layer; eq. 10 with problem 1's temperatures in it (as printed they are "
        "missing).",
        "The contact closes at once; in figure 2 below the finger is pressed on. What is below is simulated, too, by "
        "our "
        "exact solver: the two agree as computations, which says nothing of a real finger.",
    )
    panels = (
        Panel("Figure 11: simulated by eqs 4 to 10", (*lines, *_lab(work, MATERIALS, 1.0, work.scheme_flux))),
        Panel("Figure 2 beside it", _touches(work)),
    )
    return Figure(11, "Flux of the four materials as simulated, with the sensor, and figure 2 beside.", told, panels)


def _drawn(number: int, caption: str, *told: str) -> Callable[[Work], Figure]:
    return lambda work: Figure(number, caption, told)


#: The function that makes each figure, by its number.
FIGURES: dict[int, Callable[[Work], Figure]] = {
    1: _drawn(1, "Set-up of a real touch: sample, film, finger and force "
                 "sensor.", "A sketch: the paper has a photograph."),
    2: figure2,
    3: figure3,
    4: figure4,
    5: tracking(5, "aluminium"),
    6: tracking(6, "wood"),
    7: tracking(7, "polystyrene"),
    8: _drawn(
        8,
        "The contact system that is modelled.",
        "Our finger has dermis and subcutis with blood below the paper's epidermis; the paper states those of "
        "the epidermis only.",
    ),
    9: figure9,
    10: _drawn(
        10,
        "What the simulation computes in each step.",
        "The paper's loop. Our own solver steps modes of both sides instead (`itouch-py thermal solve --live`).",
    ),
    11: figure11,
}  # fmt: skip


def left_out(folder: Path, figures: Iterable[int]) -> list[str]:
    """Return messages on what is not shown: files of other names, or everything if none of the figures shows curves."""
    others = sorted(path.name for path in folder.glob("*.csv") if path.stem not in MATERIALS)
    said = [f"--measured: the paper has no {', '.join(others)}; shown are {', '.join(MATERIALS)}"] if others else []
    if not SHOWN.intersection(figures):
        said.append(f"--measured: curves are laid over figures {', '.join(map(str, sorted(SHOWN)))} only")
    return said


def read_curves(folder: Path) -> dict[str, Curve]:
    """Return the curves in a folder whose files are named after a material, such as ``wood.csv``.

    Raises
    ------
    ValueError
        If there is no such folder or file (the message names those expected), or a file is not a curve (with its line).
    """
    wanted = ", ".join(f"{name}.csv" for name in MATERIALS)
    if not folder.is_dir():
        raise ValueError(f"--measured '{folder}' is not a folder; it should hold one or more of {wanted}")
    found: dict[str, Curve] = {}
    for name in MATERIALS:
        path = folder / f"{name}.csv"
        if path.is_file():
            with path.open("rb") as stream:
                data = stream.read(LARGEST_FILE + 1)
            if len(data) > LARGEST_FILE:
                raise ValueError(f"'{path}' is larger than {LARGEST_FILE >> 20} MiB")
            found[name] = decode_curve(data, str(path))
    if not found:
        raise ValueError(f"--measured '{folder}' holds none of {wanted}")
    return found
