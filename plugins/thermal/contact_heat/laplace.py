"""Compiled transforms of a contact at the nodes of the contour: impedances, drives, and the flux between sides.

The formulas are those of `fields`, for the contact face only.  All quantities are transforms multiplied by s, so that
the weights of a step response, ``WEIGHTS / Z``, turn them into values in time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from contact_heat.contour import WEIGHTS, Complex, Z
from contact_heat.hosting import nogil_kernel
from contact_heat.stack import Array, Stack

NODES = len(Z)
#: Weights of the inversion for F(s) = X / s, and for X / s**2 (to be multiplied by t).
STEP, RAMP = WEIGHTS / Z, WEIGHTS / Z**2

# Layers thicker than this many decay lengths hide all that is behind them: exp(-2 * 40) is below the last digit.
_OPAQUE = 40.0


@nogil_kernel
def _root(z: complex) -> complex:
    """Return the principal square root of a number off the negative axis."""
    size = np.sqrt(z.real * z.real + z.imag * z.imag)
    if z.real >= 0.0:
        real = np.sqrt(0.5 * (size + z.real))
        return complex(real, 0.5 * z.imag / real)
    imag = np.sqrt(0.5 * (size - z.real))
    return complex(0.5 * abs(z.imag) / imag, imag if z.imag >= 0.0 else -imag)


@nogil_kernel
def _over(a: complex, b: complex) -> complex:
    """Return a / b without the guards of general division; the moduli are far from over- and underflow."""
    scale = 1.0 / (b.real * b.real + b.imag * b.imag)
    return complex((a.real * b.real + a.imag * b.imag) * scale, (a.imag * b.real - a.real * b.imag) * scale)


@nogil_kernel
def _fade(admittance: complex, resistance: float) -> complex:
    """Return exp(-g L), with ``g L`` as the layer's admittance times its thermal resistance."""
    depth = admittance.real * resistance
    if depth > _OPAQUE:
        return 0.0j
    angle = admittance.imag * resistance
    size = np.exp(-depth)
    return complex(size * np.cos(angle), -size * np.sin(angle))


@nogil_kernel
def impedance_table(
    resistance: Array, conductivity: Array, capacity: Array, perfusion: Array, back: float, times: Array, table: Any
) -> None:
    """Fill in the impedance of a side [m2K/W] for every time and node, shape (times, NODES).

    ``resistance`` is each layer's thickness over conductivity, ``back`` the admittance of the back face; ``table``
    (times, NODES) [m2K/W], complex, is written.
    """
    last = len(resistance) - 1
    for n in range(len(times)):
        for k in range(NODES):
            s = Z[k] / times[n]
            y = _root(conductivity[last] * (s * capacity[last] + perfusion[last]))
            echo = 0.0j
            if resistance[last] < np.inf:
                bounce = complex(-1.0, 0.0) if back == np.inf else _over(y - back, y + back)
                fade = _fade(y, resistance[last])
                echo = bounce * fade * fade
            for i in range(last - 1, -1, -1):
                behind = y * (1.0 - echo)
                y = _root(conductivity[i] * (s * capacity[i] + perfusion[i]))
                fade = _fade(y, resistance[i])
                if fade == 0.0:
                    echo = 0.0j
                else:
                    near = y * (1.0 + echo)
                    echo = _over(near - behind, near + behind) * fade * fade
            table[n, k] = _over(1.0 + echo, y * (1.0 - echo))


