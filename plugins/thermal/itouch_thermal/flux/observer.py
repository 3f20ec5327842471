"""The estimator (Kalman filter) of the controller `model`: what plate and finger are really like, learnt in touch.

The model is the display's column itself.  Everything that may differ is a parameter: contact resistance, Seebeck
coefficient, legs, electrical resistance, plate, finger, sensor lag, the effect of a press, an offset and an unexplained
flux.  The column is driven by the currents that were sent; its derivatives with respect to the parameters run beside
it, and each reading corrects the parameters by recursive Gauss-Newton (an extended Kalman filter whose state covariance
is that of the parameters).  A correction moves the column to where it would be if the parameters had always had their
new values.

In every function ``c``, ``tissue`` and ``plate`` are the fields of a `Basis`; ``x``, ``theta``, ``cover``, ``gain`` and
``memory`` those of a `law.Memory`; ``row`` (n + m + X_TAIL,) is a row of ``x``, with modes and temperatures [K] and
fluxes [W/m2], or these per unit of a parameter; and ``o`` is n + m, the number of modes in it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from contact_heat.resistance import contact_area
from itouch.plugin.kernels import inlined, kernel, linked
from itouch_thermal.display.column import (
    F_BEGIN,
    F_DECAY,
    F_END,
    F_PORT,
    P_BACK,
    P_BEGIN,
    P_DECAY,
    P_END,
    P_HALF,
    P_MEAN,
    P_PORT,
    P_PUMP,
    P_SENSE,
    P_SPILL,
)

#: Indices of the parameters: logarithms for contact resistance, sensor lag and press, offset [K], flux [W/m2], relative
#: changes for the others; and their number.
RESISTANCE, SEEBECK, LEGS, OHMIC, PLATE, TISSUE, LAG, OFFSET, FLUX, PRESS, COUNT = range(11)
#: Behind a wire two more: by how much later than assumed the finger came, and a command acts [s].
ONSET, DELAY = COUNT, COUNT + 1
#: How far each parameter may be moved: beyond that it would be a fault, not a tolerance.
AUTHORITY = (1.2, 0.3, 0.4, 0.4, 0.3, 0.5, 0.6, 0.3, 300.0, 1.5, 0.012, 0.015)
#: Share of the flux by which a reading may be off while the finger is pressed on, as the law of the press is not exact.
DOUBT = 0.3
#: Random walk of the logarithm of the resistance during a press [per root second].
DRIFT_PRESS = 1.0
#: Offsets of the numbers that follow the modes in each row of ``x``: contact flux, temperatures of the plate's back and
#: face, what the sensors of flux and film show, drift; and their number.
X_FLUX, X_BACK, X_FACE, X_SEEN, X_FILM, X_DRIFT, X_TAIL = range(7)
#: Indices of the constants.
(
    O_PERIOD, O_REST, O_REFERENCE, O_CONTACT, O_SEEBECK, O_RESISTANCE, O_CONDUCTANCE, O_AREA, O_FLUX_LAG, O_PLATE_LAG,
    O_FLUX_NOISE, O_PLATE_NOISE, O_SINK_CAPACITY, O_SINK_RESISTANCE, O_SINK_LAG, O_AIR, O_COVER, O_AMBIENT,
    O_DRIFT_FLUX, O_DRIFT_OFFSET, O_CEILING, O_LAGS, O_SLEW, O_CONSTANTS,
) = range(24)  # fmt: skip
#: Indices into the scalar memory; M_PART: the part of the sensor that the finger covers.
M_TOUCHING, M_SINK, M_SINK_SEEN, M_CONTACT, M_TICKS, M_QUIET, M_AGE, M_UNSEEN, M_PART, M_TAIL = range(10)
#: One more, where the delay is a parameter or the driver's slew rate is limited: the current [A] of the period before.
M_BEFORE = M_TAIL
#: Rates [1/s] at which the sink follows its sensor, and a disturbed plate its own.
SINK_RATE, PLATE_RATE = 2.0, 20.0
#: For how long nothing is learnt after a flux that air cannot explain, as something touches the plate: in time
#: constants of following.  Any sooner the plate is not yet where its sensor says, and the parameters, which alone can
#: explain that later, would be led away from the display.
QUIET = 4.0

#: Places in ``pad``: contact area at 1 N [m2], exponent of the force in it, areas of plate and sensor [m2].
PAD_AREA, PAD_EXPONENT, PAD_PLATE, PAD_SENSOR = range(4)

_contact_area = kernel(contact_area)


@kernel
def seen(pad: Any, force: float) -> float:
    """Return the part of a sensor under the middle of a finger that the finger covers, at a force [N].

    ``pad`` (4,): what of finger and display decides it, see `PAD_AREA`.
    """
    area = _contact_area(force, pad[PAD_AREA], pad[PAD_EXPONENT])
    return float(min(1.0, min(pad[PAD_PLATE], area) / pad[PAD_SENSOR]))


@linked
def shifted(current: float, before: float, periods: float) -> Any:
    """Return mean current [A] and mean square [A2] of a period, if they act ``periods`` later than is assumed.

    The whole effect of the lateness of a change is put into the period of the change: after some milliseconds only the
    sum of the heat matters, and that is right.
    """
    square = current * current
    return current - periods * (current - before), square - periods * (square - before * before)


@linked
def slewed(current: float, before: float, most: float) -> float:
    """Return the current [A] that flows where it may differ by ``most`` [A] from the one before; 0: by any amount."""
    return float(current if most <= 0.0 else min(before + most, max(before - most, current)))


class Basis(NamedTuple):
    """The display's column as the estimator takes it: constants ``c`` (O_CONSTANTS,), in SI units, and packed halves.

    ``tissue`` (4, n) and ``plate`` (P_ROWS, m), with n and m modes: see `display.column`.
    """

    c: Any
    tissue: Any
    plate: Any


class StepCurrent(NamedTuple):
    """The current of a step: mean [A] and mean square [A2], and by how much a second of delay would lower them."""

    acting: float
    square: float
    rise: float
    rise_square: float


class PumpedFlux(NamedTuple):
    """The flux pumped out of the plate, its derivative with respect to the back's temperature, and what gives them."""

    flux: float
    slope: float
    seebeck: float
    ohmic: float
    cold: float
    hot: float


