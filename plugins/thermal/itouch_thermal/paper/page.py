"""``claims.md``: the set-up, the differences from the paper, the claims with their verdicts, and the figures."""

from __future__ import annotations

from collections.abc import Sequence

from itouch_thermal.paper.claim import VERDICTS, Claim
from itouch_thermal.paper.figures import LEFT_OUT, Figure
from itouch_thermal.paper.setup import Setup

#: The module of figures 3 to 7.
_MODULE = Setup().module

INTRODUCTION = (
    "Made by `itouch-py reproduce`.  The figures have the paper's numbers, quantities and set-ups; where we do "
    "otherwise, "
    "it stands under the figure, and our own method is beside the paper's, never in its place.  The paper's pictures "
    "were "
    "not at hand: nothing in ours is taken from them.  All touches are simulated unless a lab's curves are laid over "
    "them "
    "(`--measured FOLDER`, dotted; dashed the model's flux out of the finger, which they show)."
)

#: The paper's set-up as far as it is stated, and what represents it here.
DIFFERENCES: tuple[tuple[str, str, str], ...] = (
    ("finger", "people's; epidermis 0.7 mm, blood; nothing else stated", "three layers: epidermis 0.7 mm, "
     "dermis 1.5 mm, subcutis 4.4 mm; blood 5 kW/m³K below the epidermis; core 37 °C"),
    ("skin, room", "not stated", "33 °C, 23 °C"),
    ("samples", "aluminium, pyrex, wood, polystyrene; sizes not stated", "20 mm of each, air behind"),
    ("wood", "ρ 2720, c 415: swapped", "ρ 415, c 2720; only their product matters"),
    ("flux film", "15e-6 K m²/W; k 2.5, c 385, ρ 8933", "the same, so 37.5 µm thick"),
    ("sensor's dynamics", "not stated", "first order, 50 ms; 20 W/m² rms of noise on the module, none on the samples"),
    ("contact resistance", "R_th, not stated", "0.002 K m²/W; 1e-4 where a row says so"),
    ("pressure", "the same for all, by an FSR below the sample; not stated", "R falls to its value with a time "
     "constant of 50 ms, in figure 11 at once"),
    ("contact area", "a fingertip, size not stated", f"on the samples one dimension; on the module "
     f"{1e4 * _MODULE.contact_area:g} cm² at 1 N of its {1e4 * _MODULE.area:g} cm², heat spreads beside it"),
    ("flux film's area", "not stated", f"{1e4 * _MODULE.sensor_area:g} cm² in the middle under the finger"),
    ("module", "Peltier module with ceramic, not named", "40 mm, 127 couples, 6.4 A, 0.8 mm alumina, sink 0.5 K/W"),
    ("current", "custom card, not stated", "16 bit over both signs, 20 ms from command to current"),
    ("β_p of eq. 3", "of the module", "of its ceramic, 9502 W s½/m²K; the film above it is left out, as in the paper"),
    ("loop", "closed loop, gains and rate not stated", "PI, 40 and 800 1/s, 1 kHz; the integral begins at the flux "
        "before"),
    ("limits", "not stated", "plate 15 to 40 °C and 10 K/s, 35 kW/m²"),
    ("length of a touch", "not stated in the text", "10 s; `--seconds 4` shows 4 s"),
    ("problem 1 with R", "constant flux, eq. 9", "two half-spaces joined by R: exact for longer"),
    ("eq. 10", "without T₁", "with T₁"),
    ("arm", "Phantom Omni", "Novint Falcon's twin; `openhaptics` drives an Omni"),
    ("table", "µ-haptic, x y z", "an x y z table's twin"),
    ("materials' fluxes", "computed before the session", "computed while it is touched, for the skin as it is"),
)  # fmt: skip

#: What the paper's text has wrong or leaves open, and how it is read here.
READ_AS = (
    "Equation 7: `T_s0` must be the contact temperature.",
    "Equation 9: `j_1` is `j_contact`, and j is the flux into the body; for the finger it is -j.",
    "Equation 10 leaves out problem 1's temperatures: as printed its flux never falls.",
    "Equation 2 counts flux into the finger, equation 8 out of it: here flux out of the finger is positive.",
    "Wood's density and specific heat are swapped; only their product enters.",
    "Equation 4: the blood's flow is a mass per volume and time.",
    "15e-6 K m²/W may be a misprint: usual foil gauges have ten times as much.",
)


def page(claims: Sequence[Claim], figures: Sequence[Figure]) -> str:
    """Return the page as Markdown."""
    lines = ["# The paper's figures and claims", "", INTRODUCTION, ""]
    lines += ["## What is otherwise than in the paper", "", "| what | paper | here |", "|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in DIFFERENCES]
    lines += ["", "What the text leaves open, and how it is read here:", "", *(f"* {text}" for text in READ_AS)]
    counts = {verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS}
    lines += ["", "## Claims", "", ", ".join(f"{n} {verdict}" for verdict, n in counts.items()) + ".  "]
    lines[-1] += "A claim holds where every number is within its bound, partly where some are."
    lines += ["", "| place | claim | our set-up | measured | bound | verdict |", "|---|---|---|---|---|---|"]
    lines += [claim.row() for claim in claims]
    lines += ["", "## Figures"]
    for figure in figures:
        lines += ["", f"![{figure.caption}]({figure.stem}.png)", "", f"Figure {figure.number}. {figure.caption}", ""]
        lines += [f"* {told}" for told in figure.differences]
    lines += ["", "Left out:", "", *(f"* Figure {number}: {why}." for number, why in LEFT_OUT.items())]
    return "\n".join(lines) + "\n"
