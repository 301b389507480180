"""Position noise like that of trajectories taken from video."""

from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.recording import Recording
from rampcast.recording.columns import X, Y

CORRELATION_TIME = 0.3  # [s]; tracked positions err alike for a few frames; assumed
LATERAL_SHARE = 0.5  # of the longitudinal noise; the image resolves the road's width better than its length; assumed


def add_position_noise(recording: Recording, *, standard_deviation: float, seed: int) -> Recording:
    """Returns a recording whose positions carry Gaussian noise that is correlated over a few frames.

    Args:
        recording: the positions without noise.
        standard_deviation: of the longitudinal noise [m]; the lateral noise is half of it. 0.1 to 0.3 resembles NGSIM,
            whose accelerations at 10 Hz no vehicle reaches (Thiemann et al. 2008).
        seed: of the draws.
    """
    if standard_deviation == 0.0:
        return recording
    stream = np.random.default_rng([seed, 2])
    keep = float(np.exp(-recording.time_step / CORRELATION_TIME))
    along, across = (_correlated(stream, recording.tracks.height, keep) for _ in range(2))
    noisy = recording.tracks.with_columns(
        pl.col(X) + pl.Series(standard_deviation * along),
        pl.col(Y) + pl.Series(standard_deviation * LATERAL_SHARE * across),
    )
    return replace(recording, tracks=noisy)


def _correlated(stream: np.random.Generator, count: int, keep: float) -> Float[np.ndarray, "row"]:
    """Returns first-order autoregressive noise of unit variance."""
    from scipy.signal import lfilter  # heavy; reading the sample does not need it

    white = stream.normal(size=count)
    white[1:] *= np.sqrt(1 - keep**2)
    noise: Float[np.ndarray, "row"] = lfilter([1.0], [1.0, -keep], white)
    return noise