class ContactFlux(NamedTuple):
    """What gives the contact flux at the end of a step: gains of both halves, resistance, covered parts, denominator.

    ``cover`` and ``covered`` are the parts of plate and sensor that the finger covers; ``whole`` is the denominator.
    """

    tissue_gain: float
    plate_gain: float
    resistance: float
    pressing: float
    touching: bool
    cover: float
    covered: float
    tissue_self: float
    whole: float


class Lags(NamedTuple):
    """The share of their reading that the sensors of flux and film keep over a step, and its derivatives by LAG."""

    keep_flux: float
    keep_film: float
    rise_flux: float
    rise_film: float


class Stepped(NamedTuple):
    """What the derivatives need of the column's own step: its fluxes, and what its sensors saw."""

    begin: float
    end: float
    spill: float
    middle: float
    film: float
    seen: float
    lagging_seen: float
    lagging_film: float


@linked
def advance(c: Any, tissue: Any, plate: Any, x: Any, theta: Any, memory: Any, current: float, scale: float) -> None:
    """Advance column and derivatives by one period; docs/explanation/thermal-estimator.md derives the equations.

    Parameters
    ----------
    c
        Constants, shape (O_CONSTANTS,).
    tissue, plate
        Packed column, shapes (4, n) and (P_ROWS, m); the plate's is for a finger that covers O_COVER of it.
    x
        Row 0 the column, row 1 + k its derivative with respect to parameter k; shape (1 + p, n + m + X_TAIL).
    theta, memory
        Parameters (p,): COUNT, or more with onset and delay; and scalar memory (M_TAIL,), or one more with delay or
        slew.
    current
        Current [A] that was asked for in this period; the driver's slew rate may limit what flows.
    scale
        Contact resistance that the force explains, as a multiple of the nominal one.
    """
    flowing = _flowing(c, theta, memory, current)
    pumping = _pumping(c, x[0], tissue.shape[1] + plate.shape[1], theta, memory, flowing)
    closing = _closing(c, tissue, plate, theta, memory, scale)
    lags = _lags(c, theta)
    column = _step_column(c, tissue, plate, x[0], pumping, closing, lags)
    for k in range(theta.shape[0]):
        _step_derivative(c, tissue, plate, x[1 + k], k, scale, flowing, pumping, closing, lags, column)


