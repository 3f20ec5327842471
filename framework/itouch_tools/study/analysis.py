"""The analysis of a study's trials: tables and figures from rows alone, with all numbers from `statistics`.

Small panels, a single participant, empty cells or only right answers give results with wide or missing intervals
(None).
"""

from __future__ import annotations

import importlib.util
import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from itouch_tools.study import statistics as stats
from itouch_tools.study.constant import constant
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_elements import CATCH, PRACTICE, TASKS, UNCOUNTED
from itouch_tools.study.study_store import Row
from itouch_tools.study.tasks import choices_of
from itouch_tools.study.touch_figures import BACK, OWN

#: Number of bootstrap panels for the intervals over participants.
DRAWS = 2000


def analyse(file: StudyFile, rows: Sequence[Row], *, draws: int = DRAWS) -> dict[str, Any]:
    """Return the results of a study as plain data for JSON.

    Practice trials and void ones do not count; the results say how many there were.  ``draws`` is the number of
    resampled panels of an interval; 0: without intervals that need them.
    """
    study = file.study
    counted = [row for row in rows if row.block not in UNCOUNTED and not row.void]
    caught = [row for row in rows if row.block == CATCH and not row.void]
    judged = _judged(file, counted)
    result: dict[str, Any] = {
        "study": file.name, "task": study.task.kind, "participants": len({row.participant for row in counted}),
        "trials": len(counted), "practice": sum(row.block == PRACTICE for row in rows),
        "void": dict(Counter(row.void for row in rows if row.void)),
        "conditions": [
            _condition(counted, condition, judged=judged, seed=study.seed, draws=draws)
            for condition in file.conditions()
        ],
        "felt": _felt(file, counted),
        "skin_not_back": sum(touch.get(BACK.key) is False for row in counted for touch in row.felt or []),
    }  # fmt: skip
    if judged:
        result["correct"] = _correct(counted, study.seed, draws)
    if study.task.kind == "identify":
        result["identification"] = [
            _identification(file, rows_of, name, draws) for name, rows_of in _split(file, counted)
        ]
    if study.task.kind in ("colder", "odd"):
        result["sensitivity"] = _sensitivity(file, counted, draws)
    if study.task.kind == "rate" or (study.task.kind not in TASKS and not choices_of(study)):
        result["ratings"] = _ratings(file, counted, draws)
    if study.catch is not None:
        seen = [row.right for row in caught if row.right is not None]
        result["catch"] = {"trials": len(caught), "judged": len(seen), "right": sum(seen)}
    if (series := constant(file, counted, draws=draws)) is not None:
        result["constant"] = series
    if study.staircases:
        result["staircases"] = [_staircase(file, counted, one.name) for one in study.staircases]
    if len(study.factors) > 1 and judged:
        result["differences"] = _differences(file, counted)
        result["model"] = _model(file, counted)
    return dict(_plain(result))


def _judged(file: StudyFile, rows: Sequence[Row]) -> bool:
    """Tell whether answers can be right or wrong in this study; for a plugin's task that is seen in its rows."""
    kind = file.study.task.kind
    return kind != "rate" and (kind in TASKS or any(row.right is not None for row in rows))


def _plain(value: Any) -> Any:
    """Return a value as plain data: None for a number that is not finite, and Python's numbers for those of arrays."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def _by_person(rows: Sequence[Row]) -> list[list[Row]]:
    people = sorted({row.participant for row in rows})
    return [[row for row in rows if row.participant == person] for person in people]


def _share(rows: Sequence[Row]) -> float:
    judged = [row.right for row in rows if row.right is not None]
    return sum(judged) / len(judged) if judged else math.nan


def _counts(rows: Sequence[Row]) -> list[tuple[int, int]]:
    """Return for each participant the number of right answers, and the number that could be right."""
    judged = [[row.right for row in person if row.right is not None] for person in _by_person(rows)]
    return [(sum(person), len(person)) for person in judged]


def _panel_share(panel: Sequence[Sequence[Row]]) -> float:
    shares = [share for person in panel if math.isfinite(share := _share(person))]
    return float(np.mean(shares)) if shares else math.nan


def _correct(rows: Sequence[Row], seed: int, draws: int) -> dict[str, Any]:
    """Return the proportion right: over all trials with Wilson's interval, and over participants with a bootstrap's."""
    rows = [row for row in rows if row.right is not None]
    right = sum(row.right or 0 for row in rows)
    counts = _counts(rows)
    low, high = stats.share_interval(counts, seed=seed, draws=draws) if len(counts) > 1 else (math.nan, math.nan)
    return {
        "right": right, "trials": len(rows), "proportion": _share(rows), "wilson_95": stats.wilson(right, len(rows)),
        "panel_mean": _panel_share(_by_person(rows)), "panel_95": (low, high),
    }  # fmt: skip


def _condition(
    rows: Sequence[Row], condition: dict[str, str], *, judged: bool, seed: int, draws: int
) -> dict[str, Any]:
    here = [row for row in rows if dict(row.condition) == condition]
    right = sum(row.right or 0 for row in here)
    entry: dict[str, Any] = {"condition": condition, "trials": len(here)}
    if judged:
        of = sum(row.right is not None for row in here)
        entry |= {
            "proportion": _share(here), "wilson_95": stats.wilson(right, of),
            "panel_95": stats.share_interval(_counts(here), seed=seed, draws=draws),
        }  # fmt: skip
    return entry


def _split(file: StudyFile, rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Return all trials, and those of each level of the factors that are not asked for, each with a name."""
    parts = [("all", list(rows))]
    for factor in file.study.factors:
        if factor.name != file.study.task.factor:
            parts += [
                (f"{factor.name}={level}", [row for row in rows if row.condition.get(factor.name) == level])
                for level in factor.names
            ]
    return parts


