"""What drivers do beside their law: a residual acceleration that fades as an AR(1) process does.

Its size, how fast it fades, and how much of the residual at t = 0 is real (an acceleration at the end of a history is
a poor one) are learned from where training vehicles were 1 to 3 s later behind their real leaders.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rampcast.horizon import STEP
from rampcast.models.drivers import DriverPrior, behind_leader, posterior
from rampcast.traffic.platoons import Platoons, known_lengths
from rampcast.traffic.situation import NOBODY, Situation

STEPS = np.array([4, 9, 14])  # 1, 2 and 3 s after t = 0: later, the driver's law takes back what it did
PERSISTENCES = (0.7, 0.8, 0.85, 0.9, 0.93, 0.96)  # a step of 0.2 s, that are tried: they fade within 0.6 to 5 s
LEAST_CASES = 20  # of fewer, neither size nor persistence is known
MOST_CASES = 1000  # three numbers need no more


@dataclass(frozen=True)
class Disturbance:
    """A residual acceleration as an AR(1) process.

    Attributes:
        persistence: share of it that is left after a step of 0.2 s.
        size: its standard deviation [m/s^2].
        trust: share of the residual at t = 0 with which it begins.
    """

    persistence: float = 0.9
    size: float = 0.3
    trust: float = 0.3


def fit_disturbance(
    prior: DriverPrior,
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    leader_truth: Float[np.ndarray, "platoon step"],
) -> Disturbance:
    """Returns the process under which the training vehicles' places after 1 to 3 s are likeliest.

    Args:
        prior: over drivers.
        platoons: of the training vehicles.
        truth: their displacements [m]; NaN where not seen.
        leader_truth: front of their leaders, counted from the same places [m]; NaN where not seen.
    """
    known = (platoons.depth > 0) & (np.isfinite(truth) & np.isfinite(leader_truth))[:, : STEPS[-1] + 1].all(axis=1)
    rows = np.flatnonzero(known)
    if len(rows) < LEAST_CASES:
        return Disturbance()
    rows = rows[:: -(-len(rows) // MOST_CASES)]
    some = platoons.select(rows)
    weights = posterior(prior, some)
    ahead = np.where(np.isfinite(leader_truth), leader_truth, 0.0)[rows]
    driven = np.einsum("pd,pds->ps", weights, behind_leader(prior.table, some, ahead))[:, STEPS]
    beyond = truth[rows][:, STEPS] - driven
    gap = some.x[:, 1, -1] - some.x[:, 0, -1] - known_lengths(some)[:, 1]
    now = (some.v[:, 0, -1], some.v[:, 1, -1], gap, some.a[:, 0, -1], some.present[:, 1])
    start = _residual(weights @ prior.table, *now)
    return min((_given(persistence, start, beyond) for persistence in PERSISTENCES), key=lambda found: found[0])[1]


def residuals_now(
    drivers: Float[np.ndarray, "vehicle param_and_habit"], situation: Situation
) -> Float[np.ndarray, "vehicle"]:
    """Returns the acceleration at t = 0 beyond the law's [m/s^2]; 0 behind no leader.

    Args:
        drivers: expected parameters of the driver of each vehicle, and the habit.
        situation: of any number of moments.
    """
    led = situation.leader != NOBODY
    leader = np.where(led, situation.leader, 0)
    gap = situation.x[leader, -1] - situation.length[leader] - situation.x[:, -1]
    return _residual(drivers, situation.v[:, -1], situation.v[leader, -1], gap, situation.a[:, -1], led)


def _residual(
    drivers: Float[np.ndarray, "row param_and_habit"],
    speed: Float[np.ndarray, "row"],
    leader_speed: Float[np.ndarray, "row"],
    gap: Float[np.ndarray, "row"],
    a: Float[np.ndarray, "row"],
    led: Bool[np.ndarray, "row"],
) -> Float[np.ndarray, "row"]:
    from rampcast.models.driver_loops import residuals  # numba: only who forecasts waits for it

    found = np.empty(len(speed))
    residuals(drivers, speed, leader_speed, gap, a, led, found)
    return found


def _given(
    persistence: float, start: Float[np.ndarray, "row"], beyond: Float[np.ndarray, "row knot"]
) -> tuple[float, Disturbance]:
    """Returns minus the log-likelihood of a persistence with its best size and trust, and these."""
    moved = np.cumsum(np.cumsum(persistence ** np.arange(1, STEPS[-1] + 2)))[STEPS] * STEP**2  # by 1 m/s^2 at t = 0
    spread = _spread(persistence)
    expected = start[:, None] * moved
    weight = 1.0 / spread**2
    trust = float(np.clip((weight * expected * beyond).sum() / max((weight * expected**2).sum(), 1e-9), 0.0, 1.0))
    left = (beyond - trust * expected) / spread
    left = np.clip(left, *np.quantile(left, (0.02, 0.98)))  # a few careless drivers are not the rule
    size = max(float(np.sqrt(np.mean(left**2))), 1e-3)
    minus_likelihood = float(np.log(size) + np.log(spread).mean())
    return minus_likelihood, Disturbance(persistence, size, trust)


def _spread(persistence: float) -> Float[np.ndarray, "knot"]:
    """Returns the standard deviation [m] of the displacement after `STEPS` that a process of size 1 m/s^2 makes."""
    count = STEPS[-1] + 1
    after = np.arange(count)
    # a kick in step k moves the vehicle until step n by sum over j = k ... n of (n - j + 1) persistence^(j - k)
    effect = np.array([[((n - k + 1) - after[: n - k + 1]) @ persistence ** after[: n - k + 1] if n >= k else 0.0
                        for k in range(count)] for n in STEPS])  # fmt: skip
    kicks = np.sqrt(1.0 - persistence**2)
    return kicks * np.sqrt((effect**2).sum(axis=1)) * STEP**2
