"""The flux-control plant against Gymnasium's own checker, and what controllers score on it."""

from __future__ import annotations

import importlib.util
import warnings
from typing import Any

import numpy as np
import pytest
from lerobot_without_torch import found
from requirements import missing

pytestmark = pytest.mark.long


def need_gymnasium() -> None:
    """Skip where Gymnasium is not installed."""
    if importlib.util.find_spec("gymnasium") is None:
        missing("gymnasium is not installed: pip install 'gymnasium>=1.0,<2'")


@pytest.fixture(scope="module")
def gymnasium() -> Any:
    found()
    need_gymnasium()
    import gymnasium as module

    module.make("itouch_gym:itouch/FluxControl-v0").close()  # as a user does who has not imported it
    return module


def test_gymnasium_finds_nothing_wrong(gymnasium: Any) -> None:
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make("itouch/FluxControl-v0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


def test_an_episode_ends_by_its_time_and_is_the_same_with_the_same_seed(gymnasium: Any) -> None:
    runs = []
    for _ in range(2):
        env = gymnasium.make("itouch/FluxControl-v0")
        seen, said = env.reset(seed=5, options={"material": "wood"})
        rows, ended, total, steps = [seen], False, 0.0, 0
        while not ended:
            seen, reward, tripped, late, _ = env.step(np.array([0.1 * np.sin(0.05 * steps)], np.float32))
            rows.append(seen)
            total, steps, ended = total + reward, steps + 1, tripped or late
        assert steps == 325 and not tripped and total < 0.0 and said["material"] == "wood"
        runs.append(np.array(rows))
        env.close()
    assert (runs[0] == runs[1]).all() and runs[0][:, 5].any()


def test_a_plate_that_is_driven_too_far_is_kept_in_its_limits(gymnasium: Any) -> None:
    env = gymnasium.make("itouch/FluxControl-v0")
    env.reset(seed=1)
    ended, coldest = False, 0.0
    while not ended:
        seen, _, tripped, late, said = env.step(np.array([1.0], np.float32))
        coldest, ended = min(coldest, float(seen[0])), tripped or late
        assert said["tripped"] == tripped
    assert 303.15 + 10.0 * coldest > 288.15 - 3.0
    env.close()


def test_itouchs_controller_beats_the_baseline_which_beats_nothing() -> None:
    found()
    need_gymnasium()
    from itouch_gym.scores import score

    episodes = [("aluminium", 33.0, 3), ("wood", 32.0, 4)]
    none, baseline, own = (
        sum(score(name, *episode)[0] for episode in episodes) for name in ("none", "baseline", "own")
    )
    assert own > baseline > none
