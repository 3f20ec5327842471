"""Can the condition be guessed from anything but the contact's heat and force?  A classifier tries, over many trials.

Trials run through the same machine and scene switcher as a participant's.  The features of each are how long the phases
before the touch and after the answer lasted, how the table moved and sounded (its acceleration), how noisy the
display's current was, and what the screens showed: they draw a face, which holds no condition, so its changes stand for
pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Role
from itouch.plugin.discovery import Catalog
from itouch.session import Session
from itouch_tools.study import orders
from itouch_tools.study import statistics as stats
from itouch_tools.study.machine import Machine, Phase
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.scene_switching import SceneSwitcher
from itouch_tools.study.touches import rules_of

#: Folds of the cross-validation, quantile bins of a feature, and ridge penalty of the discriminant.
FOLDS, BINS, RIDGE = 5, 6, 1.0
#: How far above chance the upper bound of a blind study's accuracy may be.
MARGIN = 0.05

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Guess:
    """How often the condition was guessed from a group of features: ``accuracy`` with its 95 % interval, and chance."""

    features: str
    trials: int
    accuracy: float
    low: float
    high: float
    chance: float

    @property
    def blind(self) -> bool:
        """Whether the upper bound is at most `MARGIN` above chance."""
        return self.high <= self.chance + MARGIN

    @property
    def leaks(self) -> bool:
        """Whether the lower bound is above chance."""
        return self.low > self.chance


def guess(labels: Sequence[str], table: Floats, *, name: str = "all", seed: int = 1) -> Guess:
    """Return how often a ridge discriminant on quantile bins guesses labels that it has not seen.

    Parameters
    ----------
    labels
        Condition of each trial.
    table
        Features, shape (trials, features), each in a unit of its own.
    name
        Name of the group of features.
    seed
        Seed of the folds.
    """
    kinds, codes = np.unique(np.asarray(labels, str), return_inverse=True)
    count = len(codes)
    chance = float(np.bincount(codes).max() / count) if count else math.nan
    binned = np.column_stack([_bins(column) for column in table.T]) if table.shape[1] else np.zeros((count, 0))
    folds = np.random.default_rng(seed).permutation(count) % FOLDS
    right = 0
    for fold in range(FOLDS):
        train, test = folds != fold, folds == fold
        if test.any() and train.any():
            right += int((_fitted(binned[train], codes[train], len(kinds))(binned[test]) == codes[test]).sum())
    low, high = stats.wilson(right, count)
    return Guess(name, count, right / count if count else math.nan, low, high, chance)


def _bins(column: Floats) -> Floats:
    """Return membership in quantile bins, shape (trials, up to BINS), so that any form of dependence can be found."""
    edges = np.unique(np.quantile(column, np.linspace(0.0, 1.0, BINS + 1)[1:-1]))
    member = np.searchsorted(edges, column, side="left")
    return np.asarray(member[:, None] == np.arange(len(edges) + 1), float)


def _fitted(table: Floats, codes: NDArray[np.intp], kinds: int) -> Callable[[Floats], NDArray[np.intp]]:
    """Return a classifier: ridge regression onto the classes' indicators, of which the greatest is taken."""
    mean = table.mean(axis=0)
    design = np.column_stack([table - mean, np.ones(len(table))])
    wanted = (codes[:, None] == np.arange(kinds)).astype(float)
    penalty = RIDGE * np.eye(design.shape[1])
    penalty[-1, -1] = 0.0
    weights = np.linalg.solve(design.T @ design + penalty, design.T @ wanted)

    def classes(rows: Floats) -> NDArray[np.intp]:
        return np.asarray(np.argmax(np.column_stack([rows - mean, np.ones(len(rows))]) @ weights, axis=1))

    return classes


