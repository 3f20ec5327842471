"""Claims of sections II-A, II-B and II-E: real touches and their model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from contact_heat.contact import Contact
from itouch_thermal.display.column import Array
from itouch_thermal.heat import FINGER
from itouch_thermal.paper.claim import Check, Claim, Maker, over
from itouch_thermal.paper.figures import parts
from itouch_thermal.paper.setup import MATERIALS, SKIN, finger, halfspaces, measure, sample
from itouch_thermal.paper.work import COARSE, Work
from itouch_thermal.rendering.closedloop import AMBIENT, PERIOD, Case, desired_course
from itouch_thermal.rendering.materials import material

INF = float("inf")
#: A contact better than a finger's, with which the film's effect shows apart from the resistance [K m2/W].
TIGHT = 1e-4


def at(flux: Array, time: float, period: float = PERIOD) -> float:
    """Return the flux at a time [s].

    ``flux`` (steps,) [W/m2] begins at the end of the first ``period`` [s].
    """
    return float(flux[round(time / period) - 1])


def transient(work: Work) -> Claim:
    """Check: only the first seconds are pertinent."""
    slow = work.bare("aluminium", TIGHT, 1000.0, 0.01)
    checks = (Check("j(30 s)/j(1 s)", at(slow, 30.0, 0.01) / at(slow, 1.0, 0.01), 0.0, 0.25),)
    return Claim("II-A", "A few tens of seconds after the touch the thermal information is gone", "aluminium, R = 1e-4",
                 checks, "of the flux; what is felt is not computed")  # fmt: skip


def steady(work: Work) -> Claim:
    """Check: steady-state models converge after 100 s."""
    slow = work.bare("aluminium", TIGHT, 1000.0, 0.01)
    last = float(slow[-1])
    checks = (
        Check("j(10 s) over j(1000 s)", at(slow, 10.0, 0.01) / last, 2.0, INF),
        Check("j(100 s) over j(1000 s)", at(slow, 100.0, 0.01) / last, 0.5, 1.5),
    )
    return Claim(
        "II-A", "Steady-state models begin to converge only about 100 s after the touch", "aluminium, R = 1e-4", checks
    )


def small_sensor(work: Work) -> Claim:
    """Check: the sensor has a limited impact."""
    bare = {n: work.bare(n, TIGHT) for n in MATERIALS}
    checks = over(
        MATERIALS, lambda n: 100.0 * abs(at(work.filmed(n, TIGHT), 1.0) / at(bare[n], 1.0) - 1.0), -INF, 10.0, " %"
    )
    return Claim(
        "II-B", "The sensor has a limited impact on the flux", "change of j(1 s) by the film, R = 1e-4", checks
    )


def second_sensor(work: Work) -> Claim:
    """Check: a second sensor interferes little."""
    one = {n: work.filmed(n, TIGHT) for n in MATERIALS}
    two = {n: work.filmed(n, TIGHT, 2.0, 1.0) for n in MATERIALS}
    checks = over(MATERIALS, lambda n: 100.0 * abs(at(two[n], 0.1) / at(one[n], 0.1) - 1.0), -INF, 10.0, " %")
    return Claim("II-B", "A second sensor on the first shows that it interferes little",
                 "change of j(0.1 s) by a second film, R = 1e-4", checks)  # fmt: skip


def pressure(work: Work) -> Claim:
    """Check: pressure plays an important role."""
    hard = measure("aluminium", replace(work.setup, resistance=0.5 * work.setup.resistance, seconds=1.0)).flux
    change = 100.0 * (at(hard, 1.0) / at(work.real("aluminium").flux, 1.0) - 1.0)
    return Claim("II-B", "The contact pressure plays an important role in the flux",
                 "aluminium, half the contact resistance, j(1 s)",
                 (Check("change", change, 10.0, INF, " %"),))  # fmt: skip


def rise(work: Work) -> Claim:
    """Check: the flux increases quickly, then decreases."""

    def peak(name: str) -> float:
        return float((np.argmax(work.real(name).reading) + 1) * PERIOD)

    falls = {n: float(work.real(n).reading[-1] / work.real(n).reading.max()) for n in MATERIALS}
    checks = (
        *over(MATERIALS, peak, 0.02, 0.5, " s to the peak"),
        *over(MATERIALS, lambda n: falls[n], -INF, 0.8, " of it at the end"),
    )
    return Claim("II-B", "In each case the flow increases quickly at first, then decreases",
                 "reading of the film, figure 2", checks,
                 "the contact's own flux is greatest at once where the finger is not pressed on")  # fmt: skip


def order(work: Work) -> Claim:
    """Check: the four materials are in order of conduction."""
    fluxes = [work.real(n).reading[299:] for n in MATERIALS]
    pairs = zip(MATERIALS, MATERIALS[1:], fluxes, fluxes[1:], strict=False)
    checks = tuple(Check(f"{a} over {b}", float((x / y).min()), 1.0, INF) for a, b, x, y in pairs)
    return Claim("II-B, fig. 2", "The better a material conducts, the greater the flux",
                 "least ratio of the readings from 0.3 s on", checks)  # fmt: skip


def faster(work: Work) -> Claim:
    """Check: the more insulating the material, the faster the flux falls."""
    part = {n: at(work.real(n).film, 2.0) / at(work.real(n).film, 0.3) for n in MATERIALS}
    checks = tuple(
        Check(f"{b} of {a}", part[b] / part[a], -INF, 0.95) for a, b in zip(MATERIALS, MATERIALS[1:], strict=False)
    )
    return Claim("II-B", "The more insulating the material, the faster the flow decreases",
                 "j(2 s)/j(0.3 s) through the film, of that of the next better conductor", checks,
                 "by film and contact resistance: bare bodies without them all fall alike")  # fmt: skip


def surface(work: Work) -> Claim:
    """Check: the reason is faster heating of the surface."""
    faces = {n: at(work.real(n).face, 1.0) - AMBIENT for n in MATERIALS}
    checks = tuple(
        Check(f"{b} over {a}", faces[b] / faces[a], 1.05, INF) for a, b in zip(MATERIALS, MATERIALS[1:], strict=False)
    )
    return Claim("II-B", "... due to quicker material surface heating", "rise of the face in 1 s", checks)


def correlated(work: Work) -> Claim:
    """Check: the finger's surface temperature is correlated with the flux."""
    courses = [desired_course(_case(work, name, 3.0)) for name in MATERIALS]

    def correlation(time: float) -> float:
        drops = [SKIN - at(course.skin, time) for course in courses]
        return float(np.corrcoef([at(course.flux, time) for course in courses], drops)[0, 1])

    checks = tuple(Check(f"at {t:g} s", correlation(t), 0.99, INF) for t in (0.3, 1.0, 3.0))
    return Claim("II-B", "The finger's surface temperature is completely correlated to the flow",
                 "correlation of flux and drop of the skin over the four bare materials", checks,
                 "within a touch the skin follows from all of the flux so far, not from the present one")  # fmt: skip


