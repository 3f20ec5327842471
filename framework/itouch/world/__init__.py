"""Scene -> Model (read-only arrays) and State (one record)."""

from itouch.world.modalities import ModalityModel
from itouch.world.model import Model, ProbeModel, Survey, accepted, compile_scene, survey
from itouch.world.rig import DeviceModel
from itouch.world.state import declared, layout, make_state, truth, undeclared

__all__ = [
    "DeviceModel",
    "ModalityModel",
    "Model",
    "ProbeModel",
    "Survey",
    "accepted",
    "compile_scene",
    "declared",
    "layout",
    "make_state",
    "survey",
    "truth",
    "undeclared",
]