@inlined
def _flowing(c: Any, theta: Any, memory: Any, current: float) -> StepCurrent:
    """Return the current that flows in a step, after the driver's slew rate and the unknown part of the delay."""
    dt = c[O_PERIOD]
    if c[O_SLEW] > 0.0:
        current = slewed(current, memory[M_BEFORE], c[O_SLEW] * dt)
    acting, square, rise, rise_square = current, current * current, 0.0, 0.0
    if theta.shape[0] > DELAY:
        acting, square = shifted(current, memory[M_BEFORE], theta[DELAY] / dt)
        rise, rise_square = (current - memory[M_BEFORE]) / dt, (current**2 - memory[M_BEFORE] ** 2) / dt
    if memory.shape[0] > M_BEFORE:
        memory[M_BEFORE] = current
    return StepCurrent(acting, square, rise, rise_square)


@inlined
def _pumping(c: Any, row: Any, o: int, theta: Any, memory: Any, flowing: StepCurrent) -> PumpedFlux:
    """Return what the module pumps in a step, and warm the sink by it; ``row``: the column, ``o``: number of modes."""
    dt = c[O_PERIOD]
    cold, hot = row[o + X_BACK], memory[M_SINK]
    seebeck, legs = c[O_SEEBECK] * (1.0 + theta[SEEBECK]), c[O_CONDUCTANCE] * (1.0 + theta[LEGS])
    ohmic = c[O_RESISTANCE] * (1.0 + theta[OHMIC])
    pumped = seebeck * cold * flowing.acting - 0.5 * flowing.square * ohmic - legs * (hot - cold)
    electric = seebeck * (hot - cold) * flowing.acting + flowing.square * ohmic
    heat = pumped + electric - (hot - c[O_AMBIENT]) / c[O_SINK_RESISTANCE]
    memory[M_SINK] += dt / c[O_SINK_CAPACITY] * heat
    memory[M_SINK_SEEN] += dt / (c[O_SINK_LAG] + dt) * (memory[M_SINK] - memory[M_SINK_SEEN])
    flux = pumped / c[O_AREA] + theta[FLUX] + row[o + X_DRIFT]
    return PumpedFlux(flux, (seebeck * flowing.acting + legs) / c[O_AREA], seebeck, ohmic, cold, hot)


@inlined
def _closing(c: Any, tissue: Any, plate: Any, theta: Any, memory: Any, scale: float) -> ContactFlux:
    """Return what relates the flux at the end of a step to the temperatures of both faces without it."""
    touching = memory[M_TOUCHING] > 0.0
    tissue_gain, plate_gain = 1.0 / (1.0 + theta[TISSUE]), 1.0 / (1.0 + theta[PLATE])
    pressing = scale - 1.0 if scale < 1.0 else (scale - 1.0) * math.exp(theta[PRESS])
    resistance = c[O_CONTACT] * math.exp(theta[RESISTANCE]) * (1.0 + pressing)
    tissue_self = plate_self = 0.0
    if touching:
        for i in range(tissue.shape[1]):
            tissue_self += tissue[F_PORT, i] * tissue[F_END, i]
    for i in range(plate.shape[1]):
        plate_self += plate[P_PORT, i] * plate[P_END, i]
    whole = resistance + tissue_gain * tissue_self + plate_gain * plate_self
    cover, covered = (c[O_COVER], memory[M_PART]) if touching else (0.0, 0.0)
    return ContactFlux(tissue_gain, plate_gain, resistance, pressing, touching, cover, covered, tissue_self, whole)


@inlined
def _lags(c: Any, theta: Any) -> Lags:
    """Return what the sensors keep of their reading over a step."""
    dt = c[O_PERIOD]
    flux_lag, film_lag = c[O_FLUX_LAG] * math.exp(theta[LAG]), c[O_PLATE_LAG] * math.exp(theta[LAG])
    keep_flux, keep_film = math.exp(-dt / flux_lag), math.exp(-dt / film_lag)
    return Lags(keep_flux, keep_film, keep_flux * dt / flux_lag, keep_film * dt / film_lag)


