"""The vehicle at the head of a platoon, of whose leader nothing is known: its speed drifts, or goes back to the mean.

Its speed follows v' = (u - v) / relaxation + free A (1 - (v / v_d)^delta) + noise: it goes back to the mean speed u
that the vehicles of its lane had over their histories, or on to the desired speed of the IDM. A driver who has nobody
ahead does the latter in full; one whose leader is out of sight does not, so the share is learned like relaxation and
noise, from the training vehicles' leaders (and from vehicles without one). A target with a learned constant was tried
and is not here: it says what the traffic was in the minutes of the training, and is wrong in others (docs/limits.md).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rampcast.horizon import STEP, STEPS_PER_SECOND, WHOLE_SECONDS
from rampcast.physics.minimums import MINIMUM_SPEED
from rampcast.traffic.platoons import Platoons

KEPT = 1e4  # [s]; a relaxation by which a speed is kept
RELAXATIONS = (5.0, 10.0, 20.0, 40.0)  # [s] that are tried
SHARES = (0.1, 0.25, 0.5, 1.0)  # of the free acceleration, likewise
WORTH = 0.95  # of the error when keeping its speed: what returning must reach, or it holds in these minutes only
LEAST_CASES = 20  # fewer say more of themselves than of traffic: the head keeps its speed then


@dataclass(frozen=True)
class Head:
    """How the head of a platoon goes on.

    Attributes:
        relaxation: time constant of its speed [s].
        noise: standard deviation of the speed change in a second [m/s].
        free: share of the IDM's acceleration behind nobody.
    """

    relaxation: float = KEPT
    noise: float = 0.3
    free: float = 0.0


def mean_speed(platoons: Platoons) -> Float[np.ndarray, "platoon"]:
    """Returns the mean speed of all vehicles over their histories [m/s]."""
    return np.where(platoons.valid, platoons.v, 0.0).sum(axis=(1, 2)) / platoons.valid.sum(axis=(1, 2))


def fit_head(
    driver: Float[np.ndarray, "param"],
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    leader_truth: Float[np.ndarray, "platoon step"],
) -> Head:
    """Returns the head that brings training vehicles' leaders, and vehicles without one, nearest to where they went.

    Args:
        driver: the average one's parameters of the IDM.
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
    tried = [(time, 0.0) for time in RELAXATIONS] + [(KEPT, share) for share in SHARES]
    kept = _given(KEPT, 0.0, driver, speed, around, moved)
    other = min((_given(*one, driver, speed, around, moved) for one in tried), key=lambda found: found[0])
    return other[1] if other[0] < WORTH * kept[0] else kept[1]


def _given(
    relaxation: float,
    free: float,
    driver: Float[np.ndarray, "param"],
    speed: Float[np.ndarray, "case"],
    around: Float[np.ndarray, "case"],
    moved: Float[np.ndarray, "case second"],
) -> tuple[float, Head]:
    """Returns the mean error of a relaxation and a share of the free acceleration, and the head that they make."""
    _, _, highest, _, desired, exponent = driver
    steps = STEPS_PER_SECOND * moved.shape[1]
    forecast, v = np.zeros((len(speed), steps)), speed
    for step in range(steps):
        freely = highest * (1.0 - (np.maximum(v, MINIMUM_SPEED) / desired) ** exponent)
        v = np.maximum(v + STEP * ((around - v) / relaxation + free * freely), 0.0)
        forecast[:, step] = v * STEP
    forecast = np.cumsum(forecast, axis=1)[:, WHOLE_SECONDS]
    seen = np.isfinite(moved)
    left = (moved - forecast)[seen]
    # variance of the place of an Ornstein-Uhlenbeck speed whose noise is 1 m/s in a second
    time = STEP * (1 + np.arange(steps)[WHOLE_SECONDS])
    fading = np.exp(-time / relaxation)
    variance = relaxation**2 * (time - 2 * relaxation * (1 - fading) + relaxation / 2 * (1 - fading**2))
    noise = float(np.sqrt(np.mean(left**2 / np.broadcast_to(variance, moved.shape)[seen])))
    return float(np.abs(left).mean()), Head(relaxation, noise, free)
