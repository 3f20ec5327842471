"""The environment: the action is a current, fifty times a second; the reward is for matching the desired heat flux."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from itouch_gym.plant import EPISODE, MATERIALS, STEP, Plant

#: The reward of a step that trips, and the range of the skin's temperature at the start [degC].
TRIPPED, SKIN = -10.0, (31.0, 34.0)


class FluxControlEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A finger presses a display that is to produce the heat flux of a material.

    ``reset`` takes ``options={"material": NAME, "skin": degC}``; what is not given is drawn at random.
    """

    metadata = {"render_modes": [], "render_fps": 50}

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = spaces.Box(-10.0, 10.0, (7,), np.float32)
        self._plant: Plant | None = None
        self._last, self._steps = 0.0, 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        given = options or {}
        material = given.get("material", MATERIALS[int(self.np_random.integers(len(MATERIALS)))])
        skin = float(given.get("skin", self.np_random.uniform(*SKIN)))
        self.close()
        self._plant = Plant(material, skin, int(self.np_random.integers(2**31)))
        self._last, self._steps = 0.0, 0
        return self._seen(), {"material": material, "skin": skin}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold a current for 20 ms."""
        if self._plant is None:
            raise gymnasium.error.ResetNeeded("reset begins an episode")
        self._last = float(np.clip(action[0], -1.0, 1.0))
        cost, tripped = self._plant.step(self._last * self._plant.most)
        self._steps += 1
        reward = TRIPPED if tripped else -cost
        return self._seen(), reward, tripped, self._steps >= round(EPISODE / STEP), {"cost": cost, "tripped": tripped}

    def _seen(self) -> NDArray[np.float32]:
        assert self._plant is not None  # noqa: S101
        return np.append(self._plant.seen(), np.float32(self._last))

    def close(self) -> None:
        """End the session."""
        plant, self._plant = self._plant, None
        if plant is not None:
            plant.close()
