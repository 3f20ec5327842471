"""The start temperature of the plate: what it must have when the finger arrives."""

from __future__ import annotations

from collections.abc import Sequence

from itouch_thermal.solver.layers import Layer


def equation_three(material: float, plate: float, tissue: float, object_temperature: float, skin: float) -> float:
    """Return the plate temperature [K] of equation 3 of the paper.

    Parameters
    ----------
    material, plate, tissue
        Effusivities [W s^1/2 / m2K].
    object_temperature, skin
        Temperatures [K] before the touch.
    """
    contact = (material * object_temperature + tissue * skin) / (material + tissue)
    return contact * (plate + tissue) / plate - tissue * skin / plate


def outer_effusivity(layers: Sequence[Layer]) -> float:
    """Return the effusivity of the first layer."""
    return layers[0].effusivity
