"""Flux control: the one current that makes the finger feel the flux that the real object would draw."""

from itouch_thermal.flux.modality import FluxControl, FluxControlParams

__all__ = ["FluxControl", "FluxControlParams"]
