"""Scene -> Model (read-only arrays) and State (one record)."""

from itouch.world.modalities import ModalityModel
from itouch.world.model import Model, ProbeModel, compile_scene, further
from itouch.world.rig import DeviceModel
from itouch.world.state import declared, layout, make_state, truth, undeclared

__all__ = [
    "DeviceModel",
    "ModalityModel",
    "Model",
    "ProbeModel",
    "compile_scene",
    "further",
    "declared",
    "layout",
    "make_state",
    "truth",
    "undeclared",
]