def temperatures(work: Work) -> Claim:
    """Check: other temperatures of material or finger change the flux, so that a recording is of little use."""
    case = _case(work, "aluminium", 1.0)
    plain = at(desired_course(case).flux, 1.0)
    others = {
        "aluminium 5 K warmer": replace(case, object_temperature=AMBIENT + 5.0),
        "skin 3 K colder": replace(case, skin=SKIN - 3.0),
    }

    def change(what: str) -> float:
        return 100.0 * abs(at(desired_course(others[what]).flux, 1.0) / plain - 1.0)

    checks = over(others, change, 10.0, INF, " %")
    return Claim("II-D", "The flow is modified by the temperatures of material and finger: a recording holds for its "
                 "own only", "change of j(1 s) on bare aluminium", checks)  # fmt: skip


def any_situation(work: Work) -> Claim:
    """Check: the model gives the flux at other temperatures without a measurement."""
    from contact_heat.differences import solve_differences
    from contact_heat.exact import solve

    when, checks = np.array([0.1, 1.0, 3.0]), []
    for name, room, skin in (("wood", 283.15, SKIN), ("wood", 313.15, SKIN), ("polystyrene", AMBIENT, SKIN - 3.0)):
        body = sample(name, work.setup.film, room)
        contact = Contact(finger=finger(skin=skin), object=body, resistance=work.setup.resistance)
        error = 100.0 * np.abs(solve_differences(contact, when).flux / solve(contact, when).flux - 1.0)
        what = f"{name} at {room - 273.15:.0f} °C, skin {skin - 273.15:.0f} °C"
        checks.append(Check(what, float(error.max()), -INF, 5.0, " %"))
    return Claim("II-E", "The model reproduces any thermal situation without measurements in the same conditions",
                 "eqs 4 to 10 at 0.1, 1, 3 s against the exact solution", tuple(checks),
                 "what the values from the literature are off by is not in it")  # fmt: skip


