"""A participant's way through a study: which trial is due, from the order and the rows that there are alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from itouch.study.adaptive import Running
from itouch.study.elements import Adaptive
from itouch.study.reading import StudyFile
from itouch.study.store import Row
from itouch.study.trials import Trial, trials_of


@dataclass(frozen=True, slots=True)
class Due:
    """The trial that comes next.

    ``place`` counts the participant's rows, ``repeats`` is the place of the void trial that it repeats, ``shown`` has
    the condition of each interval, and ``level`` is what a staircase asks for.
    """

    trial: Trial
    place: int
    repeats: int | None
    shown: tuple[dict[str, str], ...]
    level: float | None = None


class Course:
    """What has been done and what is due; the same rows lead to the same next trial, whenever they are read."""

    def __init__(self, file: StudyFile, code: str, rows: Iterable[Row] = ()) -> None:
        self._file, self.rows = file, list(rows)
        self.planned = trials_of(file, code)

    def made(self, row: Row) -> None:
        """Note a trial that has ended."""
        self.rows.append(row)

    def next(self) -> Due | None:
        """Return the trial that is due; None: all is done."""
        while (found := next_trial(self.planned, self.rows, self._file.study.contact.repeats)) is not None:
            trial, repeats = found
            if not trial.staircase:
                return Due(trial, len(self.rows), repeats, trial.shown)
            rule = next(one for one in self._file.study.staircases if one.name == trial.staircase)
            running = Running.begin(rule.rule(), told(self.rows, rule.name))
            if not running.finished:
                level = running.level()
                return Due(trial, len(self.rows), repeats, _stepped(trial, rule, level), level)
            self.planned = [each for each in self.planned if each.place != trial.place]
        return None

    @property
    def left(self) -> int:
        """How many trials of the order have not been begun."""
        return max(0, len(self.planned) - sum(row.repeats is None for row in self.rows))


def next_trial(planned: Sequence[Trial], rows: Sequence[Row], repeats: int) -> tuple[Trial, int | None] | None:
    """Return the next trial, and the place of the void one that it repeats; None: all is done."""
    taken = len([row for row in rows if row.repeats is None])
    if taken < len(planned):
        return planned[taken], None
    tries: dict[int, int] = {}
    valid: set[int] = set()
    for row in rows:
        first = row.place if row.repeats is None else row.repeats
        tries[first] = tries.get(first, 0) + 1
        if not row.void:
            valid.add(first)
    firsts = [row for row in rows if row.repeats is None]
    for index, row in enumerate(firsts):
        if row.place not in valid and row.block != "practice" and tries[row.place] <= repeats:
            return planned[index], row.place
    return None


def told(rows: Sequence[Row], staircase: str) -> list[tuple[float, int]]:
    """Return what a staircase was told: (level, answer) of its trials that count."""
    return [
        (row.level, row.right) for row in rows
        if row.staircase == staircase and not row.void and row.block != "practice"
        and row.level is not None and row.right is not None
    ]  # fmt: skip


def _stepped(trial: Trial, rule: Adaptive, level: float) -> tuple[dict[str, str], ...]:
    """Return the conditions of the intervals: the level in one, the standard in the other."""
    return tuple(
        {**trial.condition, rule.name: f"{level if index == trial.target else rule.standard:.9g}"}
        for index in range(len(trial.shown))
    )