@inlined
def _step_column(
    c: Any, tissue: Any, plate: Any, row: Any, pumping: PumpedFlux, closing: ContactFlux, lags: Lags
) -> Stepped:
    """Advance the column: both halves without the flux at the end of the step, that flux, and both halves with it."""
    n, o = tissue.shape[1], tissue.shape[1] + plate.shape[1]
    gain, begin, end, skin = closing.plate_gain, row[o + X_FLUX], 0.0, 0.0
    air = c[O_AIR] * (c[O_AMBIENT] - row[o + X_FACE])
    spill = (1.0 - closing.cover) * c[O_AIR] * (c[O_AMBIENT] - row[o + X_FACE])
    if closing.touching:
        skin = _relax_tissue(tissue, row, closing.tissue_gain * begin, c[O_REST])
    beside = gain * ((1.0 - closing.cover) * air)
    before, face = _relax_plate(plate, row, n, gain * begin, 0.0, beside, gain * pumping.flux, c[O_REFERENCE])
    if closing.touching:
        end = (skin - face) / closing.whole
        _end_tissue(tissue, row, closing.tissue_gain * end)
    face, back, film, heat = _end_plate(plate, row, n, gain * end, c[O_REFERENCE])
    seen = (
        closing.covered * (0.5 * (begin + end)) + (1.0 - closing.covered) * air - (heat - before) / (gain * c[O_PERIOD])
    )
    found = Stepped(
        begin, end, spill, (heat - before) / c[O_PERIOD], film, seen, row[o + X_SEEN], row[o + X_FILM]
    )  # fmt: skip
    row[o + X_SEEN] = lags.keep_flux * row[o + X_SEEN] + (1.0 - lags.keep_flux) * seen
    row[o + X_FILM] = lags.keep_film * row[o + X_FILM] + (1.0 - lags.keep_film) * film
    row[o + X_FLUX], row[o + X_BACK], row[o + X_FACE] = end, back, face
    return found


@inlined
def _step_derivative(
    c: Any, tissue: Any, plate: Any, row: Any, k: int, scale: float,
    flowing: StepCurrent, pumping: PumpedFlux, closing: ContactFlux, lags: Lags, column: Stepped,
) -> None:  # fmt: skip
    """Advance the column's derivative with respect to parameter ``k``, with what the column did in this step."""
    n, o = tissue.shape[1], tissue.shape[1] + plate.shape[1]
    gain, begin, end, skin = closing.plate_gain, row[o + X_FLUX], 0.0, 0.0
    # A gain's derivative acts on what the column took in: its fluxes at start and end, and the pumped one.
    of_tissue = -closing.tissue_gain * closing.tissue_gain if k == TISSUE else 0.0
    of_plate = -gain * gain if k == PLATE else 0.0
    air = -c[O_AIR] * row[o + X_FACE]
    if closing.touching:
        skin = _relax_tissue(tissue, row, closing.tissue_gain * begin + of_tissue * column.begin, 0.0)
        skin -= of_tissue * closing.tissue_self * column.end
    pumped = pumping.slope * row[o + X_BACK] + row[o + X_DRIFT] + _pumped_by(c, k, flowing, pumping)
    before, face = _relax_plate(
        plate, row, n, gain * begin + of_plate * column.begin, of_plate * column.end,
        gain * ((1.0 - closing.cover) * air) + of_plate * column.spill,
        gain * pumped + of_plate * pumping.flux, 0.0,
    )  # fmt: skip
    if closing.touching:
        end = (skin - face - _resisted_by(k, scale, closing, column.end)) / closing.whole
        _end_tissue(tissue, row, closing.tissue_gain * end + of_tissue * column.end)
    face, back, film, heat = _end_plate(plate, row, n, gain * end, 0.0)
    seen = (
        closing.covered * (0.5 * (begin + end)) + (1.0 - closing.covered) * air - (heat - before) / (gain * c[O_PERIOD])
    )
    if k == PLATE:
        seen -= column.middle  # d(1 / gain) = d(1 + theta)
    lag_seen = lag_film = 0.0
    if k == LAG:
        lag_seen = lags.rise_flux * (column.lagging_seen - column.seen)
        lag_film = lags.rise_film * (column.lagging_film - column.film)
    row[o + X_SEEN] = lags.keep_flux * row[o + X_SEEN] + (1.0 - lags.keep_flux) * seen + lag_seen
    row[o + X_FILM] = lags.keep_film * row[o + X_FILM] + (1.0 - lags.keep_film) * film + lag_film
    row[o + X_FLUX], row[o + X_BACK], row[o + X_FACE] = end, back, face


