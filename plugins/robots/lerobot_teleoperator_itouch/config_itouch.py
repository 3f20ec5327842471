"""The options of the teleoperator."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.teleoperators.config import TeleoperatorConfig


@TeleoperatorConfig.register_subclass("itouch")
@dataclass(kw_only=True)
class ItouchTeleopConfig(TeleoperatorConfig):
    """An arm, by its device plugin or by a scene.

    Attributes
    ----------
    plugin
        Name of a device plugin, as ``itouch-py devices`` lists it; ignored if a scene is named.
    scene
        A scene with one arm, to which none of its probes sends a force; empty: one is made for the plugin.
    simulated
        Whether the arm is replaced by its simulated twin.
    force
        The greatest force [N] that the operator feels.
    """

    plugin: str = "usb-arm"
    scene: str = ""
    simulated: bool = False
    force: float = 3.0
