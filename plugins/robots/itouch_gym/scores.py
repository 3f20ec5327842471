"""The scores of three controllers on the same episodes: no current, a baseline, and itouch-py's own."""

from __future__ import annotations

import argparse
import json

import numpy as np

from itouch_gym.env import SKIN
from itouch_gym.plant import EPISODE, FLUX, MATERIALS, STEP, Plant

#: Gains of the baseline.  In contact: share of the greatest current per unit of flux error, and per unit of its
#: integral over a second.  Without contact: per 10 K of the plate's temperature above 30 degC.
PROPORTIONAL, INTEGRAL, FREE = 0.3, 0.5, 0.5


class Baseline:
    """A PI controller on the measured flux while the finger touches; otherwise it keeps the plate at 30 degC."""

    def __init__(self) -> None:
        self._sum = 0.0

    def act(self, seen: np.ndarray) -> float:  # type: ignore[type-arg]
        """Return the share of the greatest current, -1 to 1, for an observation; a positive one cools the plate."""
        plate, flux, wanted, touching = float(seen[0]), float(seen[3]), float(seen[4]), bool(seen[5])
        if not touching:
            self._sum = 0.0
            return float(np.clip(FREE * plate, -1.0, 1.0))
        error = wanted - flux
        self._sum = float(np.clip(self._sum + INTEGRAL * error * STEP, -1.0, 1.0))
        return float(np.clip(PROPORTIONAL * error + self._sum, -1.0, 1.0))


def score(name: str, material: str, skin: float, seed: int) -> tuple[float, bool]:
    """Return the sum of an episode's rewards, and whether it tripped."""
    plant, baseline = Plant(material, skin, seed, own=name == "own"), Baseline()
    total = 0.0
    try:
        for _ in range(round(EPISODE / STEP)):
            share = baseline.act(plant.seen()) if name == "baseline" else 0.0
            cost, tripped = plant.step(share * plant.most)
            total -= cost
            if tripped:
                return total - 10.0, True
    finally:
        plant.close()
    return total, False


def main() -> None:
    """Print the scores."""
    parser = argparse.ArgumentParser(prog="python -m itouch_gym.scores", description=main.__doc__)
    parser.add_argument("--episodes", type=int, default=4, metavar="N", help="episodes of each controller (default 4)")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    drawn = [(MATERIALS[k % len(MATERIALS)], float(rng.uniform(*SKIN)), int(rng.integers(2**31)))
             for k in range(options.episodes)]  # fmt: skip
    rows = {}
    for name in ("none", "baseline", "own"):
        found = [score(name, *episode) for episode in drawn]
        rows[name] = {"mean": float(np.mean([total for total, _ in found])), "tripped": sum(trip for _, trip in found),
                      "each": [total for total, _ in found]}  # fmt: skip
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    print(
        f"sum of rewards over {EPISODE:g} s, mean of {options.episodes} episodes (0 is best; units of {FLUX:g} W/m^2)"
    )
    for name, row in rows.items():
        print(f"{name:<10} {row['mean']:>10.2f}   trips {row['tripped']}")


if __name__ == "__main__":
    main()
