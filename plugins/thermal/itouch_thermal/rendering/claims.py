"""Every checkable claim of the paper's sections II and V, with a number computed here and a verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from itouch_thermal.display.column import Array, plate_capacity
from itouch_thermal.display.params import ALUMINA, DisplayParams
from itouch_thermal.flux.start import equation_three
from itouch_thermal.heat import FINGER
from itouch_thermal.rendering.closedloop import AMBIENT, PERIOD, Case, desired_course
from itouch_thermal.rendering.figures import PAPER, SKIN, finger, halfspaces, rendered, tem_step, touch
from itouch_thermal.rendering.materials import material
from itouch_thermal.rendering.score import rms
from itouch_thermal.solver.layers import Contact

INTRODUCTION = (
    "The claims are those of sections II and V of the I-Touch thermal display paper, in our words, with our numbers: "
    "a finger of three layers at 33 degC, objects of 20 mm at 23 degC.  Some hold only with the paper's flux film "
    "between finger and object, or only without a contact resistance.  The paper's own pictures were not at hand: "
    "the figures have its quantities in its order, and nothing in them is taken from it."
)
#: Effusivity of the paper's aluminium.
ALUMINIUM = material("aluminium")[1].effusivity


class Claim(NamedTuple):
    """A claim in our words, our number, and the verdict."""

    claim: str
    number: str
    verdict: str


def claims() -> Iterator[Claim]:
    """Compute the claims one by one."""
    film = {n: touch(n, films=1, resistance=1e-4, seconds=10.0) for n in PAPER}
    bare = {n: touch(n, resistance=1e-4, seconds=10.0) for n in PAPER}
    yield from _flux(film, bare)
    yield from _model(bare)
    yield from _display()


def _at(flux: Array, time: float) -> float:
    return float(flux[round(time / PERIOD) - 1])


def _flux(film: dict[str, Array], bare: dict[str, Array]) -> Iterator[Claim]:
    late = {n: flux[99:] for n, flux in film.items()}
    ordered = all(np.all(late[a] > late[b]) for a, b in zip(PAPER, PAPER[1:], strict=False))
    yield Claim("The flux falls in the order aluminium, pyrex, wood, polystyrene", f"from 0.1 s on: {ordered}", "true")
    yield Claim(
        "The flux first rises quickly, then falls",
        f"aluminium at 1 and 10 ms: {_at(bare['aluminium'], 1e-3):.0f}, {_at(bare['aluminium'], 1e-2):.0f} W/m2",
        "only through a sensor or while the finger is pressed on: the contact's own flux is greatest at once",
    )
    ratio = {n: _at(f, 1.0) / _at(f, 0.1) for n, f in film.items()}
    ideal = {n: _at(f, 1.0) / _at(f, 0.1) for n, f in bare.items()}
    yield Claim(
        "The more insulating the material, the faster the flux falls",
        "j(1 s)/j(0.1 s) with film " + _four(ratio, 3) + "; without " + _four(ideal, 3),
        "true with the film on the material, not for the bare bodies",
    )
    early = {n: _at(f, 1e-3) for n, f in film.items()}
    yield Claim(
        "First the object's temperature is felt, then its material",
        "at 1 ms with film " + _four(early, 0) + " W/m2", "true with the film: at first all materials agree",
    )  # fmt: skip
    change = {n: 100.0 * (_at(film[n], 1.0) / _at(bare[n], 1.0) - 1.0) for n in PAPER}
    yield Claim(
        "The sensor hardly disturbs the measurement", "change of j(1 s) in % " + _four(change, 1),
        "true for metal and glass, false for foam",
    )  # fmt: skip
    twice = {n: touch(n, films=2, resistance=1e-4, seconds=1.0) for n in PAPER}
    change = {n: 100.0 * (_at(twice[n], 0.1) / _at(film[n], 0.1) - 1.0) for n in PAPER}
    yield Claim(
        "A second sensor on top of the first shows that", "change of j(0.1 s) in % by the second " + _four(change, 1),
        "true for metal and glass, false for foam",
    )  # fmt: skip
    thick = [_at(touch("polystyrene", films=films, resistance=1e-4, seconds=1.0), 1.0) for films in (1.0, 400 / 37.5)]
    yield Claim(
        "The film resists by 15e-6 K m2/W at 2.5 W/mK",
        f"37.5 um; with usual foil gauges' 400 um j(1 s) on polystyrene is {thick[1] / thick[0]:.1f} times as much",
        "perhaps a misprint: the thickness is a parameter here",
    )


def _model(bare: dict[str, Array]) -> Iterator[Claim]:
    from itouch_thermal.solver.stepper import Stepper

    ours = FINGER[0].effusivity
    other = material("wood")[1].effusivity
    whole = touch("wood", resistance=0.0, seconds=10.0)
    simple = [(SKIN - AMBIENT) / (1 / ours + 1 / other) / math.sqrt(math.pi * t) for t in (0.1, 1.0, 10.0)]
    away = [100.0 * (s / _at(whole, t) - 1.0) for s, t in zip(simple, (0.1, 1.0, 10.0), strict=True)]
    yield Claim(
        "The semi-infinite model is good for the first second only",
        f"eq. 2 on wood without resistance, at 0.1, 1, 10 s: {away[0]:+.1f}, {away[1]:+.1f}, {away[2]:+.1f} %",
        "true without a contact resistance",
    )
    real = [(SKIN - AMBIENT) / (1 / ours + 1 / ALUMINIUM) / math.sqrt(math.pi * t) for t in (1e-3, 1e-2, 0.1)]
    over = [100.0 * (s / _at(bare["aluminium"], t) - 1.0) for s, t in zip(real, (1e-3, 1e-2, 0.1), strict=True)]
    yield Claim(
        "The same, with a contact resistance of 1e-4 K m2/W",
        f"eq. 2 on aluminium at 1, 10, 100 ms: {over[0]:+.0f}, {over[1]:+.0f}, {over[2]:+.0f} %",
        "false: the resistance breaks it first, in the first milliseconds",
    )
    halves = halfspaces((0.1, 1.0), 1e-4, "wood")
    apart = [100.0 * (h / _at(bare["wood"], t) - 1.0) for h, t in zip(halves, (0.1, 1.0), strict=True)]
    yield Claim(
        "A constant flux at first (eq. 9), then eq. 10, solve the contact with a resistance",
        f"dT/R exp(h2t) erfc(h sqrt t) instead is off by {apart[0]:+.1f} % at 0.1 s, {apart[1]:+.1f} % at 1 s on wood",
        "as printed eq. 10 leaves T1 out and its flux never falls; with T1 in it, true",
    )
    body = Case(material("aluminium")[1])
    from itouch_thermal.heat import object_side

    side = object_side(body.material, AMBIENT, 0.02)
    if side is not None:
        runs = [Stepper(Contact(finger=finger(p), object=side), PERIOD).advance(2e-3, 10000) for p in (1.0, 0.0, 10.0)]
        moved = [[100.0 * (_at(run, t) / _at(runs[0], t) - 1.0) for t in (1.0, 10.0)] for run in runs[1:]]
        yield Claim(
            "Blood flow does not matter in the transient",
            f"without it the flux on aluminium changes by {moved[0][0]:+.2f} % at 1 s, {moved[0][1]:+.2f} % at 10 s; "
            f"with ten times as much by {moved[1][0]:+.2f} and {moved[1][1]:+.2f} %", "true for seconds",
        )  # fmt: skip
    slow = touch("aluminium", resistance=1e-4, seconds=1000.0, period=0.01)
    yield Claim(
        "Steady-state models come near only after about 100 s",
        f"aluminium, flux at 1, 10, 100 s over that at 1000 s: {slow[99] / slow[-1]:.1f}, {slow[999] / slow[-1]:.1f}, "
        f"{slow[9999] / slow[-1]:.1f}", "true, and even at 100 s they are far off",
    )  # fmt: skip
    yield Claim(
        "The sensation is gone after some tens of seconds",
        f"aluminium, j(30 s)/j(1 s) = {slow[2999] / slow[99]:.2f}", "true of the flux",
    )  # fmt: skip


def _display() -> Iterator[Claim]:
    beta = {n: material(n)[1].effusivity for n in PAPER}
    start = {
        n: equation_three(b, ALUMINA.effusivity, FINGER[0].effusivity, AMBIENT, SKIN) - 273.15 for n, b in beta.items()
    }
    ours = {n: float(rendered(n, "model", seconds=0.5).start) - 273.15 for n in PAPER}
    yield Claim(
        "Equation 3 gives every material its plate temperature",
        _four(start, 2) + " degC; with R = 0.002 K m2/W " + _four(ours, 2) + " degC do better", "true for R = 0",
    )  # fmt: skip
    held = rendered("polystyrene", "hold")
    parts = [held.flux[round(t / PERIOD) - 1] / held.desired[round(t / PERIOD) - 1] for t in (0.1, 1.0, 10.0)]
    yield Claim(
        "One plate at various temperatures is not various materials",
        f"polystyrene, plate held: obtained / desired at 0.1, 1, 10 s {parts[0]:.2f}, {parts[1]:.2f}, {parts[2]:.2f}",
        "true: the shapes differ, the loop must be closed",
    )
    step = tem_step()
    begin = round(1.0 / PERIOD)
    per = [100.0 * step[begin + round(t / PERIOD)] / step[-1] for t in (0.01, 0.1, 1.0, 10.0)]
    yield Claim(
        "The module is too slow for a simple loop",
        f"of its flux after 20 s, at 10 ms, 0.1, 1, 10 s: {per[0]:.1f}, {per[1]:.1f}, {per[2]:.0f}, {per[3]:.0f} %",
        "true",
    )  # fmt: skip
    for name in ("aluminium", "wood", "polystyrene"):
        figures = [rms(rendered(name, controller)) for controller in ("paper", "model")]
        yield Claim(
            f"Closed loop and start temperature follow {name}",
            f"rms 0.1-10 s: as published {figures[0]:.2f} %, model {figures[1]:.2f} %", "true",
        )  # fmt: skip
    bad = rms(rendered("polystyrene", "paper", resistance=1e-4))
    good = rms(rendered("polystyrene", "model", resistance=1e-4))
    yield Claim(
        "It oscillates on very insulating materials",
        f"polystyrene at R = 1e-4, same gains: as published {bad:.0f} % rms, model {good:.2f} %", "true of the PI loop",
    )  # fmt: skip
    display = DisplayParams()
    time = plate_capacity(display.plate) * abs(start["polystyrene"] - start["aluminium"]) / display.flux_limit
    yield Claim(
        "The finger must not change materials too fast",
        f"heat alone takes {time:.2f} s from aluminium to polystyrene at the greatest flux", "true",
    )  # fmt: skip
    case = Case(material("PMMA")[1])
    plastic, wood = (float(desired_course(Case(material(n)[1])).flux[999]) for n in ("PMMA", "wood"))
    yield Claim(
        "Wood and plastic are confused",
        f"flux at 1 s: PMMA {plastic:.0f}, wood {wood:.0f} W/m2, {100 * (plastic / wood - 1):.0f} % apart; "
        f"effusivities {case.material.effusivity:.0f} and {beta['wood']:.0f}",
        "plausible: less than the Weber fraction of 43 % apart",
    )


def _four(values: dict[str, float], digits: int) -> str:
    return ", ".join(f"{name} {value:.{digits}f}" for name, value in values.items())


def page(figures: list[tuple[str, str]]) -> str:
    """Return ``claims.md``."""
    lines = ["# The paper's claims and figures, recomputed", "", "Made by `itouch-py reproduce`.  " + INTRODUCTION, ""]
    lines += ["| claim | our number | verdict |", "|---|---|---|"]
    lines += [f"| {c.claim} | {c.number} | {c.verdict} |" for c in claims()]
    for stem, caption in figures:
        lines += [
            "",
            f"![{caption}]({stem}.png)",
            "",
            f"{stem.replace('figure0', 'Figure ').replace('figure', 'Figure ')}. {caption}",
        ]
    return "\n".join(lines) + "\n"
