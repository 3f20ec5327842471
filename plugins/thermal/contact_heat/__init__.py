"""The contact-heat solver: layered sides, exact evaluation, live stepping, the paper's scheme, batches.

Fluxes are positive when heat leaves the finger.  Temperatures are in kelvin; depths are measured from the contact
inwards on each side.  It needs only NumPy and Numba.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contact_heat.batch import BatchSolution, LockStep, solve_many
    from contact_heat.contact import Contact
    from contact_heat.exact import ContactSolution, solve
    from contact_heat.layers import Back, Film, Initial, Layer, Probe, Side
    from contact_heat.stepper import Stepper

#: Public names and their modules, which are imported on first use: most of them compile.
_HOMES = {
    "Back": "layers",
    "BatchSolution": "batch",
    "Contact": "contact",
    "ContactSolution": "exact",
    "Film": "layers",
    "Initial": "layers",
    "Layer": "layers",
    "LockStep": "batch",
    "Probe": "layers",
    "Side": "layers",
    "Stepper": "stepper",
    "solve": "exact",
    "solve_many": "batch",
}

__all__ = [
    "Back",
    "BatchSolution",
    "Contact",
    "ContactSolution",
    "Film",
    "Initial",
    "Layer",
    "LockStep",
    "Probe",
    "Side",
    "Stepper",
    "solve",
    "solve_many",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
