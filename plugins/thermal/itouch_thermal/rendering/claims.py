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
from itouch_thermal.rendering.figures import PAPER, SKIN, finger, rendered, tem_step, touch
from itouch_thermal.rendering.materials import material
from itouch_thermal.rendering.score import rms
from itouch_thermal.solver.layers import Contact


class Claim(NamedTuple):
    """A claim in our words, our number, and the verdict."""

    claim: str
    number: str
    verdict: str


def claims() -> Iterator[Claim]:
    """Compute the claims one by one."""
    film = {n: touch(n, film=True, resistance=1e-4, seconds=10.0) for n in PAPER}
    bare = {n: touch(n, film=False, resistance=1e-4, seconds=10.0) for n in PAPER}
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


def _model(bare: dict[str, Array]) -> Iterator[Claim]:
    from itouch_thermal.solver.stepper import Stepper

    ours = FINGER[0].effusivity
    other = material("wood")[1].effusivity
    whole = touch("wood", film=False, resistance=0.0, seconds=10.0)
    simple = [(SKIN - AMBIENT) / (1 / ours + 1 / other) / math.sqrt(math.pi * t) for t in (0.1, 1.0, 10.0)]
    away = [100.0 * (s / _at(whole, t) - 1.0) for s, t in zip(simple, (0.1, 1.0, 10.0), strict=True)]
    yield Claim(
        "The semi-infinite model is good for the first second only",
        f"eq. 2 on wood without resistance, at 0.1, 1, 10 s: {away[0]:+.1f}, {away[1]:+.1f}, {away[2]:+.1f} %",
        "true without a contact resistance; with one, eq. 2 fails in the first milliseconds already",
    )
    body = Case(material("aluminium")[1])
    from itouch_thermal.heat import object_side

    side = object_side(body.material, AMBIENT, 0.02)
    if side is not None:
        dry = Stepper(Contact(finger=finger(0.0), object=side), PERIOD).advance(2e-3, 10000)
        wet = Stepper(Contact(finger=finger(), object=side), PERIOD).advance(2e-3, 10000)
        yield Claim(
            "Blood flow does not matter in the transient",
            f"without it the flux on aluminium changes by {100 * (_at(dry, 1.0) / _at(wet, 1.0) - 1):+.2f} % at 1 s, "
            f"{100 * (_at(dry, 10.0) / _at(wet, 10.0) - 1):+.2f} % at 10 s", "true for seconds",
        )  # fmt: skip
    slow = touch("aluminium", film=False, resistance=1e-4, seconds=1000.0, period=0.01)
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
    yield Claim("Equation 3 gives every material its plate temperature", _four(start, 2) + " degC", "true for R = 0")
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
    lines = ["# The paper's claims and figures, recomputed", "", "Made by `itouch-py reproduce`.", ""]
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
