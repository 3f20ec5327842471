"""The flux-control plant as a Gymnasium environment; importing this package registers it."""

from __future__ import annotations

import gymnasium

#: The environment's id for ``gymnasium.make``; prefixed with ``itouch_gym:``, the package is imported first.
NAME = "itouch/FluxControl-v0"

if NAME not in gymnasium.registry:
    gymnasium.register(NAME, entry_point="itouch_gym.env:FluxControlEnv")
