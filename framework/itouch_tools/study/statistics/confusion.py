"""The confusion matrix of stimuli and answers, and the measures derived from it.

A matrix has one row for each stimulus and one column for each answer; every function takes counts, shape
(stimuli, answers), and gives a result for empty cells, rows and columns, too.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Counts = NDArray[np.float64]


def confusion_matrix(shown: Sequence[Hashable], answered: Sequence[Hashable], labels: Sequence[Hashable]) -> Counts:
    """Count the answers, shape (labels, labels).

    Parameters
    ----------
    shown, answered
        One entry per trial.
    labels
        All stimuli, in the order of rows and columns.

    Raises
    ------
    ValueError
        If the two have different lengths or hold something that is no label.
    """
    if len(shown) != len(answered):
        raise ValueError(f"{len(shown)} stimuli and {len(answered)} answers do not belong together")
    at = {label: index for index, label in enumerate(labels)}
    counts = np.zeros((len(labels), len(labels)))
    for stimulus, answer in zip(shown, answered, strict=True):
        if stimulus not in at or answer not in at:
            raise ValueError(f"'{answer if stimulus in at else stimulus}' is none of {', '.join(map(str, labels))}")
        counts[at[stimulus], at[answer]] += 1.0
    return counts


def _counts(counts: ArrayLike) -> Counts:
    table = np.asarray(counts, float)
    if table.ndim != 2 or (table < 0.0).any() or not np.isfinite(table).all():
        raise ValueError("a confusion matrix is a table of counts")
    return table


def proportion_correct(counts: ArrayLike) -> float:
    """Return the share of answers on the diagonal of counts (stimuli, answers); NaN for an empty table."""
    table = _counts(counts)
    return float(np.trace(table) / table.sum()) if table.sum() else math.nan


def kappa(counts: ArrayLike) -> float:
    """Return Cohen's kappa of counts (stimuli, answers): agreement beyond chance.

    It is NaN if chance alone would always agree, or if there are no answers.
    """
    table = _counts(counts)
    total = table.sum()
    if not total:
        return math.nan
    chance = float((table.sum(axis=1) * table.sum(axis=0)).sum() / total**2)
    return (proportion_correct(table) - chance) / (1.0 - chance) if chance < 1.0 else math.nan


@dataclass(frozen=True, slots=True)
class Information:
    """Information transferred from stimuli to answers [bit]: the plug-in estimate, its bias, and the corrected one."""

    plug_in: float
    bias: float

    @property
    def corrected(self) -> float:
        """The estimate less its bias [bit]; in small samples it can be below 0."""
        return self.plug_in - self.bias


def information_transfer(counts: ArrayLike) -> Information:
    """Return the mutual information of stimulus and answer [bit], with its bias after Miller (1955) and Madow.

    The bias is (K_xy - K_x - K_y + 1) / (2 N ln 2), where the K are the numbers of occupied cells, rows and columns of
    ``counts``, shape (stimuli, answers), and N is its sum.
    """
    table = _counts(counts)
    total = table.sum()
    if not total:
        return Information(math.nan, math.nan)
    joint = table / total
    rows, columns = joint.sum(axis=1, keepdims=True), joint.sum(axis=0, keepdims=True)
    held = joint > 0.0
    plug_in = float((joint[held] * np.log2((joint / np.where(held, rows * columns, 1.0))[held])).sum())
    occupied = int(held.sum()) - int((rows > 0.0).sum()) - int((columns > 0.0).sum()) + 1
    return Information(plug_in, occupied / float(2.0 * total * math.log(2.0)))


@dataclass(frozen=True, slots=True)
class Choice:
    """Luce's choice model fitted to a confusion matrix.

    ``similarity`` (m, m) is symmetric with ones on the diagonal, ``bias`` (m,) sums to one; ``deviance`` is G2 with
    ``freedom`` degrees.
    """

    similarity: NDArray[np.float64]
    bias: NDArray[np.float64]
    deviance: float
    freedom: int


def choice_model(counts: ArrayLike, *, rounds: int = 20000, tolerance: float = 1e-13) -> Choice:
    """Fit p_ij = b_j eta_ij / sum_k b_k eta_ik (Luce 1963), as the model of quasi-symmetry, by iterative scaling.

    The maximum-likelihood fit keeps the row sums, the column sums and the sums of mirrored cells (Smith 1982).

    Parameters
    ----------
    counts
        How often each stimulus was given each answer, shape (stimuli, stimuli).
    rounds, tolerance
        The greatest number of scaling rounds, and the relative change at which they end.

    Raises
    ------
    ValueError
        If the table is not square.
    """
    table = _counts(counts)
    size = len(table)
    if table.shape != (size, size):
        raise ValueError(f"the choice model needs a square table, not {table.shape[0]} x {table.shape[1]}")
    fitted = np.where(table + table.T > 0.0, 1.0, 0.0)
    fitted[np.diag_indices(size)] = 1.0
    pairs = table + table.T
    for _ in range(rounds):
        before = fitted.copy()
        fitted *= _ratio(table.sum(axis=1, keepdims=True), fitted.sum(axis=1, keepdims=True))
        fitted *= _ratio(table.sum(axis=0, keepdims=True), fitted.sum(axis=0, keepdims=True))
        fitted *= _ratio(pairs, fitted + fitted.T)
        if np.abs(fitted - before).max() <= tolerance * max(1.0, fitted.max()):
            break
    held = (table > 0.0) & (fitted > 0.0)
    deviance = 2.0 * float((table[held] * np.log(table[held] / fitted[held])).sum())
    own = np.sqrt(np.outer(np.diag(fitted), np.diag(fitted)))
    similarity = np.sqrt(fitted * fitted.T) / np.where(own > 0.0, own, np.nan)
    bias = _bias(fitted)
    return Choice(similarity, bias, max(deviance, 0.0), (size - 1) * (size - 2) // 2)


def _ratio(wanted: NDArray[np.float64], found: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.divide(wanted, found, out=np.zeros_like(wanted * found), where=found > 0.0)


def _bias(fitted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the response biases: b_j / b_i = sqrt(f_ij f_jj / (f_ji f_ii)), by least squares over all pairs."""
    size = len(fitted)
    logs = np.log(np.where(fitted > 0.0, fitted, np.nan))
    rows, wanted = [], []
    for i in range(size):
        for j in range(i + 1, size):
            value = 0.5 * (logs[i, j] - logs[j, i] + logs[j, j] - logs[i, i])
            if np.isfinite(value):
                row = np.zeros(size)
                row[j], row[i] = 1.0, -1.0
                rows.append(row)
                wanted.append(value)
    if not rows:
        return np.full(size, math.nan)
    solution, *_ = np.linalg.lstsq(np.array([*rows, np.ones(size)]), np.array([*wanted, 0.0]), rcond=None)
    shares = np.exp(solution - solution.max())
    return np.asarray(shares / shares.sum())
