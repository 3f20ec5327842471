"""Figures of a touch in a study's data, with unit and meaning: the framework's, and those that plugins declare."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping

from itouch.plugin import Measured
from itouch.plugin.discovery import Catalog, PluginError

#: The figures that a study itself takes of each touch: flux and skin where fields declare them, and the force.
FLUX, SKIN, BACK, DROP, FORCE = OWN = (
    Measured(
        "mean_flux_W_m2", "W/m^2", "mean heat flux out of the finger in the first second", "flux of the first second",
        digits=0,
    ),
    Measured("skin_begin_degC", "degC", "temperature of the skin at the touch", "skin before", digits=1),
    Measured(
        "skin_back", "1", "whether the skin was back at its baseline before the touch; null: nothing measured it",
        "skin back",
    ),
    Measured("skin_drop_K", "K", "fall of the skin's temperature in the touch", "skin fell by"),
    Measured("peak_force_N", "N", "greatest force on the finger", "force"),
)  # fmt: skip


def known(catalog: Catalog | None = None) -> Mapping[str, Measured]:
    """Return the figures by key: the study's own first, then those of the plugins that are installed."""
    found = {one.key: one for one in OWN}
    catalog = catalog or Catalog()
    for plugin in catalog.plugin_names:
        for local in catalog.modality_names(plugin):
            with contextlib.suppress(PluginError):  # a plugin that cannot be loaded declares nothing
                modality = catalog.modality(plugin, local)
                for one in modality.measured if modality is not None else ():
                    found.setdefault(one.key, one)
    return found


def meaning(key: str, known: Mapping[str, Measured]) -> tuple[str, str]:
    """Return the unit of a figure, which may be empty, and the sentence that says what it is."""
    one = known.get(key, known.get(key.rpartition(":")[2]))  # NAME:key: of several modalities
    return (one.unit, one.doc) if one is not None else ("", "figure of a plugin that is not installed")