@inlined
def _pumped_by(c: Any, k: int, flowing: StepCurrent, pumping: PumpedFlux) -> float:
    """Return the partial derivative of the pumped flux [W/m2] with respect to parameter ``k``, for a given column."""
    if k == SEEBECK:
        return float(c[O_SEEBECK] * pumping.cold * flowing.acting / c[O_AREA])
    if k == LEGS:
        return float(-(c[O_CONDUCTANCE] * (pumping.hot - pumping.cold) / c[O_AREA]))
    if k == OHMIC:
        return float(-(0.5 * flowing.square * c[O_RESISTANCE] / c[O_AREA]))
    if k == FLUX:
        return 1.0
    if k == DELAY:
        late = pumping.seebeck * pumping.cold * flowing.rise - 0.5 * pumping.ohmic * flowing.rise_square
        return float(-(late / c[O_AREA]))
    return 0.0


@inlined
def _resisted_by(k: int, scale: float, closing: ContactFlux, flux: float) -> float:
    """Return the partial derivative of the drop [K] at the contact resistance by parameter ``k``, at a flux [W/m2]."""
    if k == RESISTANCE:
        return float(closing.resistance * flux)
    if k == PRESS and scale > 1.0:
        return float(closing.resistance * closing.pressing / (1.0 + closing.pressing) * flux)
    return 0.0


@inlined
def _relax_tissue(tissue: Any, row: Any, begin: float, skin: float) -> float:
    """Advance the tissue's modes under the flux at a step's start; return the skin temperature, ``skin`` at rest."""
    for i in range(tissue.shape[1]):
        row[i] = tissue[F_DECAY, i] * row[i] - tissue[F_BEGIN, i] * begin
        skin += tissue[F_PORT, i] * row[i]
    return skin


@inlined
def _end_tissue(tissue: Any, row: Any, end: float) -> None:
    """Add what the flux at the end of a step does to the tissue's modes."""
    for i in range(tissue.shape[1]):
        row[i] -= tissue[F_END, i] * end


@inlined
def _relax_plate(
    plate: Any, row: Any, n: int, begin: float, end: float, beside: float, push: float, face: float
) -> tuple[float, float]:
    """Advance the plate's modes, from ``n`` on, under all of a step that is known before the flux at its end is.

    Return the heat in the upper half of the film at the start of the step, and the temperature of the face, which is
    ``face`` at rest.
    """
    before = 0.0
    for i in range(plate.shape[1]):
        before += plate[P_HALF, i] * row[n + i]
        row[n + i] = (
            plate[P_DECAY, i] * row[n + i]
            + plate[P_BEGIN, i] * begin
            + plate[P_END, i] * end
            + plate[P_SPILL, i] * beside
            - plate[P_PUMP, i] * push
        )
        face += plate[P_PORT, i] * row[n + i]
    return before, face


@inlined
def _end_plate(plate: Any, row: Any, n: int, end: float, rest: float) -> tuple[float, float, float, float]:
    """Add what the flux at the end of a step does to the plate's modes.

    Return the temperatures of face, back and film, which are ``rest`` at rest, and the heat in the upper half of the
    film.
    """
    face, back, film, heat = rest, rest, rest, 0.0
    for i in range(plate.shape[1]):
        row[n + i] += plate[P_END, i] * end
        face += plate[P_PORT, i] * row[n + i]
        back += plate[P_BACK, i] * row[n + i]
        film += plate[P_SENSE, i] * row[n + i]
        heat += plate[P_HALF, i] * row[n + i]
    return face, back, film, heat


