"""The old names of the contact-heat solver, for one version: it is the package `contact_heat` now."""

import sys
import warnings
from importlib import import_module
from pathlib import Path

import contact_heat

warnings.warn(
    "'itouch_thermal.solver' is now the package 'contact_heat': import from there", DeprecationWarning, stacklevel=2
)
# The materials do not belong to the solver: they are in `itouch_thermal.rendering` now.
sys.modules[f"{__name__}.materials"] = materials = import_module("itouch_thermal.rendering.materials")
for _path in sorted(Path(contact_heat.__file__).parent.glob("[a-z]*.py")):
    _module = import_module(f"contact_heat.{_path.stem}")
    sys.modules[f"{__name__}.{_path.stem}"] = _module
    globals()[_path.stem] = _module
