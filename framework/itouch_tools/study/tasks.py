"""What a participant is asked in each task, may answer, and which answer is right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from itouch_tools.study.plugin_tasks import task_of
from itouch_tools.study.study_elements import TASKS, Study, Task
from itouch_tools.study.trials import Trial

_ORDINALS = ("the first", "the second", "the third")
#: The question of each task whose study does not ask its own.
_QUESTIONS = {
    "identify": "What was it?", "colder": "Which was colder?", "odd": "Which was the odd one?",
    "same": "Were they the same?", "rate": "How cold was it?",
}  # fmt: skip


def question_of(study: Study) -> str:
    """Return what the participant is asked."""
    kind = study.task.kind
    return study.task.question or (_QUESTIONS[kind] if kind in _QUESTIONS else task_of(kind).question)


def choices_of(study: Study) -> tuple[tuple[str, str], ...]:
    """Return the possible answers, as pairs (as kept, as shown); none: any number is an answer."""
    task = study.task
    names = next((factor.names for factor in study.factors if factor.name == task.factor), ())
    if task.kind not in TASKS:
        return task_of(task.kind).choices(names)
    if task.kind == "identify":
        return tuple((name, name) for name in names)
    if task.kind in ("colder", "odd"):
        return tuple((str(index), _ORDINALS[index]) for index in range(task.intervals))
    return (("same", "the same"), ("different", "different")) if task.kind == "same" else ()


def taken_answer(study: Study, written: str) -> str | None:
    """Return an answer as it is kept, given the kept or the shown word, or its number from 1; None: not an answer."""
    wanted, choices = written.strip().casefold(), choices_of(study)
    for kept, shown in choices:
        if wanted in (shown.casefold(), kept.casefold() if not kept.isdecimal() else shown.casefold()):
            return kept
    if choices:
        number = int(wanted) if wanted.isascii() and wanted.isdecimal() else 0
        return choices[number - 1][0] if 1 <= number <= len(choices) else None
    try:
        value = float(wanted.replace(",", "."))
    except ValueError:
        return None
    return repr(value) if math.isfinite(value) else None


def is_right(task: Task, trial: Trial, answer: str, fluxes: Sequence[float | None]) -> int | None:
    """Return 1 for the right answer, 0 for a wrong one, None if there is no right one.

    ``fluxes`` [W/m2] are the mean fluxes of the intervals, None where nothing tells them: the coldest is the one with
    the greatest.  Where they are not known, a staircase goes by the levels that ``trial`` has shown.
    """
    if task.kind not in TASKS:
        return task_of(task.kind).right(answer, _told(task, trial, [flux or 0.0 for flux in fluxes]))
    if task.kind == "identify":
        return int(answer == trial.condition[task.factor])
    if task.kind in ("colder", "odd") and not trial.staircase and all(one == trial.shown[0] for one in trial.shown):
        return None  # all intervals showed the standard: nothing distinguishes them
    if task.kind == "colder":
        more = _most(trial, fluxes)
        return None if more is None else int(int(answer) == more)
    if task.kind == "odd":
        return int(int(answer) == trial.target)
    if task.kind == "same":
        return int((answer == "same") == (trial.condition[task.factor] == task.standard))
    return None


def _most(trial: Trial, fluxes: Sequence[float | None]) -> int | None:
    """Return the interval with the greatest flux, or of a staircase's trial without fluxes that with the highest level.

    None: neither is known.  Of equal levels it is the one that the trial asks for: the answers are at chance then, as
    they are with the noise of equal fluxes.
    """
    known = [flux for flux in fluxes if flux is not None]
    if known and len(known) == len(fluxes):
        return known.index(max(known))
    if not trial.staircase:
        return None
    levels = [float(one[trial.staircase]) for one in trial.shown]
    return trial.target if len(set(levels)) == 1 else levels.index(max(levels))


def _told(task: Task, trial: Trial, fluxes: Sequence[float]) -> dict[str, Any]:
    """Return what a plugin's task is told of a trial."""
    return {
        "levels": [condition.get(task.factor) for condition in trial.shown], "target": trial.target,
        "standard": task.standard, "condition": dict(trial.condition), "flux_W_m2": list(fluxes),
    }  # fmt: skip