class _ApproachSignals:
    """Follows what can be seen and heard of the machines until the touch, as means over the ticks before it."""

    def __init__(self, session: Session) -> None:
        model, state = session.model, session.state
        self._places: list[Any] = []
        self._currents: list[Any] = []
        for device in model.devices.values():
            if device.command(Role.SURFACE_POSE) is not None and (pose := device.reading(Role.TRACKED_POSE)):
                self._places.append(state[f"{device.name}.{pose.name}"])
            if drive := device.command(Role.DRIVE):
                self._currents.append(state[f"{device.name}.sent.{drive.name}"])
        self._before: Floats = np.zeros(0)
        self._step: Floats = np.zeros(0)
        self.sums = np.zeros(4)  # ticks, speed, acceleration, change of current
        self.last = np.zeros(0)

    def hear(self) -> None:
        """Take one tick."""
        places = [np.asarray(place, float).reshape(-1)[:3] for place in self._places]
        currents = [np.asarray(current, float).reshape(-1) for current in self._currents]
        now = np.concatenate([*places, *currents]) if places or currents else np.zeros(1)
        if len(self._before) == len(now):
            step = now - self._before
            split = 3 * len(places)
            self.sums[0] += 1.0
            self.sums[1] += float(np.abs(step[:split]).sum())
            if len(self._step):
                change = np.abs(step - self._step)
                self.sums[2] += float(change[:split].sum())
                self.sums[3] += float(change[split:].sum())
            self._step = step
        self._before = now

    def told(self) -> tuple[float, float, float]:
        """Return the mean speed, acceleration and change of current, per tick."""
        ticks = max(1.0, self.sums[0])
        return self.sums[1] / ticks, self.sums[2] / ticks, self.sums[3] / ticks


#: Names of the features, by group.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "timing": ("wait for the skin", "approach", "signal to touch", "pause"),
    "motion": ("table speed",), "sound": ("table acceleration", "current noise"), "screen": ("faces", "void"),
}  # fmt: skip


def observe(
    file: StudyFile, catalog: Catalog, trials: int, *, seed: int = 1, told: Callable[[int], None] = lambda count: None
) -> tuple[list[str], Floats]:  # fmt: skip
    """Run trials on the twins, and return the condition of each and its features, shape (trials, features).

    The order is random and balanced; reaction times do not depend on the condition.
    """
    rng = orders.generator(seed, "audit")
    conditions = file.conditions()
    order = [int(index) for _ in range(-(-trials // len(conditions))) for index in rng.permutation(len(conditions))]
    switcher = SceneSwitcher(file, catalog, seed=seed)
    labels: list[str] = []
    table: list[list[float]] = []
    try:
        for count, index in enumerate(order[:trials]):
            condition = conditions[index]
            labels.append(", ".join(condition.values()))
            table.append(_features(file, switcher, condition, float(rng.gamma(4.0, 0.25))))
            told(count + 1)
    finally:
        switcher.close()
    return labels, np.array(table)


def _features(file: StudyFile, switcher: SceneSwitcher, condition: Mapping[str, str], reaction: float) -> list[float]:
    """Run one trial, and return its features in the order of `GROUPS`."""
    feeling = switcher.present(condition)
    machine, ear = Machine(rules_of(file.study, feeling.index, 1, None)), _ApproachSignals(switcher.session)
    lasted = dict.fromkeys(Phase, 0.0)
    faces = 0

    def until() -> bool:
        before = machine.phase
        if before in (Phase.SKIN, Phase.APPROACH, Phase.GO):
            ear.hear()
        lasted[before] += switcher.session.model.period
        machine.step(switcher.sensed())
        if machine.phase is Phase.ANSWER and machine.since() >= reaction:
            machine.answered()
        return machine.phase is not before

    while machine.phase is not Phase.END:
        switcher.run(until)
        faces += 1
        if machine.phase is Phase.GO:
            switcher.go()
        elif machine.phase is Phase.JUDGE:
            machine.judged("")  # only the contact's heat and force could make it void, and they do not count here
    speed, acceleration, current = ear.told()
    timing = [lasted[phase] for phase in (Phase.SKIN, Phase.APPROACH, Phase.GO, Phase.PAUSE)]
    sound = [_coarse(acceleration), _coarse(current)]  # masking noise is the laboratory's: it does not count here
    return [*(round(each, 6) for each in timing), _coarse(speed), *sound, float(faces), float(bool(machine.void))]


def _coarse(value: float) -> float:
    """Return a level [dB] in steps of 1 dB, about the smallest audible difference; -200 for silence."""
    return float(round(20.0 * math.log10(value))) if value > 1e-10 else -200.0


def judged(labels: Sequence[str], table: Floats, *, seed: int = 1) -> list[Guess]:
    """Return how often the condition is guessed from all features, and from each group alone.

    ``table`` (trials, features), the columns in the order of `GROUPS`; each in a unit of its own.
    """
    found, at = [guess(labels, table, seed=seed)], 0
    for name, features in GROUPS.items():
        found.append(guess(labels, table[:, at : at + len(features)], name=name, seed=seed))
        at += len(features)
    return found


def without_blind(file: StudyFile) -> StudyFile:
    """Return the study without its ``<blind>``: an audit must be able to find leaks in it."""
    return replace(file, study=replace(file.study, blind=None))
