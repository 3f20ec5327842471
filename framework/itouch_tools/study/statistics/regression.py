"""Logistic regression of right answers with trials nested in participants: generalised estimating equations."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats


@dataclass(frozen=True, slots=True)
class Term:
    """One coefficient of the log-odds; ``name`` is ``FACTOR=LEVEL``, relative to the factor's first level."""

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

    Standard errors are robust, with the bias reduction of Kauermann and Carroll (2001, J. Am. Stat. Assoc. 96:1387),
    which small panels need; intervals use Student's t distribution with participants minus coefficients degrees of
    freedom.  (With it the stronger reduction of Mancl and DeRouen, 2001, Biometrics 57:126, is too conservative.)

    Parameters
    ----------
    right
        1 or 0 for each trial.
    factors
        For each factor, by its name, the level of each trial.
    participants
        Code of each trial's participant.
    levels
        For each factor, by its name, its levels in order; the first is the reference; default: in the order of
        appearance.
    level
        Confidence level of the intervals.

    Returns
    -------
    list of Term
        The intercept first; all NaN if the model is not defined: with too few participants, or if the answers do not
        vary at some level.
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
            fit = model.fit(cov_type="naive", maxiter=200)
            estimates = np.asarray(fit.params)
            spread = _spread(answers, table, codes, estimates, float(model.cov_struct.dep_params))
        except (np.linalg.LinAlgError, ValueError):
            return nothing
    errors = np.sqrt(np.diag(spread))
    if not (fit.converged and np.isfinite(estimates).all() and np.isfinite(errors).all()):
        return nothing
    reach = float(stats.t.ppf(0.5 + level / 2.0, freedom))
    return [
        Term(name, float(b), float(e), float(b - reach * e), float(b + reach * e),
             float(2.0 * stats.t.sf(abs(b) / e, freedom)) if e > 0.0 else math.nan)
        for name, b, e in zip(names, estimates, errors, strict=True)
    ]  # fmt: skip


def _spread(
    answers: np.ndarray,
    table: np.ndarray,
    codes: np.ndarray,
    estimates: np.ndarray,
    likeness: float,
    power: float = 0.5,
) -> np.ndarray:
    """Return the estimates' robust covariance, corrected for participants' leverage, (coefficients, coefficients).

    With M_i = D'V^-1 D and s_i = D'V^-1 r of participant i, and M the sum of the M_i, the corrected score is
    (1 - M_i M^-1)^-p s_i, and the covariance is M^-1 (sum of the scores' squares) M^-1: p = 1/2 is Kauermann and
    Carroll's, 1 Mancl and DeRouen's, 0 the plain sandwich.  (The papers take the power of 1 - H_i with
    H_i = D M^-1 D'V^-1, which has a row for each trial; D' V^-1 (1 - H_i)^-p = (1 - M_i M^-1)^-p D' V^-1 makes the
    matrix as small as the number of coefficients.)

    Parameters
    ----------
    likeness
        The exchangeable correlation of two trials of one participant.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a coefficient depends on one participant alone.
    """
    size = table.shape[1]
    shares = special.expit(table @ estimates)
    informations, scores = [], []
    for person in range(int(codes.max()) + 1):
        own = codes == person
        spreads = np.sqrt(shares[own] * (1.0 - shares[own]))
        slopes = table[own] * spreads[:, None]
        residuals = (answers[own] - shares[own]) / spreads
        common = likeness / (1.0 + (len(residuals) - 1) * likeness)
        weighed = (slopes - common * slopes.sum(axis=0)) / (1.0 - likeness)
        informations.append(weighed.T @ slopes)
        scores.append(weighed.T @ residuals)
    root = np.linalg.cholesky(np.sum(informations, axis=0))
    back = np.linalg.inv(root)
    total = np.zeros((size, size))
    for information, score in zip(informations, scores, strict=True):
        leverages, axes = np.linalg.eigh(back @ information @ back.T)
        if leverages[-1] > 1.0 - 1e-9:
            raise np.linalg.LinAlgError("a coefficient hangs on one participant")
        # This is the corrected score times M^-1: root times back is 1, and M^-1 is back' back.
        moved = back.T @ (axes * (1.0 - leverages) ** -power) @ axes.T @ back @ score
        total += np.outer(moved, moved)
    return total


def _design(
    factors: Mapping[str, Sequence[str]], levels: Mapping[str, Sequence[str]], count: int
) -> tuple[list[str], np.ndarray]:
    """Return the columns' names and the design matrix (trials, columns): intercept, and each level but the first."""
    names, columns = ["intercept"], [np.ones(count)]
    for factor, shown in factors.items():
        seen = set(shown)
        ordered = [one for one in levels.get(factor, tuple(dict.fromkeys(shown))) if one in seen]
        for one in ordered[1:]:
            names.append(f"{factor}={one}")
            columns.append(np.array([each == one for each in shown], float))
    return names, np.column_stack(columns) if count else np.zeros((0, len(names)))


def _varies(answers: np.ndarray, table: np.ndarray) -> bool:
    """Tell whether right and wrong answers occur at every level: otherwise a coefficient would be infinite."""
    if not len(answers):
        return False
    rest = table[:, 1:].sum(axis=1) == 0.0
    cells = [rest, *(column > 0.0 for column in table[:, 1:].T)]
    return all(not cell.any() or 0.0 < answers[cell].mean() < 1.0 for cell in cells)
