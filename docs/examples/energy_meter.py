"""A modality that reads what another one computes: how much heat the finger has given in each touch."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import itouch
from itouch.plugin import (
    Contact,
    ContactEvent,
    Field,
    Measured,
    Modality,
    Record,
    World,
    schema,
)
from itouch.plugin.discovery import Catalog, Found, find


@dataclass(frozen=True, slots=True)
class EnergyMeterParams:
    """What ``<meter:energy>`` may hold."""

    flux_from: str = schema.ref("modality", doc="what computes a heat flux")


class EnergyMeter(Modality):
    """Adds up a heat flux from the start of a touch to its end."""

    Params = EnergyMeterParams
    subscribes_to = frozenset({Contact.BEGIN})
    measured = (Measured("energy", "J/m^2", "heat the finger gave"),)

    def compile(self, name: str, params: EnergyMeterParams, world: World) -> tuple[str, str]:
        """Return the names, in State, of the flux that is read and of the sum that is our own."""
        return f"{params.flux_from}.desired", f"{name}.energy"

    def fields(self, model: tuple[str, str]) -> tuple[Field, ...]:
        """Return the sum."""
        return (Field("energy", unit="J/m^2", doc="heat the finger gave since the touch began"),)

    def reads(self, model: tuple[str, str]) -> tuple[str, ...]:
        """Say what is read: `inspect --plan` shows it."""
        return (model[0],)

    def reset(self, model: tuple[str, str], state: Record) -> None:
        """Begin with nothing."""
        state[model[1]] = 0.0

    def on_contact(self, event: ContactEvent, model: tuple[str, str], state: Record) -> None:
        """Begin anew with each touch."""
        state[model[1]] = 0.0

    def update(self, model: tuple[str, str], state: Record, period: float) -> None:
        """Add this update's heat; before the first touch there is no flux, and it is not a number."""
        flux, energy = state[model[0]].item(), state[model[1]].item()
        state[model[1]] = energy + period * flux if flux == flux else energy

    def measures(
        self, model: tuple[str, str], state: Record, probe: str, object_index: int
    ) -> dict[str, float | str | bool | None]:
        """Return what the report shall say of the touch that has ended."""
        return {"energy": state[model[1]].item()}


def offered(group: str) -> Mapping[str, Found]:
    """Return the installed plugins, and this modality as if it were installed."""
    entry = metadata.EntryPoint("meter.energy", f"{__name__}:EnergyMeter", group)
    mine = {"meter.energy": Found("meter.energy", "energy-meter", "1", entry)} if "modalities" in group else {}
    return {**find(group), **mine}


if __name__ == "__main__":
    shipped = Path(itouch.__file__).parents[2] / "scenes" / "four_materials.xml"
    text = shipped.read_text(encoding="utf-8").replace('file="', 'file="itouch:')
    text = text.replace("xmlns:thermal=", 'xmlns:meter="urn:itouch:plugin:meter" xmlns:thermal=')
    text = text.replace("</interaction>", '<meter:energy flux-from="heat"/></interaction>')
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "metered.xml"
        scene.write_text(text, encoding="utf-8")
        session = itouch.build(scene, seed=1, catalog=Catalog(offered))
    session.run(19.0)
    for touch in session.report()["contacts"][:2]:
        print(f"{touch['object']}: {touch['energy'] / 1e3:.1f} kJ/m2")
