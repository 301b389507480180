"""A linear model whose columns are made normal by their ranks, so that outliers do not turn it. Missing is as usual."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from rampcast.errors import ModelError
from rampcast.models.trees import softness

RANKS = np.linspace(0.01, 0.99, 50)  # quantiles of a column that are kept
BLUR = ndtri(np.linspace(0.05, 0.95, 10))  # widths of `softness` by which values are spread
SHRINKAGE = 300.0  # of the weights, as if so many rows more had shown no effect of any column


@dataclass(frozen=True)
class RankedLine:
    """A fitted line.

    Attributes:
        quantiles: of each column in training, at `RANKS`.
        usual: mean normal score of each column in training.
        weights: of what a score is beyond the usual.
        start: value where all columns are as usual.
    """

    quantiles: Float[np.ndarray, "rank column"]
    usual: Float[np.ndarray, "column"]
    weights: Float[np.ndarray, "column"]
    start: float

    def __post_init__(self) -> None:
        if len(self.quantiles) != len(RANKS):  # the compiled loops do not look
            raise ModelError(f"expected {len(RANKS)} quantiles of a column, got {len(self.quantiles)}")

    def predict(self, table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row"]:
        """Returns the value of each row."""
        return self.start + _beyond(_normal(table, self.quantiles), self.usual) @ self.weights


def fit_ranked_line(table: Float[np.ndarray, "row column"], wanted: Float[np.ndarray, "row"]) -> RankedLine:
    """Returns the line that is nearest to what is wanted, by least squares with shrunken weights.

    Args:
        table: missing is NaN; no column is missing in all rows.
        wanted: a value for each row.
    """
    quantiles = _blurred_quantiles(table)
    scores = _normal(table, quantiles)
    usual = np.nanmean(scores, axis=0)
    beyond = _beyond(scores, usual)
    start = float(wanted.mean())
    inner = beyond.T @ beyond + SHRINKAGE * np.eye(table.shape[1])
    return RankedLine(quantiles, usual, np.linalg.solve(inner, beyond.T @ (wanted - start)), start)


def _blurred_quantiles(table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "rank column"]:
    """Returns quantiles of columns whose values are spread a little.

    Where many vehicles share a value, as those that stand do, quantiles lie so near each other that the last digit of
    a measurement would decide between the first and the last rank.
    """
    spread = table + BLUR[:, None, None] * softness(table)
    return np.nanquantile(spread.reshape(-1, table.shape[1]), RANKS, axis=0)


def _normal(
    table: Float[np.ndarray, "row column"], quantiles: Float[np.ndarray, "rank column"]
) -> Float[np.ndarray, "row column"]:
    """Returns normal scores; in the middle of its ranks where a value is several quantiles at once."""
    from rampcast.models.tree_loops import ranks  # numba: only who predicts waits for it

    found = np.empty(table.shape)
    ranks(np.ascontiguousarray(table), quantiles, RANKS, found)
    return ndtri(found)


def _beyond(
    scores: Float[np.ndarray, "row column"], usual: Float[np.ndarray, "column"]
) -> Float[np.ndarray, "row column"]:
    return np.where(np.isnan(scores), 0.0, scores - usual)
