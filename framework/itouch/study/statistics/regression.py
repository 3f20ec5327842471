"""Logistic regression of right answers with trials nested in participants: generalised estimating equations."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats


@dataclass(frozen=True, slots=True)
class Term:
    """One coefficient on the log-odds: ``name`` is ``FACTOR=LEVEL`` against the factor's first level."""

    name: str
    estimate: float
    error: float
    low: float
    high: float
    p: float


def logistic_gee(
    right: Sequence[int], factors: Mapping[str, Sequence[str]], participants: Sequence[str], *,
    levels: Mapping[str, Sequence[str]] | None = None, level: float = 0.95,
) -> list[Term]:  # fmt: skip
    """Fit the log-odds of a right answer by factors, with exchangeable correlation within participants.

    Errors are robust with the bias reduction of Mancl and DeRouen (2001, Biometrics 57:126), which small panels need,
    and intervals take Student's distribution with participants minus coefficients degrees of freedom.

    Parameters
    ----------
    right
        1 or 0 for each trial.
    factors
        Name -> level of each trial.
    participants
        Code of each trial's participant.
    levels
        Name -> its levels in order, the first is the reference; default: in the order of appearance.
    level
        Of the intervals.

    Returns
    -------
    list of Term
        The intercept first; NaN throughout where it is not defined: too few participants, or an answer that never
        varies at some level.
    """
    names, table = _design(factors, levels or {}, len(right))
    answers = np.asarray(right, float)
    groups, codes = np.unique(np.asarray(participants, str), return_inverse=True)
    nothing = [Term(name, *(math.nan,) * 5) for name in names]
    freedom = len(groups) - len(names)
    if freedom < 1 or not _varies(answers, table):
        return nothing
    import statsmodels.api as sm

    order = np.argsort(codes, kind="stable")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = sm.GEE(
            answers[order], table[order], groups=codes[order], family=sm.families.Binomial(),
            cov_struct=sm.cov_struct.Exchangeable(),
        )  # fmt: skip
        try:
            fit = model.fit(cov_type="bias_reduced", maxiter=200)
        except (np.linalg.LinAlgError, ValueError):
            return nothing
    estimates, errors = np.asarray(fit.params), np.asarray(fit.bse)
    if not (fit.converged and np.isfinite(estimates).all() and np.isfinite(errors).all()):
        return nothing
    reach = float(stats.t.ppf(0.5 + level / 2.0, freedom))
    return [
        Term(name, float(b), float(e), float(b - reach * e), float(b + reach * e),
             float(2.0 * stats.t.sf(abs(b) / e, freedom)) if e > 0.0 else math.nan)
        for name, b, e in zip(names, estimates, errors, strict=True)
    ]  # fmt: skip


def _design(
    factors: Mapping[str, Sequence[str]], levels: Mapping[str, Sequence[str]], count: int
) -> tuple[list[str], np.ndarray]:
    """Return the columns' names and the matrix (trials, columns): intercept, and one a level but the first."""
    names, columns = ["intercept"], [np.ones(count)]
    for factor, shown in factors.items():
        seen = set(shown)
        ordered = [one for one in levels.get(factor, tuple(dict.fromkeys(shown))) if one in seen]
        for one in ordered[1:]:
            names.append(f"{factor}={one}")
            columns.append(np.array([each == one for each in shown], float))
    return names, np.column_stack(columns) if count else np.zeros((0, len(names)))


def _varies(answers: np.ndarray, table: np.ndarray) -> bool:
    """Tell whether right and wrong answers occur at every level, without which a coefficient is infinite."""
    if not len(answers):
        return False
    rest = table[:, 1:].sum(axis=1) == 0.0
    cells = [rest, *(column > 0.0 for column in table[:, 1:].T)]
    return all(not cell.any() or 0.0 < answers[cell].mean() < 1.0 for cell in cells)