def _identification(file: StudyFile, rows: Sequence[Row], name: str, draws: int) -> dict[str, Any]:
    """Return the confusion matrix and the measures derived from it, with intervals over participants."""
    asked = file.study.task.factor
    labels = next(factor.names for factor in file.study.factors if factor.name == asked)

    def matrix(panel: Sequence[Row]) -> Any:
        return stats.confusion_matrix(
            [row.condition[asked] for row in panel], [row.answer or "" for row in panel], labels
        )

    def cell(row: int, column: int) -> tuple[float, float]:
        people = [matrix(person)[row] for person in _by_person(rows)]
        shares = {float(own[column] / own.sum()) for own in people if own.sum()}
        if len(people) > 1 and len(shares) == 1:  # resampling identical people would give an interval of no width
            return stats.wilson(int(counts[row, column]), int(counts[row].sum()))
        return over(partial(_cell, row=row, column=column))

    def over(statistic: Callable[[Any], float]) -> tuple[float, float]:
        return stats.participant_interval(
            _by_person(rows), lambda panel: statistic(matrix([row for person in panel for row in person])),
            seed=file.study.seed, draws=draws,
        )  # fmt: skip

    counts = matrix(rows)
    information = stats.information_transfer(counts)
    choice = stats.choice_model(counts)
    cells = [
        [cell(i, j) for j in range(len(labels))] for i in range(len(labels))
    ] if draws else []  # fmt: skip
    return {
        "of": name, "labels": labels, "counts": counts, "intervals_95": cells,
        "proportion": stats.proportion_correct(counts), "kappa": stats.kappa(counts),
        "information_bit": {
            "plug_in": information.plug_in, "bias": information.bias, "corrected": information.corrected,
            "ceiling": math.log2(len(labels)), "panel_95": over(_bits),
        },
        "d_prime": stats.d_prime_of_alternatives(stats.proportion_correct(counts), len(labels))
        if len(rows) and len(labels) > 1 else math.nan,
        "choice": {
            "bias": choice.bias, "similarity": choice.similarity, "deviance": choice.deviance,
            "freedom": choice.freedom,
        },
    }  # fmt: skip


def _bits(table: Any) -> float:
    return stats.information_transfer(table).corrected


def _cell(table: Any, row: int, column: int) -> float:
    total = table[row].sum()
    return float(table[row, column] / total) if total else math.nan


def _sensitivity(file: StudyFile, rows: Sequence[Row], draws: int) -> list[dict[str, Any]]:
    """Return d' of each level against the standard, from the participants' mean proportion right, and its interval."""
    study = file.study
    inverse = stats.d_prime_of_oddity if study.task.kind == "odd" else _two
    found = []
    for factor in study.factors:
        for level in factor.names if factor.name == study.task.factor else ():
            here = [row for row in rows if row.condition.get(factor.name) == level and row.right is not None]
            interval = stats.share_interval(_counts(here), seed=study.seed, draws=draws)
            ends = [inverse(end) if math.isfinite(end) else math.nan for end in interval]
            value = inverse(_panel_share(_by_person(here))) if here else math.nan
            found.append({"level": level, "trials": len(here), "d_prime": value, "d_prime_95": ends})
    return found


def _two(correct: float) -> float:
    return stats.d_prime_of_alternatives(correct, 2)


