"""The flux-control plant as an environment of Gymnasium."""

from __future__ import annotations

#: The name by which ``gymnasium.make`` knows it.
NAME = "itouch/FluxControl-v0"


def register() -> None:
    """Make the environment known to Gymnasium, once."""
    import gymnasium

    if NAME not in gymnasium.registry:
        gymnasium.register(NAME, entry_point="itouch_gym.env:FluxControlEnv")
