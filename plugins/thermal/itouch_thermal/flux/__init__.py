"""Flux control: the one current that makes the finger feel the flux that the real object would draw."""

from itouch_thermal.flux.flux_control_params import FluxControlParams
from itouch_thermal.flux.modality import FluxControl

__all__ = ["FluxControl", "FluxControlParams"]