@linked
def correct(
    x: Any, theta: Any, cover: Any, gain: Any, slopes: Any, explicit: int, innovation: float, noise: float
) -> None:
    """Take in one reading: move parameters and column; ``cover`` is the parameters' covariance (p, p).

    ``slopes`` (p,) are the reading's derivatives, in its unit per unit of each parameter, as of when it was measured;
    ``explicit`` is a parameter that is itself added to the reading, negative: none.  ``innovation`` is the reading
    minus the expected one, ``noise`` its standard deviation.

    A parameter that would pass the end of its authority is set to that end, the others to their most likely values
    given that (projection of the estimate, Simon 2006, section 7.5), and its variance stays.  If it were only clipped,
    the changes by which the others make up for its full step would remain: a resistance that grew while an effusivity
    was at its end once led the estimate away from the readings for seconds.
    """
    held, count = -1, theta.shape[0]
    total = _gains(cover, gain, slopes, explicit, held, innovation, noise)
    for a in range(count):
        if held < 0 and abs(theta[a] + gain[a] * innovation / total) > AUTHORITY[a] and cover[a, a] > 0.0:
            held = a
    if held >= 0:
        end = math.copysign(AUTHORITY[held], gain[held] * innovation) - theta[held]
        expected = 0.0
        for a in range(count):
            step = cover[a, held] / cover[held, held] * end
            expected += (slopes[a] + (1.0 if a == explicit else 0.0)) * step
            _move(x, theta, a, step)
        innovation -= expected
        total = _gains(cover, gain, slopes, explicit, held, innovation, noise)
    for a in range(count):
        _move(x, theta, a, gain[a] * innovation / total)
        for b in range(count):
            cover[a, b] -= gain[a] * gain[b] / total


@inlined
def _move(x: Any, theta: Any, a: int, step: float) -> None:
    """Move parameter ``a`` by a step, not beyond its authority, and the column with it."""
    step = min(AUTHORITY[a] - theta[a], max(-AUTHORITY[a] - theta[a], step))
    theta[a] += step
    for i in range(x.shape[1]):
        x[0, i] += x[1 + a, i] * step


@linked
def _gains(cover: Any, gain: Any, slopes: Any, explicit: int, held: int, innovation: float, noise: float) -> float:
    """Fill ``gain`` (p,), the covariance of each parameter with a reading; return the variance of its innovation.

    ``held`` is a parameter that is taken as known; negative: none.
    """
    total, count, known = noise * noise, cover.shape[0], 0.0
    if held >= 0:
        for b in range(count):
            known += cover[held, b] * (slopes[b] + (1.0 if b == explicit else 0.0))
        known /= cover[held, held]
    for a in range(count):
        gain[a] = 0.0
        for b in range(count):
            slope = slopes[b] + (1.0 if b == explicit else 0.0)
            gain[a] += cover[a, b] * slope
        if held >= 0:
            gain[a] = 0.0 if a == held else gain[a] - cover[a, held] * known
    for a in range(count):
        total += (slopes[a] + (1.0 if a == explicit else 0.0)) * gain[a]
    # An innovation of more than three deviations is the model's fault: it moves the parameters less, and teaches less.
    return float(max(total, innovation * innovation / 9.0))