def _ratings(file: StudyFile, rows: Sequence[Row], draws: int) -> list[dict[str, Any]]:
    """Return the mean of each condition over participants; if all ratings are above 0 the geometric mean, too.

    The geometric mean is that of magnitude estimation, where each participant's numbers have a scale of their own.
    """

    def means(panel: Sequence[Sequence[Row]]) -> list[float]:
        return [float(np.mean([float(row.answer or "nan") for row in person])) for person in panel]

    def mean(panel: Sequence[Sequence[Row]]) -> float:
        return float(np.mean(means(panel)))

    def geometric(panel: Sequence[Sequence[Row]]) -> float:
        logs = [np.mean([math.log(float(row.answer or "nan")) for row in person]) for person in panel]
        return math.exp(float(np.mean(logs)))

    positive = all(float(row.answer or "nan") > 0.0 for row in rows)
    found: list[dict[str, Any]] = []
    for condition in file.conditions():
        people = _by_person([row for row in rows if dict(row.condition) == condition])
        interval = stats.participant_interval(people, mean, seed=file.study.seed, draws=draws)
        entry = {"condition": condition, "mean": mean(people) if people else math.nan, "panel_95": interval}
        if positive:
            entry |= {
                "geometric_mean": geometric(people) if people else math.nan,
                "geometric_95": stats.participant_interval(people, geometric, seed=file.study.seed, draws=draws),
            }
        found.append(entry)
    return found


def _staircase(file: StudyFile, rows: Sequence[Row], name: str) -> dict[str, Any]:
    """Return each participant's threshold, their mean, and its interval over participants."""
    from itouch_tools.study.adaptive import Running

    rule = next(one for one in file.study.staircases if one.name == name).rule()
    people = {}
    for person in _by_person([row for row in rows if row.staircase == name]):
        told = [(row.level, row.right) for row in person if row.level is not None and row.right is not None]
        people[person[0].participant] = Running.begin(rule, told).estimate()
    values = [value for value in people.values() if math.isfinite(value)]
    mean = float(np.mean(values)) if values else math.nan
    return {
        "name": name, "procedure": rule.procedure, "target": rule.found, "thresholds": people, "mean": mean,
        "panel_95": stats.participant_interval(values, lambda v: float(np.mean(v)), seed=file.study.seed),
    }  # fmt: skip


def _differences(file: StudyFile, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return, for each pair of levels of a factor that is not asked for, the difference and a test of equivalence."""
    found: list[dict[str, Any]] = []
    for factor in file.study.factors:
        if factor.name == file.study.task.factor:
            continue
        for i, first in enumerate(factor.names):
            for second in factor.names[i + 1 :]:
                pairs = [
                    tuple(
                        _share([row for row in person if row.condition.get(factor.name) == level])
                        for level in (first, second)
                    )
                    for person in _by_person(rows)
                ]
                test = stats.clustered_tost([p[0] for p in pairs], [p[1] for p in pairs], margin=0.1)
                found.append({
                    "factor": factor.name, "levels": [first, second], "difference": test.difference, "margin": 0.1,
                    "interval_90": [test.low, test.high], "p_equivalence": test.p,
                })  # fmt: skip
    adjusted = stats.holm([float(entry["p_equivalence"]) for entry in found]).tolist()
    return [{**entry, "p_holm": p} for entry, p in zip(found, adjusted, strict=True)]


def _model(file: StudyFile, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the logistic model of right answers by all factors, with trials nested in participants."""
    judged = [row for row in rows if row.right is not None]
    factors = {
        factor.name: sorted({row.condition[factor.name] for row in judged}, key=factor.names.index)
        for factor in file.study.factors
    }  # fmt: skip
    shown = {name: [row.condition[name] for row in judged] for name, levels in factors.items() if len(levels) > 1}
    if importlib.util.find_spec("statsmodels") is None or not judged:
        return []
    people = [row.participant for row in judged]
    terms = stats.logistic_gee([row.right or 0 for row in judged], shown, people, levels=factors)
    return [
        {"term": term.name, "log_odds": term.estimate, "interval_95": [term.low, term.high], "p": term.p}
        for term in terms
    ]  # fmt: skip


def _felt(file: StudyFile, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return what was rendered in each condition: means and standard deviations of the figures of touches."""
    found = []
    for condition in _shown(file, rows):
        touches = [
            felt for row in rows if file.study.staircases or dict(row.condition) == condition
            for shown, felt in zip(row.shown, row.felt or [], strict=False) if shown == condition
        ]  # fmt: skip
        entry: dict[str, Any] = {"condition": condition, "touches": len(touches)}
        names = dict.fromkeys([*(one.key for one in OWN), *(name for touch in touches for name in touch)])
        for name in names:
            values = [float(touch[name]) for touch in touches if _is_number(touch.get(name))]
            if values:
                entry[name] = {"mean": float(np.mean(values)), "sd": float(np.std(values))}
        found.append(entry)
    return found


def _shown(file: StudyFile, rows: Sequence[Row]) -> list[dict[str, str]]:
    """Return what was shown: the conditions, or each level that a staircase asked for, by staircase and level."""
    if not file.study.staircases:
        return file.conditions()
    levels = {tuple(shown.items()) for row in rows for shown in row.shown}
    return [dict(pairs) for pairs in sorted(levels, key=lambda pairs: [(name, float(level)) for name, level in pairs])]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
