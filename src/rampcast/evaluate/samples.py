"""Scores of forecasts that are samples of what comes together: over horizons, or over vehicles of one moment."""

import numpy as np
from jaxtyping import Float

SHIFTS = 8  # samples that each is compared with; all are alike, so a few tell how far two of them are apart
PIT_BINS = 10


def energy_scores(
    samples: Float[np.ndarray, "case sample component"], truth: Float[np.ndarray, "case component"]
) -> Float[np.ndarray, "case component"]:
    """Returns the energy score of the first component, of the first two together, and so on; NaN once truth is.

    ES = mean |X - y| - mean |X - X'| / 2 with Euclidean norms, over the square root of the number of components: it
    stays an error of one [m]. Of one component it is the CRPS, and of a single sample the root mean square error.
    Two samples X and X' are never the same one. Source: Gneiting and Raftery 2007, eq. 22.

    Args:
        samples: equally likely futures, in no order.
        truth: what came.
    """
    count = np.sqrt(np.arange(1, truth.shape[1] + 1))
    away = _norms(samples - truth[:, None]).mean(axis=1)
    apart = np.zeros_like(away)
    shifts = range(1, min(SHIFTS + 1, samples.shape[1]))
    for shift in shifts:
        apart += _norms(samples - np.roll(samples, shift, axis=1)).mean(axis=1) / len(shifts)
    return (away - apart / 2.0) / count


def pit(samples: Float[np.ndarray, "case sample"], truth: Float[np.ndarray, "case"]) -> Float[np.ndarray, "case"]:
    """Returns the share of samples below the truth, those equal to it by half; of a calibrated forecast it is uniform.

    It is NaN where the truth or a sample is. Source: Dawid 1984; Czado, Gneiting and Held 2009 for ties.
    """
    below, equal = samples < truth[:, None], samples == truth[:, None]
    known = np.isfinite(truth) & np.isfinite(samples).all(axis=1)
    return np.where(known, below.mean(axis=1) + equal.mean(axis=1) / 2.0, np.nan)


def pit_deviation(values: Float[np.ndarray, "case"]) -> float:
    """Returns which share of the values of `pit` would have to be elsewhere for ten bins of equal width to be level.

    What is not known is left out.
    """
    known = values[np.isfinite(values)]
    count = np.bincount(np.minimum((known * PIT_BINS).astype(np.int64), PIT_BINS - 1), minlength=PIT_BINS)
    return float(np.abs(count / len(known) - 1.0 / PIT_BINS).sum() / 2.0)


def _norms(differences: Float[np.ndarray, "case sample component"]) -> Float[np.ndarray, "case sample component"]:
    """Returns the norm of the first component, of the first two, and so on."""
    return np.sqrt(np.cumsum(differences**2, axis=2))
