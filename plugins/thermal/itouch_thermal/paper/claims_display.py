"""Claims of sections II-C, II-D, IV and V: the display, its loop, and the whole system."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from itouch.plugin.commands import framework
from itouch_thermal.display.column import plate_capacity
from itouch_thermal.flux.limits import BAND
from itouch_thermal.paper.claim import Check, Claim, Maker, over
from itouch_thermal.paper.claims_touch import INF, TIGHT, at
from itouch_thermal.paper.setup import MATERIALS
from itouch_thermal.paper.work import Work
from itouch_thermal.rendering.closedloop import PERIOD, Case, Run, desired_course
from itouch_thermal.rendering.materials import material
from itouch_thermal.rendering.score import FLOOR, WEBER

#: Materials whose replay the paper shows.
TRACKED = ("aluminium", "wood", "polystyrene")


def tracking_error(run: Run) -> float:
    """Return the rms difference of reading and desired flux from 0.1 s on, relative to max(|desired|, 200 W/m2) [%]."""
    apart = (run.sensed - run.desired)[99:] / np.maximum(np.abs(run.desired[99:]), FLOOR)
    return 100.0 * math.sqrt(float(apart @ apart) / len(apart))


def start_temperatures(work: Work) -> Claim:
    """Check: equation 3 gives a start temperature for every material."""
    low, high = (edge - 273.15 for edge in BAND)
    checks = over(MATERIALS, lambda n: work.setup.wanted(n) - 273.15, low, high, " °C")
    return Claim("II-C", "Setting the module's start temperature by eq. 3 could render every material",
                 "within what the display may have", checks)  # fmt: skip


def amplitudes(work: Work) -> Claim:
    """Check: curves differ in amplitude, not in shape."""
    shapes = [at(work.free(k).sensed, 3.0) / at(work.free(k).sensed, 0.5) for k in (-8, 0)]
    real = {n: at(work.real(n).reading, 3.0) / at(work.real(n).reading, 0.5) for n in MATERIALS}
    checks = (
        Check("cold plate over plate at the room's", shapes[0] / shapes[1], 0.85, 1.18),
        Check("polystyrene over plate at the room's", real["polystyrene"] / shapes[1], -INF, 0.8),
        Check("wood over plate at the room's", real["wood"] / shapes[1], -INF, 0.8),
    )
    return Claim("II-C, fig. 3", "The curves on the module differ in amplitude, not in shape, and insulators' shapes "
                                 "are not among them",
                 "j(3 s)/j(0.5 s) read by the film, plate free", checks)  # fmt: skip


def slow_module(work: Work) -> Claim:
    """Check: the module is slow."""
    step = work.step(touched=True)
    begin = round(1.0 / PERIOD)
    checks = tuple(
        Check(f"at {t:g} s", 100.0 * float(step[begin + round(t / PERIOD)] / step[-1]), -INF, high, " %")
        for t, high in ((0.1, 10.0), (1.0, 50.0))
    )
    return Claim("II-D, fig. 4", "The module has a large thermal inertia: too slow for a simple loop",
                 "part of the flux after 20 s, under a resting finger, 1 A", checks)  # fmt: skip


def initial_flow(work: Work) -> Claim:
    """Check: the initial flux is like the real one."""
    checks = over(TRACKED, lambda n: at(work.published(n).flux, 0.02) / at(work.real(n).flux, 0.02), 0.8, 1.25, "")
    return Claim("II-D", "By eq. 3 the initial rendered flow is similar to the real one",
                 f"true flux over the real one 20 ms after the touch, R = {work.setup.resistance:g}", checks,
                 "eq. 3 knows no contact resistance: with one the plate starts too warm for insulators")  # fmt: skip


def far_better(work: Work) -> Claim:
    """Check: the loop is far better than the analytic model alone."""
    checks = over(TRACKED, lambda n: tracking_error(work.open(n)) / tracking_error(work.published(n)), 2.0, INF, "")
    return Claim("II-D", "The corrected flow is far better than with the analytic model alone",
                 "rms of the open loop over that of the closed one", checks)  # fmt: skip


def follows(name: str) -> Maker:
    """Return the function that checks the replay of a material."""

    def claim(work: Work) -> Claim:
        error = tracking_error(work.published(name))
        figure = {"aluminium": 5, "wood": 6, "polystyrene": 7}[name]
        return Claim(f"II-D, fig. {figure}", f"Closed loop and eq. 3 come quite close to the real flow of {name}",
                     "rms of reading less recorded flux, 0.1 s to the end, of max(flux, 200 W/m²)",
                     (Check("rms", error, -INF, 10.0, " %"),),
                     f"ours: {tracking_error_true(work.ours(name)):.2f} % of the true flux, without a "
                     f"recording")  # fmt: skip

    return claim


def tracking_error_true(run: Run) -> float:
    """Return the same error for the true flux [%]."""
    apart = (run.flux - run.desired)[99:] / np.maximum(np.abs(run.desired[99:]), FLOOR)
    return 100.0 * math.sqrt(float(apart @ apart) / len(apart))


def oscillates(work: Work) -> Claim:
    """Check: the loop oscillates for insulators."""
    metal, foam = (tracking_error(work.published(n)) for n in ("aluminium", "polystyrene"))
    tight = tracking_error(work.published("polystyrene", TIGHT))
    checks = (
        Check("polystyrene over aluminium", foam / metal, 2.0, INF),
        Check("polystyrene at R = 1e-4, rms", tight, 25.0, INF, " %"),
    )
    return Claim("VI", "The response oscillates for very insulating materials", "published loop, same gains", checks)


def switching(work: Work) -> Claim:
    """Check: materials must not be switched too fast."""
    display = work.setup.module
    warm, cold = work.setup.start("polystyrene"), work.setup.start("aluminium")
    needed = plate_capacity(display.plate) * abs(warm - cold) / display.flux_limit
    return Claim("V", "The finger should not switch too fast between materials",
                 "least time from aluminium to polystyrene, of the plate's heat alone",
                 (Check("time", needed, 0.3, INF, " s"),))  # fmt: skip


def confused(work: Work) -> Claim:
    """Check: wood and plastic are confused."""
    flux = {n: float(desired_course(Case(material(n)[1])).flux[999]) for n in (*MATERIALS, "PMMA")}
    checks = (Check("PMMA over wood", flux["PMMA"] / flux["wood"], 1.0 / (1.0 + WEBER), 1.0 + WEBER),)
    return Claim("V", "There was often confusion between wood and plastic", "flux at 1 s; a Weber fraction of "
        "0.43", checks,
                 "confusions between materials need participants: `itouch-py study run`")  # fmt: skip


def told_apart(work: Work) -> Claim:
    """Check: most materials can be told apart."""
    flux = [float(desired_course(Case(material(n)[1])).flux[999]) for n in MATERIALS]
    ratios = [a / b for k, a in enumerate(flux) for b in flux[k + 1 :]]
    part = 100.0 * sum(ratio > 1.0 + WEBER for ratio in ratios) / len(ratios)
    return Claim("V", "Most materials could be detected", "pairs of the four whose fluxes at 1 s differ by more than "
        "43 %",
                 (Check("pairs", part, 50.0, INF, " %"),), "an estimate, no panel")  # fmt: skip


def two_days(_work: Work) -> Claim:
    """Check: integrating a device takes two days."""
    return Claim("IV", "The integration of the table took no more than two days", "-", (),
                 "nobody has been timed; `itouch-py new-plugin` writes a device with its twin and tests")  # fmt: skip


DISPLAY: tuple[Maker, ...] = (
    start_temperatures, amplitudes, slow_module, initial_flow, far_better, *map(follows, TRACKED), oscillates,
    switching, confused, told_apart, two_days,
)  # fmt: skip


def session_claims(report: dict[str, Any] | None) -> list[Claim]:
    """Return the claims of section V that a session with the four materials shows; unchecked without a report."""
    where = "`scenes/four_materials.xml` on twins"
    contacts = [] if report is None else [c for c in report["contacts"] if c["end_s"] is not None]
    table = {} if report is None else report["table"]

    def row(words: str, *checks: Check, note: str = "") -> Claim:
        return Claim("V", words, where, checks if report is not None else (), note)

    seen = {c["material"] for c in contacts}
    leads = [abs(c["plate_lead_ms"]) for c in contacts if c["plate_lead_ms"] is not None]
    gaps = [c["plate_gap_mm"] for c in contacts if c["plate_gap_mm"] is not None]
    rendered = sum(c["mean_flux_W_m2"] is not None for c in contacts)
    missing = float("nan")
    return [
        row("Different thermal characteristics are used by the finger's position",
            Check("materials met of four", float(len(seen & set(MATERIALS))), 4.0, INF)),
        row("The thermal rendering is triggered by the contact",
            Check("contacts with heat", float(rendered), float(max(1, len(contacts))), INF),
            Check("plate and object apart by", max(leads, default=missing), -INF, 20.0, " ms")),
        row("The table is always just below the finger and tracks it",
            Check("tracking, 99 %", table.get("tracking_mm", {}).get("p99", missing), -INF, 1.0, " mm"),
            Check("plate off the object at a touch", max(map(abs, gaps), default=missing), -INF, 0.5, " mm")),
        row("The positions of the objects are accurate",
            Check("greatest error of height", table.get("height_error_mm_max", missing), -INF, 0.1, " mm")),
        row("The responsiveness is enough for real-time tracking",
            Check("a tick, median", missing if report is None else report["servo"]["tick_us"]["p50"], -INF,
                  1e6 / (1.0 if report is None else report["servo"]["rate_hz"]), " µs"),
            note="of this machine, on twins"),
    ]  # fmt: skip


def session_report() -> dict[str, Any] | None:
    """Return the report of a session of the shipped four materials; None if they are not installed."""
    import tempfile
    from pathlib import Path

    itouch = framework()
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "four_materials.xml"
        scene.write_text('<itouch version="1.0"><include file="itouch:four_materials.xml"/></itouch>', encoding="utf-8")
        try:
            session = itouch.build(str(scene))
        except itouch.ItouchError:
            return None
        with session:
            session.run()
            found: dict[str, Any] = session.report()
    return found
