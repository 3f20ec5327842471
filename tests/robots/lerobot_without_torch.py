"""LeRobot without what makes it heavy: the published base classes, with two modules of it left out that need torch."""

from __future__ import annotations

import importlib.util
import sys
import types
from pathlib import Path

from requirements import missing

ROBOTS = Path(__file__).resolve().parents[2] / "plugins" / "robots"


def lerobot() -> None:
    """Make LeRobot's own ``Teleoperator`` importable; skip where the package is not installed.

    ``lerobot.processor`` imports torch and ``lerobot.motors.motors_bus`` drivers of motors: the base class takes a
    type's name from each, for annotations only.
    """
    for name in ("draccus", "huggingface_hub", "lerobot"):
        if importlib.util.find_spec(name) is None:
            missing(
                f"{name} is not installed: pip install draccus huggingface_hub; pip install --no-deps 'lerobot>=0.4,<0.5'"
            )
    if "torch" not in sys.modules:
        for name, taken in (("lerobot.processor", "RobotAction"), ("lerobot.motors.motors_bus", "MotorCalibration")):
            module = types.ModuleType(name)
            setattr(module, taken, dict)
            sys.modules.setdefault(name, module)
    found()


def found() -> None:
    """Let the distribution be imported from the checkout, as one that is installed is."""
    if str(ROBOTS) not in sys.path:
        sys.path.insert(0, str(ROBOTS))
