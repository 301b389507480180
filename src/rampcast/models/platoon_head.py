"""The vehicle at the head of a platoon, of whose leader nothing is known: its speed drifts, or goes back to the mean.

Its speed follows v' = (u - v) / relaxation + noise, an Ornstein-Uhlenbeck process about the mean speed u that the
platoon's vehicles had over their histories. Relaxation and noise are learned from the training vehicles' leaders (and
from vehicles without one). A target with a learned constant was tried and is not here: it says what the traffic was in
the minutes of the training, and is wrong in others (docs/limits.md).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rampcast.horizon import STEP, STEPS_PER_SECOND, WHOLE_SECONDS
from rampcast.traffic.platoons import Platoons

KEPT = 1e4  # [s]; a relaxation by which a speed is kept
RELAXATIONS = (5.0, 10.0, 20.0, 40.0)  # [s] that are tried
WORTH = 0.95  # of the error when keeping its speed: what returning must reach, or it holds in these minutes only
LEAST_CASES = 20  # fewer say more of themselves than of traffic: the head keeps its speed then


@dataclass(frozen=True)
class Head:
    """How the head of a platoon goes on.

    Attributes:
        relaxation: time constant of its speed [s].
        noise: standard deviation of the speed change in a second [m/s].
    """

    relaxation: float = KEPT
    noise: float = 0.3


def mean_speed(platoons: Platoons) -> Float[np.ndarray, "platoon"]:
    """Returns the mean speed of all vehicles over their histories [m/s]."""
    return np.where(platoons.valid, platoons.v, 0.0).sum(axis=(1, 2)) / platoons.valid.sum(axis=(1, 2))


def fit_head(
    platoons: Platoons, truth: Float[np.ndarray, "platoon step"], leader_truth: Float[np.ndarray, "platoon step"]
) -> Head:
    """Returns the head that brings training vehicles' leaders, and vehicles without one, nearest to where they went.

    Args:
        platoons: of the training vehicles.
        truth: their displacements [m]; NaN where not seen.
        leader_truth: front of their leaders, counted from the same places [m]; NaN where not seen.
    """
    led = platoons.depth > 0
    place = led.astype(np.int64)
    case = np.arange(len(platoons))
    speed = np.maximum(platoons.v[case, place, -1], 0.0)
    ahead = np.where(led, platoons.x[:, 1, -1] - platoons.x[:, 0, -1], 0.0)
    moved = np.where(led[:, None], leader_truth - ahead[:, None], truth)[:, WHOLE_SECONDS]
    if np.isfinite(moved).any(axis=1).sum() < LEAST_CASES:
        return Head()
    around = mean_speed(platoons)
    kept = _given(KEPT, speed, around, moved)
    returning = min((_given(time, speed, around, moved) for time in RELAXATIONS), key=lambda found: found[0])
    return returning[1] if returning[0] < WORTH * kept[0] else kept[1]


def _given(
    relaxation: float,
    speed: Float[np.ndarray, "case"],
    around: Float[np.ndarray, "case"],
    moved: Float[np.ndarray, "case second"],
) -> tuple[float, Head]:
    """Returns the mean error of a relaxation, and the head that it makes."""
    time = STEP * (1 + np.arange(STEPS_PER_SECOND * moved.shape[1])[WHOLE_SECONDS])
    kept = relaxation * (1.0 - np.exp(-time / relaxation))
    seen = np.isfinite(moved)
    forecast = speed[:, None] * kept + around[:, None] * (time - kept)
    left = (moved - forecast)[seen]
    # variance of the place of an Ornstein-Uhlenbeck speed whose noise is 1 m/s in a second
    fading = np.exp(-time / relaxation)
    variance = relaxation**2 * (time - 2 * relaxation * (1 - fading) + relaxation / 2 * (1 - fading**2))
    noise = float(np.sqrt(np.mean(left**2 / np.broadcast_to(variance, moved.shape)[seen])))
    return float(np.abs(left).mean()), Head(relaxation, noise)
