"""What ``<thermal:flux-control>`` may hold."""

from __future__ import annotations

from dataclasses import dataclass

from itouch.plugin import schema

#: What the display must read.
READS = ("plate_temperature", "sink_temperature", "heat_flux")


@dataclass(frozen=True, slots=True)
class FluxControlParams:
    """Controls the display's current so that the finger feels the desired flux."""

    display: str = schema.ref("device", reads=READS, commands=("current",), doc="the thermal display")
    desired_from: str = schema.ref("modality", doc="what computes the desired flux")
    controller: str = schema.choice(
        "model", "paper", "hold", default="model", doc="ours, the paper's, or its start temperature alone"
    )
    force_from: str = schema.ref(
        "device", reads=("wrench",), default="", doc="what measures the force on the plate; default: who can"
    )
    proportional: float = schema.quantity("", low=0.0, high=1e4, default=40.0, doc="gain of `paper`")
    integral: float = schema.quantity("Hz", low=0.0, high=1e5, default=100.0, doc="integral gain of `paper`")
