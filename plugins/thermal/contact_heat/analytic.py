"""The paper's closed forms for two half-spaces as pure functions, with its misprints corrected.

Symbols: effusivity ``beta = sqrt(k rho c)``, diffusivity ``alpha = k / (rho c)``; s is the skin, m the material, p the
display.  Fluxes are positive when heat leaves the finger; eq. 2 as printed has the opposite sign.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_erf: Callable[[Array], Array] = np.vectorize(math.erf, otypes=[np.float64])
_erfc: Callable[[Array], Array] = np.vectorize(math.erfc, otypes=[np.float64])


def effusivity(conductivity: float, density: float, specific_heat: float) -> float:
    """Thermal effusivity [W s^1/2 / m2K]."""
    return math.sqrt(conductivity * density * specific_heat)


def diffusivity(conductivity: float, density: float, specific_heat: float) -> float:
    """Thermal diffusivity [m2/s]."""
    return conductivity / (density * specific_heat)


def contact_temperature(beta_m: float, material: float, beta_s: float, skin: float) -> float:
    """Equation 1: contact temperature [K] of two half-spaces without contact resistance."""
    return (beta_m * material + beta_s * skin) / (beta_m + beta_s)


def contact_flux(beta_s: float, contact: float, skin: float, times: Array) -> Array:
    """Equation 2: contact flux [W/m2] at times [s] for a contact temperature [K]; here positive out of the finger.

    ``times`` has any shape (...,), and the flux the same; ``beta_s`` is the skin's effusivity [W s^0.5/m2K].
    """
    return np.asarray(beta_s * (skin - contact) / np.sqrt(np.pi * np.asarray(times)))


def display_temperature(beta_p: float, *, beta_m: float, material: float, beta_s: float, skin: float) -> float:
    """Equation 3: initial temperature [K] of a display that gives the same contact temperature as a material.

    ``beta_p`` is the effusivity of what the finger touches first, the flux sensor for instance, not of the module.
    """
    contact = contact_temperature(beta_m, material, beta_s, skin)
    return contact * (beta_p + beta_s) / beta_p - beta_s * skin / beta_p


def half_space_temperature(contact: float, initial: float, alpha: float, depth: Array, time: float) -> Array:
    """Equation 7: temperature [K] at depths [m] of a half-space whose face is held at ``contact`` from t = 0.

    As printed it has the skin's initial temperature in place of the contact's.

    ``depth`` has any shape (...,), and the temperature the same; ``alpha`` [m2/s], ``time`` [s].
    """
    return np.asarray(contact + (initial - contact) * _erf(np.asarray(depth) / (2.0 * math.sqrt(alpha * time))))


def constant_flux_temperature(
    initial: float, flux: float, conductivity: float, alpha: float, depth: Array, time: float
) -> Array:
    """Equation 9: temperature [K] at depths [m] of a half-space that a constant flux enters from t = 0.

    The printed form has two names for this flux.  It is positive into the body: for a finger, minus the contact flux.

    ``depth`` has any shape (...,), and the temperature the same; ``flux`` [W/m2], ``conductivity`` [W/mK],
    ``alpha`` [m2/s], ``time`` [s].
    """
    x = np.asarray(depth)
    near = 2.0 * math.sqrt(alpha * time / math.pi) * np.exp(-(x**2) / (4.0 * alpha * time))
    return np.asarray(initial + flux / conductivity * (near - x * _erfc(x / (2.0 * math.sqrt(alpha * time)))))


def resistance_flux(beta_s: float, beta_m: float, difference: float, resistance: float, times: Array) -> Array:
    """Contact flux [W/m2] of two half-spaces ``difference`` kelvin apart through a constant resistance [K m2/W].

    ``difference / R * exp(z**2) erfc(z)`` with ``z = (1/beta_s + 1/beta_m) sqrt(t) / R``.

    ``times`` [s] has any shape (...,), and the flux the same; ``beta_s`` and ``beta_m`` are effusivities
    [W s^0.5/m2K].
    """
    z = (1.0 / beta_s + 1.0 / beta_m) * np.sqrt(np.asarray(times)) / resistance
    return np.asarray(difference / resistance * scaled_erfc(z))


def scaled_erfc(z: Array) -> Array:
    """Return ``exp(z**2) erfc(z)`` for z >= 0; by its continued fraction for large z, where exp would overflow.

    ``z`` has any shape (...,), and the result the same; both are dimensionless [1].
    """
    z = np.asarray(z, dtype=np.float64)
    small = np.minimum(z, 5.0)
    tail = np.maximum(z, 5.0)
    fraction = tail
    for n in range(60, 0, -1):
        fraction = tail + 0.5 * n / fraction
    return np.where(z < 5.0, np.exp(small**2) * _erfc(small), 1.0 / (math.sqrt(math.pi) * fraction))
