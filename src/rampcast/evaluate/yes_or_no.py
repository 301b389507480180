"""How often a forecast probability of "yes" is right, above a threshold and above the best of all."""

import numpy as np
from jaxtyping import Bool, Float


def best_threshold(
    score: Float[np.ndarray, "case"], positive: Bool[np.ndarray, "case"], weight: Float[np.ndarray, "case"]
) -> float:
    """Returns the threshold above which "yes" is said to be right most often; in the middle where several are as good.

    Args:
        score: grows with the probability of "yes".
        positive: what is true.
        weight: of each case.
    """
    order = np.argsort(score, kind="stable")
    signed = np.where(positive, -weight, weight)[order]  # saying "no" to one more case
    values, last = np.unique(score[order][::-1], return_index=True)
    gain = np.append(0.0, np.cumsum(signed)[len(score) - 1 - last])
    best = np.flatnonzero(gain >= gain.max() - 1e-12)
    edges = np.concatenate([[values[0] - 1.0], (values[1:] + values[:-1]) / 2, [values[-1] + 1.0]])
    return float(edges[best[len(best) // 2]])


def accuracy(
    score: Float[np.ndarray, "case"],
    positive: Bool[np.ndarray, "case"],
    weight: Float[np.ndarray, "case"],
    *,
    threshold: float | Float[np.ndarray, "one_or_case"],
) -> float:
    """Returns the weighted share of cases in which "yes" is said above the (case's) threshold and true, or neither."""
    right = (score > threshold) == positive
    return float((weight * right).sum() / weight.sum()) if weight.any() else float("nan")
