"""Drivers: a prior over the IDM's parameters from closed-loop trajectories, and what a vehicle's history adds to it.

The centre of the prior is the driver that brings all training vehicles nearest to where they went, driven in closed
loop behind their real leaders; the logarithms of the parameters scatter about it. A set of drivers drawn once from the
prior stands for it, and the posterior of a vehicle weighs these by how well each reproduces its history, again in
closed loop. Nothing is optimised when forecasting: 0.4 s of history, or one with holes, is as good an input as 4 s.

How far drivers scatter, and how much a history counts, is what forecasts the training vehicles best from their
histories alone. Fits of six parameters to 4 s without a prior overfit: docs/limits.md measures it.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float
from scipy.stats import norm, qmc

from rampcast.compute import jax, jnp, over_blocks, program
from rampcast.horizon import STEP
from rampcast.models.pooled_driver import fit_pooled_driver, true_leader
from rampcast.physics import idm
from rampcast.physics.gap import net_gap
from rampcast.traffic.platoons import Platoons, known_lengths

DRIVERS = 64  # that stand for the prior
SCATTERS = (0.1, 0.15, 0.2, 0.3)  # standard deviations of the logarithms that are tried
INDEPENDENCES = (0.4, 1.0, 2.5)  # [1/s] independent errors a second of history that are tried
MOST_CASES = 1000  # to choose among these; more choose the same
NEAR, GROWTH = 0.3, 0.15  # [m], [m/s]: usual size of a closed-loop error, and its growth with the time driven
RAREST = 1e-3  # quantile beyond which no driver is drawn
BLOCKS = (64, 256, 1024)  # rows that programs are compiled for: a fuller block wastes less than a large one
SCATTERING = 5  # parameters that differ between drivers; all share the exponent


@dataclass(frozen=True)
class DriverPrior:
    """A prior over drivers.

    Attributes:
        centre: the parameters of the IDM, in the order of `physics.idm.Parameters`.
        scatter: standard deviation of the logarithms of all of them but the exponent.
        independence: independent errors in a second of history [1/s].
        drivers: parameters of the drivers that stand for the prior, equally likely.
    """

    centre: Float[np.ndarray, "param"]
    scatter: float
    independence: float
    drivers: Float[np.ndarray, "driver param"]


def fit_drivers(
    platoons: Platoons, truth: Float[np.ndarray, "platoon step"], leader_truth: Float[np.ndarray, "platoon step"]
) -> DriverPrior:
    """Returns the prior that forecasts the training vehicles best behind the true futures of their leaders.

    Args:
        platoons: of the training vehicles.
        truth: their displacements [m] after t = 0; NaN where not seen.
        leader_truth: front of their leaders, counted from the same places [m]; NaN where not seen.
    """
    centre = fit_pooled_driver(platoons, truth, leader_truth=leader_truth)
    known = (platoons.depth > 0) & np.isfinite(truth).all(axis=1) & np.isfinite(leader_truth).all(axis=1)
    rows = np.flatnonzero(known)
    rows = rows[:: max(1, len(rows) // MOST_CASES)]
    if not len(rows):
        return _prior(centre, SCATTERS[0], INDEPENDENCES[0])
    some = platoons.select(rows)
    best, prior = np.inf, None
    for scatter in SCATTERS:
        drivers = _prior(centre, scatter, 1.0).drivers
        futures = behind_leader(drivers, some, leader_truth[rows])
        likelihood = history_likelihood(drivers, some)
        for independence in INDEPENDENCES:
            mean = np.einsum("pd,pds->ps", _normalised(independence * likelihood), futures)
            error = float(np.abs(mean - truth[rows]).mean())
            if error < best:
                best, prior = error, _prior(centre, scatter, independence)
    assert prior is not None
    return prior


def posterior(prior: DriverPrior, platoons: Platoons, *, place: int = 0) -> Float[np.ndarray, "platoon driver"]:
    """Returns the weight of each driver for the vehicle in a place of each platoon, from its own history; sums to 1.

    Args:
        prior: see `fit_drivers`.
        platoons: at least one.
        place: of the vehicle, below the last; behind no leader all weights are equal.
    """
    return _normalised(prior.independence * history_likelihood(prior.drivers, platoons, place=place))


def posteriors(prior: DriverPrior, platoons: Platoons) -> Float[np.ndarray, "platoon follower driver"]:
    """Returns the weight of each driver for every vehicle but the last place's; equal weights behind no leader.

    Args:
        prior: see `fit_drivers`.
        platoons: at least one.
    """
    followers = platoons.x.shape[1] - 1
    weights = np.full((len(platoons), followers, len(prior.drivers)), 1.0 / len(prior.drivers))
    for place in range(followers):
        rows = np.flatnonzero(platoons.present[:, place + 1])
        if len(rows):
            weights[rows, place] = posterior(prior, platoons.select(rows), place=place)
    return weights


def history_likelihood(
    drivers: Float[np.ndarray, "driver param"], platoons: Platoons, *, place: int = 0
) -> Float[np.ndarray, "platoon driver"]:
    """Returns the logarithm of each history's likelihood under each driver, per independent error a second.

    Args:
        drivers: parameters of the IDM.
        platoons: at least one.
        place: of the vehicle whose history is looked at.
    """
    both = platoons.valid[:, place] & platoons.valid[:, place + 1]
    origin = np.where(platoons.present[:, place], platoons.x[:, place, -1], 0.0)[:, None]
    states = (
        platoons.x[:, place] - origin,
        np.maximum(platoons.v[:, place], 0.0),
        platoons.x[:, place + 1] - origin,
        platoons.v[:, place + 1],
    )
    rows = [np.where(both, values, 0.0).astype(np.float32) for values in states]
    length = known_lengths(platoons)[:, place + 1].astype(np.float32)
    (found,) = over_blocks(partial(_likelihood, jnp.asarray(drivers, jnp.float32)), (*rows, both, length), sizes=BLOCKS)
    return np.asarray(found, float)


def behind_leader(
    drivers: Float[np.ndarray, "driver param"], platoons: Platoons, leader_truth: Float[np.ndarray, "platoon step"]
) -> Float[np.ndarray, "platoon driver step"]:
    """Returns the displacement [m] of each central vehicle under each driver behind its leader's given future.

    Args:
        drivers: parameters of the IDM.
        platoons: each with a leader.
        leader_truth: front of the leader, counted from the central vehicle's place at t = 0 [m]; none is missing.
    """
    leader_x, leader_v = true_leader(platoons, leader_truth)
    speed = np.maximum(platoons.v[:, 0, -1], 0.0)
    rows = [values.astype(np.float32) for values in (speed, known_lengths(platoons)[:, 1], leader_x, leader_v)]
    (found,) = over_blocks(partial(_behind, jnp.asarray(drivers, jnp.float32)), rows, sizes=BLOCKS)
    return np.asarray(found, float)


def _prior(centre: Float[np.ndarray, "param"], scatter: float, independence: float) -> DriverPrior:
    points = qmc.Sobol(SCATTERING, seed=1).random(DRIVERS)
    offsets = scatter * norm.ppf(np.clip(points, RAREST, 1 - RAREST))
    scattered = centre[:SCATTERING] * np.exp(offsets - offsets.mean(axis=0))
    return DriverPrior(
        centre, scatter, independence, np.column_stack([scattered, np.full(DRIVERS, centre[SCATTERING])])
    )


def _normalised(log_weight: Float[np.ndarray, "platoon driver"]) -> Float[np.ndarray, "platoon driver"]:
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return weight / weight.sum(axis=1, keepdims=True)


def _record(drivers: Float[Array, "driver param"]) -> idm.Parameters:
    return idm.Parameters(*(drivers[:, index, None] for index in range(drivers.shape[1])))


@program
def _likelihood(
    drivers: Float[Array, "driver param"],
    x: Float[ArrayLike, "row moment"],
    v: Float[ArrayLike, "row moment"],
    leader_x: Float[ArrayLike, "row moment"],
    leader_v: Float[ArrayLike, "row moment"],
    seen: Bool[ArrayLike, "row moment"],
    length: Float[ArrayLike, "row"],
) -> tuple[Float[Array, "row driver"]]:
    """Returns minus the time integral of the closed-loop errors, each over the size usual after so long a drive.

    A drive begins, and begins anew after a hole, at the first moment at which follower and leader are seen.
    """
    record = _record(drivers)
    lowest, highest = idm.limits(record)
    step_length = jnp.float32(STEP)

    def step(state: tuple[Array, ...], now: tuple[Array, ...]) -> tuple[tuple[Array, ...], None]:
        place, speed, driven, total = state
        x, v, leader_x, leader_v, seen = now
        going = seen & (driven > 0)
        total = total + jnp.where(going, jnp.abs(place - x) / (NEAR + GROWTH * driven), 0.0)
        place, speed = jnp.where(going, place, x), jnp.where(going, speed, v)
        gap = net_gap(place, leader_x, jnp.asarray(length))
        a = jnp.clip(idm.acceleration(record, speed=speed, leader_speed=leader_v, gap=gap), lowest, highest)
        speed = jnp.maximum(speed + a * step_length, 0.0)
        return (place + speed * step_length, speed, jnp.where(seen, driven + step_length, 0.0), total), None

    zero = jnp.zeros((len(drivers), len(jnp.asarray(length))), jnp.float32)
    moments = tuple(jnp.asarray(values).T for values in (x, v, leader_x, leader_v, seen))
    start: tuple[Array, ...] = (zero, zero, zero[0], zero)
    last, _ = jax.lax.scan(step, start, moments)
    return (-step_length * last[3].T,)


@program
def _behind(
    drivers: Float[Array, "driver param"],
    v: Float[ArrayLike, "row"],
    length: Float[ArrayLike, "row"],
    leader_x: Float[ArrayLike, "row step"],
    leader_v: Float[ArrayLike, "row step"],
) -> tuple[Float[Array, "row driver step"]]:
    record = _record(drivers)
    lowest, highest = idm.limits(record)
    step_length = jnp.float32(STEP)

    def step(state: tuple[Array, Array], ahead: tuple[Array, Array]) -> tuple[tuple[Array, Array], Array]:
        x, v = state
        a = idm.acceleration(record, speed=v, leader_speed=ahead[1], gap=net_gap(x, ahead[0], jnp.asarray(length)))
        v = jnp.maximum(v + jnp.clip(a, lowest, highest) * step_length, 0.0)
        x = x + v * step_length
        return (x, v), x

    zero = jnp.zeros((len(drivers), len(jnp.asarray(length))), jnp.float32)
    _, xs = jax.lax.scan(step, (zero, zero + v), (jnp.asarray(leader_x).T, jnp.asarray(leader_v).T))
    return (jnp.moveaxis(xs, 0, -1).swapaxes(0, 1),)
