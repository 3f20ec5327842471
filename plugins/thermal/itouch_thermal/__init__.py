"""The thermal display and the heat of a touched object."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from itouch_thermal.display import ThermalDisplay
from itouch_thermal.flux import FluxControl
from itouch_thermal.heat import Heat
from itouch_thermal.solver.layers import Back, Contact, Film, Initial, Layer, Probe, Side

if TYPE_CHECKING:
    from itouch_thermal.solver.batch import BatchSolution, LockStep, solve_many
    from itouch_thermal.solver.exact import ContactSolution, solve
    from itouch_thermal.solver.stepper import Stepper

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

#: Names whose modules compile kernels: imported when they are first used.
_LAZY = {
    "BatchSolution": "itouch_thermal.solver.batch",
    "ContactSolution": "itouch_thermal.solver.exact",
    "LockStep": "itouch_thermal.solver.batch",
    "Stepper": "itouch_thermal.solver.stepper",
    "solve": "itouch_thermal.solver.exact",
    "solve_many": "itouch_thermal.solver.batch",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
