"""Prompts for an operator at a terminal: when to press, to hold and to lift."""

from __future__ import annotations

import sys

import numpy as np

from itouch_thermal.measuring.touches import BASE, LASTS, TOUCHED, Wanted, pressed


class Prompts:
    """Tells the operator what to do, and ends the measurement after enough good touches."""

    def __init__(self, wanted: Wanted, repeat: int) -> None:
        self._wanted, self._repeat = wanted, repeat
        self._done, self._told = 0, ""
        #: Time since which nothing has touched [s], time since which the force has been low, times and forces of this
        #: touch.
        self._free: float | None = None
        self._low: float | None = None
        self._touch: list[tuple[float, float]] = []

    def __call__(self, time: float, force: float) -> bool:
        """Record a force; return whether all touches are done."""
        free = self._free = time if self._free is None else self._free
        if force > TOUCHED:
            self._low = None
            self._touch.append((time, force))
        elif self._touch:
            self._low = time if self._low is None else self._low
            if time - self._low >= LASTS - 1e-9:
                self._over(time, free)
        if self._done >= self._repeat:
            return True
        self._say(self._words(time))
        return False

    def _words(self, time: float) -> str:
        if self._touch:
            held = time - self._touch[0][0] < self._wanted.duration
            return f"hold for {self._wanted.duration:g} s" if held else _LIFT
        if self._free is not None and time - self._free < BASE:
            return _LIFT if self._told == _LIFT else "keep the finger off"
        return f"touch {self._done + 1} of {self._repeat}: press with {self._wanted.force:g} N"

    def _over(self, time: float, free: float) -> None:
        """Count a touch that has ended, or say why it does not count."""
        at, force = np.array(self._touch).T
        self._touch, self._low = [], None
        if at[-1] - at[0] < LASTS:
            return  # too short to be a touch
        self._free = time
        why = self._wanted.why_not_held(float(at[0]) - free, float(at[-1] - at[0]), pressed(at - at[0], force))
        if why:
            self._say(f"that one does not count: {why}")
        else:
            self._done += 1

    def _say(self, words: str) -> None:
        if words != self._told:
            self._told = words
            print(words, file=sys.stderr, flush=True)


_LIFT = "lift the finger, and wait until the sample has recovered"
