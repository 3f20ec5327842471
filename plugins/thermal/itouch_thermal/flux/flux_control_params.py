"""Attributes and child elements of ``<thermal:flux-control>``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.plugin import Role, schema

#: Roles that readings of the display must have, whatever their names.
READS = (Role.SKIN_CONTACT_TEMPERATURE, Role.HEAT_SINK_TEMPERATURE, Role.HEAT_FLUX)


@dataclass(frozen=True, slots=True)
class MaterialCurve:
    """A recorded flux curve for the objects of one material."""

    TAG: ClassVar[str] = "curve"

    material: str = schema.ref("material", doc="material of the objects that it is for")
    file: str = schema.text(doc="CSV file with columns t and j, in the scene's folder")


@dataclass(frozen=True, slots=True)
class FluxControlParams:
    """Controls the display so that the finger feels the desired flux."""

    display: str = schema.ref("device", reads=READS, doc="the thermal display")
    desired_from: str = schema.ref(
        "modality",
        default="",
        doc="the modality that computes the desired flux; may be omitted only where recorded curves give it",
    )
    target: str = schema.choice(
        "desired", "file", default="desired", doc="the flux that `desired-from` computes, or a recorded curve"
    )
    file: str = schema.text(
        default="", doc="with target `file`: CSV file with columns t and j, in the scene's folder, for all objects"
    )
    controller: str = schema.choice(
        "model",
        "paper",
        "hold",
        default="model",
        doc="model: with estimator and prediction; paper: the paper's; hold: the start temperature alone",
    )
    force_from: str = schema.ref(
        "device",
        reads=(Role.CONTACT_FORCE,),
        default="",
        doc="device that measures the force on the plate; default: the one at this finger that can",
    )
    contact_resistance: float = schema.quantity(
        "m^2*K/W",
        low=0.0,
        high=1.0,
        default=0.0,
        doc="of finger and plate, from which `model` begins to learn; 0: that which the display states",
    )
    equalise: bool = schema.flag(
        default=False,
        doc="whether the plate is ready after the same time for every material, so that the wait does not reveal it",
    )
    preset_time: float = schema.quantity(
        "s",
        low=0.0,
        high=60.0,
        default=0.0,
        doc="that time; 0: as long as the longest switch between two objects takes",
    )
    preset_noise: float = schema.quantity(
        "A",
        low=0.0,
        high=1.0,
        default=0.0,
        doc="noise on the current before a touch, which covers the noise of the controller",
    )
    condensation: str = schema.choice(
        "warn", "avoid", default="warn", doc="below the dew point: warn, or keep the plate 1 K above it"
    )
    proportional: float = schema.quantity("", low=0.0, high=1e4, default=40.0, doc="gain of `paper`")
    integral: float = schema.quantity("Hz", low=0.0, high=1e5, default=800.0, doc="integral gain of `paper`")
    curves: tuple[MaterialCurve, ...] = schema.children(MaterialCurve, doc="curves of single materials")

    def __post_init__(self) -> None:
        schema.validate(self)
        if self.target == "file":
            if not self.file and not self.curves:
                raise ValueError("target=\"file\" needs the attribute 'file', or a <curve> for each material")
        elif self.file or self.curves:
            raise ValueError('a flux curve is given, but the target is not: write target="file"')
        elif not self.desired_from:
            raise ValueError("the attribute 'desired-from' must say what computes the desired flux")
        if self.preset_time and not self.equalise:
            raise ValueError('preset-time goes with equalise="yes"')
        if self.preset_noise and not self.equalise:
            raise ValueError('preset-noise goes with equalise="yes"')
        if self.contact_resistance and self.controller != "model":
            raise ValueError('contact-resistance goes with controller="model": the others know none')
        materials = [curve.material for curve in self.curves]
        twice = next((name for name in materials if materials.count(name) > 1), "")
        if twice:
            raise ValueError(f"material '{twice}' has two curves")
