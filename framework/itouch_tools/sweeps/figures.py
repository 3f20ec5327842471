"""Statistics for pages of sweeps: intervals of proportions, confusion, bits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def proportion(count: int, of: int, level: float = 0.95) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of the proportion ``count / of``; one-sided if it is 0 or 1."""
    from scipy.stats import beta

    tail = (1.0 - level) / 2.0 if 0 < count < of else 1.0 - level
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, of - count + 1))
    high = 1.0 if count == of else float(beta.ppf(1.0 - tail, count + 1, of - count))
    return low, high


def confusion(features: NDArray[np.float64], labels: NDArray[np.intp], count: int, noise: float) -> NDArray[np.float64]:
    """Return the confusion matrix (touched, answered) of an observer that answers with the nearest mean of touches.

    Distances are in units of the spread within classes (Mahalanobis); a touch does not count in its own class's mean.

    Parameters
    ----------
    features
        Cues of each touch, shape (touches, cues).
    labels
        What was touched, as numbers from 0, shape (touches,).
    count
        Number of different objects that can be touched.
    noise
        Standard deviation of a person's noise, added to each cue; 0: none.
    """
    rng = np.random.default_rng(0)
    repeats = 1 if noise == 0.0 else 20
    within = np.concatenate([features[labels == index] - features[labels == index].mean(0) for index in range(count)])
    spread = np.cov(within.T, ddof=count).reshape(features.shape[1], -1) + (noise**2 + 1e-12) * np.eye(
        features.shape[1]
    )
    inverse, found = np.linalg.inv(spread), np.zeros((count, count))
    sums = np.array([features[labels == index].sum(0) for index in range(count)])
    sizes = np.bincount(labels, minlength=count).astype(float)
    for touch, label in zip(features, labels, strict=True):
        means = sums / sizes[:, None]
        if sizes[label] > 1:  # a touch does not count in the mean with which it is compared
            means[label] = (sums[label] - touch) / (sizes[label] - 1.0)
        for _ in range(repeats):
            off = touch + noise * rng.standard_normal(len(touch)) - means
            found[label, int(np.argmin(np.einsum("ij,jk,ik->i", off, inverse, off)))] += 1.0
    return found


def bits(matrix: NDArray[np.float64]) -> float:
    """Return the information [bit] that answers carry about what was touched, given counts (touched, answered)."""
    joint = matrix / matrix.sum()
    independent = joint.sum(1, keepdims=True) * joint.sum(0, keepdims=True)
    known = joint > 0.0
    return float((joint[known] * np.log2(joint[known] / independent[known])).sum())
