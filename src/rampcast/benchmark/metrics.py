"""Metrics of longitudinal forecasts as plain functions."""

import numpy as np
from jaxtyping import Float

from rampcast.benchmark.models import LEVELS

LEVEL_WIDTHS = (0.15, 0.225, 0.25, 0.225, 0.15)  # share of the levels from 0 to 1 that lies nearest to each of LEVELS
BINS: tuple[str, ...] = ("00_05", "05_25", "25_50", "50_75", "75_95", "95_100")  # between LEVELS [%]


def crps_of_quantiles(
    quantiles: Float[np.ndarray, "case quantile"], truth: Float[np.ndarray, "case"]
) -> Float[np.ndarray, "case"]:
    """Returns the CRPS of each case from its quantiles at `LEVELS` [m]: twice the integral of the pinball loss.

    The integral over all levels is a sum over the five, each standing for the levels nearest to it.
    Source: Gneiting and Ranjan 2011, eq. 8.
    """
    above = truth[:, None] - quantiles
    pinball = np.maximum(np.array(LEVELS) * above, (np.array(LEVELS) - 1.0) * above)
    return 2.0 * pinball @ np.array(LEVEL_WIDTHS)


def coverage(
    low: Float[np.ndarray, "case"], high: Float[np.ndarray, "case"], truth: Float[np.ndarray, "case"]
) -> float:
    """Returns the share of cases whose truth lies in the band, its ends included."""
    return float(np.mean((truth >= low) & (truth <= high)))


def pit_histogram(
    quantiles: Float[np.ndarray, "case quantile"], truth: Float[np.ndarray, "case"]
) -> Float[np.ndarray, "bin"]:
    """Returns the share of cases whose truth lies below the first quantile, between each two, and above the last.

    The probability integral transform of a calibrated forecast is uniform: then the shares are the widths of the bins,
    0.05, 0.20, 0.25, 0.25, 0.20, 0.05.
    """
    bins = (truth[:, None] > quantiles).sum(axis=1)
    return np.bincount(bins, minlength=len(LEVELS) + 1) / len(truth)


def gap_closed(
    error: Float[np.ndarray, "*kinds"], reference: Float[np.ndarray, "*kinds"], oracle: Float[np.ndarray, "*kinds"]
) -> Float[np.ndarray, "*kinds"]:
    """Returns the fraction of the gap between the reference's error and the oracle's that a model closes.

    Args:
        error: of the model [m].
        reference: of one leader at constant speed [m].
        oracle: behind the leader's true future [m]; NaN comes where it is no better than the reference.
    """
    gap = np.where(reference > oracle, reference - oracle, np.nan)
    return (reference - error) / gap