def _case(work: Work, name: str, seconds: float) -> Case:
    setup = work.setup
    return Case(material(name)[1], resistance=setup.resistance, press=setup.press, seconds=seconds)


def two_steps(work: Work) -> Claim:
    """Check: first the temperature is felt, then the material."""
    early = [at(work.filmed(n, TIGHT), 1e-3) for n in MATERIALS]
    late = [at(work.filmed(n, TIGHT), 1.0) for n in MATERIALS]
    checks = (
        Check("at 1 ms greatest over least", max(early) / min(early), 1.0, 1.1),
        Check("at 1 s", max(late) / min(late), 3.0, INF),
    )
    return Claim("II-B", "First the object's temperature is felt, then its material",
                 "flux on the four materials under the film, R = 1e-4", checks)  # fmt: skip


def wet(work: Work) -> Claim:
    """Check: the film's resistance."""
    at_one = at(work.filmed("polystyrene", TIGHT, 400 / 37.5, 1.0), 1.0) / at(work.filmed("polystyrene", TIGHT), 1.0)
    resist = work.setup.film / 2.5
    return Claim("II-B", "The film resists by 15e-6 K m²/W", "thickness over the 2.5 W/mK of section II-E",
                 (Check("resistance", 1e6 * resist, 14.0, 16.0, "e-6 K m²/W"),),
                 f"so it is 37.5 µm; a usual foil gauge of 400 µm would make j(1 s) on foam {at_one:.1f} times as "
                 f"much")  # fmt: skip


def accurate_model(work: Work) -> Claim:
    """Check: model and measurement agree."""
    found = []
    for name, curve in work.curves.items():
        if name in MATERIALS:
            # A lab's curve is the flux out of the finger: `measure touch` corrects for lag and stored heat.
            times, flux = work.scheme_flux(name)
            seen = (times >= 0.3) & (times <= curve.times[-1])
            if seen.any():
                apart = (flux[seen] - curve.at(times[seen])) / np.maximum(np.abs(curve.at(times[seen])), 200.0)
                found.append(
                    Check(f"{name}, rms", 100.0 * math.sqrt(float(apart @ apart) / len(apart)), -INF, 10.0, " %")
                )
    note = ""
    if not found:
        note = (
            "needs measured curves (`--measured FOLDER`); against our exact solver the scheme differs by "
            + ", ".join(
                f"{n} {100.0 * abs(at(work.scheme(n)[1], 1.0, COARSE) / at(work.real(n).reading, 1.0) - 1.0):.1f} %"
                for n in MATERIALS
            )
        )
    return Claim("II-E", "The model simulates the thermal response with a good accuracy",
                 "eqs 4 to 10 against measured curves, flux out of the finger", tuple(found), note)  # fmt: skip


def classic(work: Work) -> Claim:
    """Check: a classical scheme is wrong at first."""
    from contact_heat.differences import solve_differences
    from contact_heat.exact import solve

    contact = Contact(finger=finger(), object=sample("wood"), resistance=0.0)
    when = np.array([1e-2, 3.0])
    exact = solve(contact, when).flux
    plain = solve_differences(contact, when, split=False).flux
    checks = (
        Check("off at 10 ms", 100.0 * abs(float(plain[0] / exact[0]) - 1.0), 10.0, INF, " %"),
        Check("off at 3 s", 100.0 * abs(float(plain[1] / exact[1]) - 1.0), -INF, 2.0, " %"),
    )
    return Claim("II-E", "A classical scheme is very wrong at first and right a few seconds later",
                 "wood, R = 0, nodes of 0.1 mm", checks)  # fmt: skip


