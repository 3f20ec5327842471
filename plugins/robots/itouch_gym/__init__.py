"""The flux-control plant as an environment of Gymnasium, which knows it when this package has been imported."""

from __future__ import annotations

import gymnasium

#: The name by which ``gymnasium.make`` knows it; ``itouch_gym:`` before it imports this package.
NAME = "itouch/FluxControl-v0"

if NAME not in gymnasium.registry:
    gymnasium.register(NAME, entry_point="itouch_gym.env:FluxControlEnv")