@linked
def observe(
    basis: Any, learnt: Any, current: float, scale: float, press: float, flux: float, film: float, sink: float
) -> None:
    """Advance by one period under ``current`` [A] and take in the readings of flux, film and sink; NaN: none.

    ``basis`` is a `Basis`, ``learnt`` a `Memory`; ``press`` says how strongly the finger is being pressed on now: 0 not
    at all, 1 or more very strongly.
    """
    c, tissue, plate = basis.c, basis.tissue, basis.plate
    x, theta, cover, gain, memory = learnt.x, learnt.theta, learnt.cover, learnt.gain, learnt.memory
    advance(c, tissue, plate, x, theta, memory, current, scale)
    if sink == sink:
        memory[M_SINK] += min(1.0, SINK_RATE * c[O_PERIOD]) * (sink - memory[M_SINK_SEEN])
    o = tissue.shape[1] + plate.shape[1]
    if memory[M_TOUCHING] == 0.0 and _disturbed(c, x, memory, flux, o):
        _resume(c, plate, x, theta, memory, film, o)
        return
    memory[M_UNSEEN] = 0.0
    x[:, o + X_DRIFT] = 0.0
    cover[FLUX, FLUX] += c[O_DRIFT_FLUX]
    cover[OFFSET, OFFSET] += c[O_DRIFT_OFFSET]
    cover[RESISTANCE, RESISTANCE] += DRIFT_PRESS * DRIFT_PRESS * math.sqrt(min(1.0, press)) * c[O_PERIOD]
    # A reading at the end of the sensor's scale says nothing about the flux beyond it.
    if abs(flux) < c[O_CEILING] and abs(x[0, o + X_SEEN]) < c[O_CEILING]:
        # While the finger is being pressed on, the law of the press is not trusted to the last watt.
        doubt = DOUBT * math.sqrt(min(1.0, press)) * abs(x[0, o + X_FLUX])
        noise = math.sqrt(c[O_FLUX_NOISE] ** 2 + doubt * doubt)
        correct(x, theta, cover, gain, x[1:, o + X_SEEN], -1, flux - x[0, o + X_SEEN], noise)
    if film == film:
        miss = film - x[0, o + X_FILM] - theta[OFFSET]
        correct(x, theta, cover, gain, x[1:, o + X_FILM], OFFSET, miss, c[O_PLATE_NOISE])


@linked
def quiet(c: Any) -> float:
    """Return for how long [s] nothing is learnt once a bare plate was disturbed; ``c``: constants (O_CONSTANTS,)."""
    return float(QUIET * max(1.0 / PLATE_RATE, c[O_PLATE_LAG]))


@linked
def _disturbed(c: Any, x: Any, memory: Any, flux: float, o: int) -> bool:
    """Tell whether the bare plate has just had, or had not long ago, a flux that air does not explain."""
    if abs(flux - x[0, o + X_SEEN]) > 6.0 * c[O_FLUX_NOISE] + 0.3 * abs(x[0, o + X_SEEN]):
        memory[M_QUIET] = quiet(c)
    if memory[M_QUIET] > 0.0:
        memory[M_QUIET] -= c[O_PERIOD]
        return True
    return False


@linked
def _resume(c: Any, plate: Any, x: Any, theta: Any, memory: Any, film: float, o: int) -> None:
    """Follow the readings without learning from them.

    A reading is compared with what is expected in its own period, and counts for all periods since the last reading.
    """
    memory[M_UNSEEN] += 1.0
    if film == film:
        for k in range(theta.shape[0] + 1):
            follow(c, plate, x[k], memory[M_UNSEEN], missed(k, film, theta, x[k, o + X_FILM]), o)
        memory[M_UNSEEN] = 0.0


@linked
def missed(k: int, film: float, theta: Any, expected: float) -> float:
    """Return the difference of a film reading from what row ``k`` expects; row 0 is the column, others derivatives."""
    if k == 0:
        return float(film - theta[OFFSET] - expected)
    return -expected - (1.0 if k - 1 == OFFSET else 0.0)


@linked
def follow(c: Any, plate: Any, row: Any, periods: float, miss: float, o: int) -> float:
    """Move plate and drift of a row towards a reading that differs by ``miss``; return by how much its reading moved.

    The drift is a flux [W/m2] of unknown cause that takes the plate away from the model: without it the plate would lag
    behind its sensor by as much as it departs within the time constant of following.  ``periods`` have passed since the
    last reading.  A sensor that is slower than the plate follows it tells of the plate's errors later: the reading that
    is expected and the drift are moved by less, so that from a lag of 0.2 s on all three errors fade within one to two
    lags, with a damping ratio above a half.
    """
    slower = max(1.0, PLATE_RATE * c[O_PLATE_LAG])
    m = plate.shape[1]
    n, time, square, rise = o - m, c[O_PERIOD] * periods, 0.0, 0.0
    if time <= 0.0:
        return 0.0
    for i in range(m):
        square += plate[P_MEAN, i] * plate[P_MEAN, i]
        rise += plate[P_MEAN, i] * plate[P_PUMP, i] / c[O_PERIOD]
    part = min(1.0, PLATE_RATE * time)
    shift = part * miss
    row[o + X_DRIFT] -= part * part / (2.0 - part) * miss / (time * rise) / slower
    for i in range(m):
        row[n + i] += shift * plate[P_MEAN, i] / square
    sensed = shift / math.sqrt(slower)
    row[o + X_FILM] += sensed
    return float(sensed)