def splitting(work: Work) -> Claim:
    """Check: the split solves this."""
    from contact_heat.differences import solve_differences
    from contact_heat.exact import solve

    when, checks = np.array([1e-3, 1e-2, 0.1]), []
    for resistance, film in ((0.0, 0.0), (work.setup.resistance, work.setup.film), (0.0, work.setup.film)):
        contact = Contact(finger=finger(), object=sample("wood", film), resistance=resistance)
        error = 100.0 * np.abs(solve_differences(contact, when).flux / solve(contact, when).flux - 1.0)
        name = f"{'film, ' if film else 'bare, '}R = {resistance:g}"
        checks.append(Check(name, float(error.max()), -INF, 2.0, " %"))
    return Claim("II-E", "The split into an analytic and a smooth problem makes the simulation right from the first",
                 "wood, greatest error at 1, 10, 100 ms against the exact solution", tuple(checks),
                 "with the film and without a resistance the film is too thin for one cell")  # fmt: skip


def small_remainder(work: Work) -> Claim:
    """Check: problem 2 is small."""
    _, whole, _, second = parts(work)
    checks = tuple(
        Check(f"at {t:g} s", 100.0 * abs(at(second, t, COARSE) / at(whole, t, COARSE)), -INF, 20.0, " %")
        for t in (0.01, 0.1, 1.0)
    )
    return Claim("II-E", "Temperatures and flows of problem 2 are small", "part of the whole flux, wood under the film",
                 checks)  # fmt: skip


def blood(work: Work) -> Claim:
    """Check: perfusion does not matter in the transient."""
    from contact_heat.stepper import Stepper

    body = sample("aluminium")
    runs = [
        Stepper(Contact(finger=finger(p), object=body), PERIOD).advance(work.setup.resistance, 10000)
        for p in (1.0, 0.0, 10.0)
    ]
    checks = tuple(
        Check(f"{name} at {t:g} s", 100.0 * abs(at(run, t) / at(runs[0], t) - 1.0), -INF, 5.0, " %")
        for name, run in (("none", runs[1]), ("ten times as much", runs[2]))
        for t in (1.0, 10.0)
    )
    return Claim("II-C", "The role of blood perfusion is negligible in the transient",
                 "change of the flux on aluminium", checks)  # fmt: skip


def first_second(work: Work) -> Claim:
    """Check: the semi-infinite model is good for the first second."""
    whole = work.bare("wood", 0.0)
    simple = halfspaces(np.array([0.1, 1.0]), 0.0, FINGER[0].effusivity, material("wood")[1].effusivity)
    real = work.bare("aluminium", work.setup.resistance)
    metal = halfspaces(np.array([0.1, 1.0]), 0.0, FINGER[0].effusivity, material("aluminium")[1].effusivity)
    checks = tuple(
        Check(f"{what} at {t:g} s", 100.0 * abs(float(s) / at(flux, t) - 1.0), -INF, 5.0, " %")
        for what, flux, row in (
            ("wood, R = 0,", whole, simple),
            (f"aluminium, R = {work.setup.resistance:g},", real, metal),
        )
        for t, s in zip((0.1, 1.0), row.tolist(), strict=True)
    )
    return Claim("II-C", "The first second of a touch can be approximated by eqs 1 to "
                         "3", "eq. 2 against the whole contact",
                 checks, "the contact resistance breaks it, which the model neglects")  # fmt: skip


def printed(work: Work) -> Claim:
    """Check: equation 10 as printed."""
    resistance = work.setup.resistance
    flux = (SKIN - AMBIENT) / resistance if resistance > 0.0 else INF
    apart = 100.0 * abs(flux / at(work.bare("wood", resistance), 1.0) - 1.0)
    return Claim("II-E", "Equation 10 gives the boundary flux of problem 2", "as printed: wood, j(1 s)",
                 (Check("off by", apart, -INF, 5.0, " %"),),
                 "as printed it leaves out problem 1's temperatures, and the flux never falls; with them it is "
                 "right")  # fmt: skip


TOUCH: tuple[Maker, ...] = (
    transient, steady, small_sensor, second_sensor, wet, pressure, rise, order, faster, surface, correlated, two_steps,
    blood, first_second, temperatures, accurate_model, any_situation, classic, splitting, small_remainder, printed,
)  # fmt: skip
