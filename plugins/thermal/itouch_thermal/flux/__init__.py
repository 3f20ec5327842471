"""Flux control: the one current that makes the finger feel the flux that the real object would draw."""

from itouch_thermal.flux.modality import FluxControl
from itouch_thermal.flux.params import FluxControlParams

__all__ = ["FluxControl", "FluxControlParams"]