@linked
def begin_touch(
    c: Any, tissue: Any, plate: Any, x: Any, theta: Any, cover: Any, memory: Any, prior: Any, onset: float
) -> None:  # fmt: skip
    """Set the finger, whose modes are in row 0 already, on the plate: resistance and finger are unknown again.

    ``prior`` (p,) are the standard deviations of the parameters before a touch, in their units, and ``onset`` is the
    standard deviation [s] of the time at which it came, where that is a parameter.
    """
    n, m = tissue.shape[1], plate.shape[1]
    o = n + m
    memory[M_TOUCHING] = 1.0
    memory[M_QUIET] = 0.0
    for which in (RESISTANCE, TISSUE, PRESS, ONSET):
        if which >= theta.shape[0]:
            continue
        for b in range(theta.shape[0]):
            cover[which, b] = cover[b, which] = 0.0
        deviation = onset if which == ONSET else prior[which]
        cover[which, which] = deviation * deviation
        theta[which] = 0.0
        for i in range(o + X_TAIL):
            x[1 + which, i] = 0.0
    s = c[O_REST]
    for i in range(n):
        s += tissue[F_PORT, i] * x[0, i]
        for k in range(theta.shape[0]):
            x[1 + k, i] = 0.0
    contact = c[O_CONTACT] * memory[M_CONTACT]
    flux = (s - x[0, o + X_FACE]) / contact
    x[0, o + X_FLUX] = flux
    for k in range(theta.shape[0]):
        x[1 + k, o + X_FLUX] = -x[1 + k, o + X_FACE] / contact
    x[1 + RESISTANCE, o + X_FLUX] = -flux
    x[1 + PRESS, o + X_FLUX] = -flux * max(0.0, memory[M_CONTACT] - 1.0) / memory[M_CONTACT]
    if theta.shape[0] > ONSET:
        # The unexplained flux of the bare plate comes partly from what a wire hides, such as another delay: under the
        # finger it may be gone.
        cover[FLUX, FLUX] += prior[FLUX] * prior[FLUX]
        _come_later(c, tissue, plate, x, theta, memory, contact)


@linked
def _come_later(c: Any, tissue: Any, plate: Any, x: Any, theta: Any, memory: Any, contact: float) -> None:
    """Fill the column's derivative with respect to the time at which the finger came, by the difference of a period.

    If it had come one period later, the column would first have gone on for a period without it, and the contact would
    begin there.  What the module pumps is the same in both cases.
    """
    n, o = tissue.shape[1], tissue.shape[1] + plate.shape[1]
    pumping, lags = PumpedFlux(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), _lags(c, theta)
    met, later, row = x[0].copy(), x[0].copy(), x[1 + ONSET]
    _step_column(c, tissue, plate, met, pumping, _closing(c, tissue, plate, theta, memory, memory[M_CONTACT]), lags)
    memory[M_TOUCHING], later[o + X_FLUX] = 0.0, 0.0
    _step_column(c, tissue, plate, later, pumping, _closing(c, tissue, plate, theta, memory, memory[M_CONTACT]), lags)
    memory[M_TOUCHING] = 1.0
    skin = c[O_REST]
    for i in range(n):
        skin += tissue[F_PORT, i] * later[i]
    later[o + X_FLUX] = (skin - later[o + X_FACE]) / contact
    for i in range(o + X_DRIFT):
        row[i] = (later[i] - met[i]) / c[O_PERIOD]


@linked
def end_touch(tissue: Any, plate: Any, x: Any, memory: Any) -> None:
    """Take the finger off the plate."""
    memory[M_TOUCHING] = 0.0
    o = tissue.shape[1] + plate.shape[1]
    for k in range(x.shape[0]):
        x[k, o + X_FLUX] = 0.0