@nogil_kernel
def drive_table(
    resistance: Array,
    conductivity: Array,
    capacity: Array,
    perfusion: Array,
    back: float,
    warmth: tuple[float, float],
    times: Array,
    table: Any,
) -> None:
    """Fill in the open contact temperature [K] for steps of arterial and back temperature, shape (times, NODES).

    ``table`` (times, NODES) [K], complex, is written.
    """
    last = len(resistance) - 1
    for n in range(len(times)):
        for k in range(NODES):
            s = Z[k] / times[n]
            echo, level, behind = 0.0j, 0.0j, 0.0j
            for i in range(last, -1, -1):
                square = s * capacity[i] + perfusion[i]
                y = _root(conductivity[i] * square)
                source = _over(complex(perfusion[i] * warmth[0], 0.0), square)
                bounce, passing = 0.0j, complex(1.0, 0.0)
                if i < last:
                    near = y * (1.0 + echo)
                    bounce, passing = _over(near - behind, near + behind), 2.0 * _over(behind, near + behind)
                elif resistance[i] < np.inf:
                    held = back == np.inf
                    bounce = complex(-1.0, 0.0) if held else _over(y - back, y + back)
                    passing = complex(2.0, 0.0) if held else 2.0 * _over(complex(back, 0.0), y + back)
                    level = source if back == 0.0 else complex(warmth[1], 0.0)
                else:
                    level = source
                fade = _fade(y, resistance[i])
                echo = bounce * fade * fade
                level = source + _over(fade * passing * (level - source), 1.0 - echo)
                behind = y * (1.0 - echo)
            table[n, k] = level


@nogil_kernel
def combine(
    finger: Any,
    body: Any,
    finger_drive: Any,
    body_drive: Any,
    numbers: Array,
    times: Array,
    flux: Any,
    heat: Any,
    skin: Any,
    face: Any,
    transforms: Any,
) -> None:
    """Fill in flux, heat and both face temperatures, and the flux transforms.

    ``flux`` [W/m2], ``heat`` [J/m2], ``skin`` [K] and ``face`` [K] have shape (times,), ``transforms`` [W/m2] has
    (times, NODES).  ``finger`` and ``body`` are impedance tables, shape (times, NODES) [m2K/W]; ``finger_drive`` and
    ``body_drive`` are tables of `drive_table`, shape (times, NODES) [K], or empty if there is none.  ``numbers`` holds
    the initial face temperatures [K] and inward fluxes [W/m2] of finger and object, and the resistance [K m2/W].
    """
    warm, cold, warm_flux, cold_flux, resistance = numbers
    for n in range(len(times)):
        j, q, t_finger, t_body = 0.0, 0.0, 0.0, 0.0
        for k in range(NODES):
            zf, zb = finger[n, k], body[n, k]
            df = finger_drive[n, k] if len(finger_drive) else 0.0j
            db = body_drive[n, k] if len(body_drive) else 0.0j
            gap = (warm - cold) - zf * warm_flux + zb * cold_flux + (df - db)
            x = _over(gap, zf + zb + resistance)
            transforms[n, k] = x
            j += (STEP[k] * x).real
            q += (RAMP[k] * x).real
            t_finger += (STEP[k] * (df - zf * (x + warm_flux))).real
            t_body += (STEP[k] * (db + zb * (x - cold_flux))).real
        flux[n] = j
        heat[n] = q * times[n]
        skin[n] = warm + t_finger
        face[n] = cold + t_body


def side_table(stack: Stack, times: Array) -> Complex:
    """Return the impedance table of a side, shape (times, NODES).

    ``times`` has shape (times,) [s]; the impedance is in [m2K/W].
    """
    table = np.empty((len(times), NODES), dtype=np.complex128)
    resistance = stack.thickness / stack.conductivity
    impedance_table(resistance, stack.conductivity, stack.capacity, stack.perfusion, stack.back, times, table)
    return table


def warmed_table(stack: Stack, warmth: tuple[float, float], times: Array) -> Complex:
    """Return the drive table of a side whose blood and back are warmer by ``warmth`` [K] than its start.

    Its shape is (times, NODES).
    """
    table = np.empty((len(times), NODES), dtype=np.complex128)
    resistance = stack.thickness / stack.conductivity
    parts = (resistance, stack.conductivity, stack.capacity, stack.perfusion)
    drive_table(*parts, stack.back, warmth, times, table)
    return table
