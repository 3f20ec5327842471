"""The thermal display and the heat of a touched object."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import itouch_thermal.solver_stores  # noqa: F401  - before the solver is imported

# isort: split
from contact_heat.contact import Contact
from contact_heat.layers import Back, Film, Initial, Layer, Probe, Side
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.flux.modality import FluxControl
from itouch_thermal.heat import Heat

if TYPE_CHECKING:
    from contact_heat.batch import BatchSolution, LockStep, solve_many
    from contact_heat.exact import ContactSolution, solve
    from contact_heat.stepper import Stepper

__all__ = [
    "Back",
    "BatchSolution",
    "Contact",
    "ContactSolution",
    "Film",
    "FluxControl",
    "Heat",
    "Initial",
    "Layer",
    "LockStep",
    "Probe",
    "Side",
    "Stepper",
    "ThermalDisplay",
    "solve",
    "solve_many",
]

#: Further packages of this plugin: their code is part of the fingerprint of what has computed a result.
PACKAGES = ("contact_heat",)

#: Names whose modules compile kernels: imported on first use.
_LAZY = {
    "BatchSolution": "contact_heat.batch",
    "ContactSolution": "contact_heat.exact",
    "LockStep": "contact_heat.batch",
    "Stepper": "contact_heat.stepper",
    "solve": "contact_heat.exact",
    "solve_many": "contact_heat.batch",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
