"""A participant's progress: which trial is due, void ones again, from the order and the rows so far alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from itouch_tools.study.adaptive import Running
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_elements import PRACTICE, Adaptive
from itouch_tools.study.study_store import Row, StoreError
from itouch_tools.study.trials import Trial, trials_of


@dataclass(frozen=True, slots=True)
class NextTrial:
    """The trial that comes next.

    ``place`` counts the participant's rows, ``repeats`` is the place of the void trial that it repeats, ``shown`` has
    the condition of each interval, and ``level`` is the level for which a staircase asks.
    """

    trial: Trial
    place: int
    repeats: int | None
    shown: tuple[dict[str, str], ...]
    level: float | None = None


class Course:
    """What has been done and what is due; the same rows lead to the same next trial, whenever they are read.

    Raises
    ------
    StoreError
        If rows are missing before others: nobody could tell which trial of the order each was.
    """

    def __init__(self, file: StudyFile, code: str, rows: Iterable[Row] = ()) -> None:
        self._file, self.rows = file, list(rows)
        for place, row in enumerate(self.rows):
            if row.place != place:
                raise StoreError(
                    f"trial {place + 1} of {code} is missing in the data, though later ones are there: its row was "
                    "deleted; take trials.sqlite as a backup has it (a trial that is not to count has its reason in "
                    "the column 'void')"
                )
        self.planned = trials_of(file, code)

    def made(self, row: Row) -> None:
        """Note the row of a trial that has ended."""
        self.rows.append(row)

    def next(self) -> NextTrial | None:
        """Return the trial that is due; None: all are done."""
        begun = _begun(self.planned, self.rows)
        for trial in self.planned[begun[-1] + 1 if begun else 0 :]:
            if (due := self._due(trial, None)) is not None:
                return due
        firsts = [row.place for row in self.rows if row.repeats is None]
        for place in _to_repeat(self.rows, self._file.study.contact.repeats):
            if (due := self._due(self.planned[begun[firsts.index(place)]], place)) is not None:
                return due
        return None

    def comes_again(self, row: Row) -> bool:
        """Tell whether the trial of a void row is tried again."""
        first = row.place if row.repeats is None else row.repeats
        return first in _to_repeat(self.rows, self._file.study.contact.repeats)

    def _due(self, trial: Trial, repeats: int | None) -> NextTrial | None:
        """Return a trial as it is due now; None: its staircase has ended."""
        place = len(self.rows)
        if not trial.staircase:
            return NextTrial(trial, place, repeats, trial.shown)
        running = self._running(trial.staircase)
        if running.finished:
            return None
        level = running.level()
        rule = next(one for one in self._file.study.staircases if one.name == trial.staircase)
        return NextTrial(trial, place, repeats, _stepped(trial, rule, level), level)

    def _running(self, name: str) -> Running:
        rule = next(one for one in self._file.study.staircases if one.name == name)
        return Running.begin(rule.rule(), told(self.rows, name))

    @property
    def left(self) -> int:
        """How many trials of the order have not begun; staircases count with the most trials that they may take."""
        begun = _begun(self.planned, self.rows)
        rest = self.planned[begun[-1] + 1 if begun else 0 :]
        ended = {name for name in {each.staircase for each in rest} if name and self._running(name).finished}
        return sum(each.staircase not in ended for each in rest)


def _begun(planned: Sequence[Trial], rows: Sequence[Row]) -> list[int]:
    """Return, for each row that is no repetition, the index of its trial in the order.

    A trial of the order is passed over only if its staircase has ended, so a row belongs to the next one of its own
    staircase.
    """
    found: list[int] = []
    at = 0
    for row in rows:
        if row.repeats is not None:
            continue
        while at < len(planned) - 1 and planned[at].staircase != (row.staircase or ""):
            at += 1
        found.append(min(at, len(planned) - 1))
        at += 1
    return found


def _to_repeat(rows: Sequence[Row], repeats: int) -> Iterator[int]:
    """Yield the places of void trials that are to be repeated, in their order."""
    tries: dict[int, int] = {}
    valid: set[int] = set()
    for row in rows:
        first = row.place if row.repeats is None else row.repeats
        tries[first] = tries.get(first, 0) + 1
        if not row.void:
            valid.add(first)
    for row in rows:
        if row.repeats is None and row.place not in valid and row.block != PRACTICE and tries[row.place] <= repeats:
            yield row.place


def told(rows: Sequence[Row], staircase: str) -> list[tuple[float, int]]:
    """Return what a staircase was told: pairs (level, answer) of its trials that count."""
    return [
        (row.level, row.right) for row in rows
        if row.staircase == staircase and not row.void and row.block != PRACTICE
        and row.level is not None and row.right is not None
    ]  # fmt: skip


def _stepped(trial: Trial, rule: Adaptive, level: float) -> tuple[dict[str, str], ...]:
    """Return the conditions of the intervals: the level in one, the standard in the other."""
    return tuple(
        {**trial.condition, rule.name: f"{level if index == trial.target else rule.standard:.9g}"}
        for index in range(len(trial.shown))
    )
