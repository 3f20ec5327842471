"""Any itouch arm as a teleoperator of LeRobot: its pose and buttons as actions, forces as feedback."""

from lerobot_teleoperator_itouch.config_itouch import ItouchTeleopConfig
from lerobot_teleoperator_itouch.itouch_teleop import ItouchTeleop

__all__ = ["ItouchTeleop", "ItouchTeleopConfig"]
