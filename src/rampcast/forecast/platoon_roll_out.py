"""Platoons driven into the future together, many times over: every vehicle follows its own leader.

In each sample every vehicle has a driver drawn from its own posterior and a residual acceleration of its own; the head
of the platoon about keeps its speed, or returns to the mean. No vehicle reverses, runs into its leader, or exceeds the
speed limit.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from rampcast.compute import jax, jnp, over_blocks, program
from rampcast.horizon import FUTURE, STEP
from rampcast.models.disturbance import Disturbance, fit_disturbance, residual_now
from rampcast.models.drivers import DriverPrior, fit_drivers, posteriors
from rampcast.models.platoon_head import Head, fit_head, mean_speed
from rampcast.physics import idm
from rampcast.physics.gap import net_gap
from rampcast.traffic.platoons import PLACES, Platoons, known_lengths

DEPTHS = (1, 2, 4, PLACES - 1)  # numbers of leaders that programs are compiled for
BLOCKS = (16, 128)  # rows likewise: 128 x 100 samples x 9 places fit into a processor's cache
SPEED_MARGIN = 1.1  # the speed limit over the highest speed in training
FAR = 1e6  # [m] ahead: where an empty place lies


@dataclass(frozen=True)
class RollOut:
    """All that is learned for driving a platoon along.

    Attributes:
        prior: over drivers.
        disturbance: what drivers do beside their law.
        head: how the first vehicle goes on.
        limit: speed that none exceeds who does not at t = 0 [m/s].
    """

    prior: DriverPrior
    disturbance: Disturbance
    head: Head
    limit: float


class Samples(NamedTuple):
    """Sampled futures at 0.2, 0.4 ... 15 s.

    Attributes:
        x: displacement of the central vehicle [m].
        leader_x: front of its leader, counted from the same place [m]; NaN where there is none.
    """

    x: Float[np.ndarray, "platoon sample step"]
    leader_x: Float[np.ndarray, "platoon sample step"]


def fit_roll_out(
    platoons: Platoons, truth: Float[np.ndarray, "platoon step"], leader_truth: Float[np.ndarray, "platoon step"]
) -> RollOut:
    """Returns drivers, their disturbances and heads of platoons as the training vehicles show them.

    Args:
        platoons: of the training vehicles.
        truth: their displacements [m]; NaN where not seen.
        leader_truth: front of their leaders, counted from the same places [m]; NaN where not seen.
    """
    prior = fit_drivers(platoons, truth, leader_truth)
    return RollOut(
        prior=prior,
        disturbance=fit_disturbance(prior, platoons, truth, leader_truth),
        head=fit_head(platoons, truth, leader_truth),
        limit=SPEED_MARGIN * float(platoons.v[platoons.valid].max()),
    )


def sample_platoons(
    model: RollOut,
    platoons: Platoons,
    *,
    samples: int,
    seed: int,
    weights: Float[np.ndarray, "platoon follower driver"] | None = None,
) -> Samples:
    """Returns sampled futures of the central vehicles and of their leaders.

    All platoons share one set of random numbers, so that a platoon's forecast does not depend on its company.

    Args:
        model: see `fit_roll_out`.
        platoons: at least one.
        samples: how many futures of each.
        seed: of the random numbers.
        weights: posteriors of the drivers, if they are known already.
    """
    weights = posteriors(model.prior, platoons) if weights is None else weights
    chance = np.random.default_rng(seed)
    noise = chance.standard_normal((PLACES, FUTURE, samples))
    noise -= noise.mean(axis=2, keepdims=True)
    order = np.stack([chance.permutation(samples) for _ in range(PLACES - 1)])
    found = Samples(*(np.empty((len(platoons), samples, FUTURE), np.float32) for _ in range(2)))
    depth = np.maximum(platoons.depth, 1)
    for low, high in zip((0, *DEPTHS), DEPTHS, strict=False):
        rows = np.flatnonzero((depth > low) & (depth <= high))
        if len(rows):
            numbers = jnp.asarray(noise[: high + 1].swapaxes(0, 1), jnp.float32)
            states = _states(model, platoons.select(rows), weights[rows, :high], order[:high])
            program = partial(_sampled, numbers, jnp.asarray(model.prior.drivers, jnp.float32), numbers_of(model))
            for all_rows, values in zip(found, over_blocks(program, states, sizes=BLOCKS), strict=True):
                all_rows[rows] = values
    found.leader_x[~platoons.present[:, 1]] = np.nan
    return found


def numbers_of(model: RollOut) -> Float[Array, "number"]:
    """Returns what the program needs to know of disturbance and head, in the order in which it takes them."""
    persistence, size = model.disturbance.persistence, model.disturbance.size
    kick = size * np.sqrt(1.0 - persistence**2)
    return jnp.asarray([persistence, kick, STEP / model.head.relaxation, model.head.noise * np.sqrt(STEP)], jnp.float32)


def _states(
    model: RollOut,
    platoons: Platoons,
    weights: Float[np.ndarray, "platoon follower driver"],
    order: Int[np.ndarray, "follower sample"],
) -> tuple[np.ndarray, ...]:
    """Returns what is known at t = 0 of the places that count, and the driver of each sample."""
    followers = weights.shape[1]
    some = slice(0, followers + 1)
    present = platoons.present[:, some]
    x = np.where(present, platoons.x[:, some, -1] - platoons.x[:, :1, -1], FAR)
    v = np.where(present, np.maximum(platoons.v[:, some, -1], 0.0), 0.0)
    # vehicles that overlap at t = 0 (noise, or a length not known) have no room, but no less than none
    room = np.where(present[:, 1:], np.diff(x, axis=1), FAR)
    length = np.minimum(known_lengths(platoons)[:, 1 : followers + 1], np.maximum(room, 0.0))
    start = model.disturbance.trust * residual_now(model.prior, platoons, weights, followers=followers)
    target = mean_speed(platoons)
    limit = np.maximum(model.limit, v.max(axis=1))
    numbers = [values.astype(np.float32) for values in (x, v, length, start, target, limit)]
    return (*numbers, present, drawn_drivers(weights, order))


def drawn_drivers(
    weights: Float[np.ndarray, "platoon follower driver"], order: Int[np.ndarray, "follower sample"]
) -> Int[np.ndarray, "platoon follower sample"]:
    """Returns drivers in proportion to their weights (systematic resampling), in each place in an order of its own."""
    samples = order.shape[1]
    shares = np.cumsum(weights, axis=2)
    at = (order + 0.5) / samples
    drawn = (shares[:, :, None, :] < at[None, :, :, None]).sum(axis=3)
    return np.minimum(drawn, weights.shape[2] - 1).astype(np.int32)


@program
def _sampled(
    noise: Float[Array, "step place sample"],
    drivers: Float[Array, "driver param"],
    numbers: Float[Array, "number"],
    x: Float[ArrayLike, "row place"],
    v: Float[ArrayLike, "row place"],
    length: Float[ArrayLike, "row follower"],
    start: Float[ArrayLike, "row follower"],
    target: Float[ArrayLike, "row"],
    limit: Float[ArrayLike, "row"],
    present: Bool[ArrayLike, "row place"],
    driver: Int[ArrayLike, "row follower sample"],
) -> tuple[Float[Array, "row sample step"], Float[Array, "row sample step"]]:
    """Returns the samples of places 0 and 1; inside, the axes are place, sample, row."""
    persistence, kick, relaxing, shock = numbers
    x, v, length, start, present = (jnp.asarray(values).T[:, None] for values in (x, v, length, start, present))
    led, head = present[1:], present & ~jnp.concatenate([present[1:], jnp.zeros_like(present[:1])])
    own = drivers[jnp.asarray(driver).transpose(1, 2, 0)]
    record = idm.Parameters(*(own[..., index] for index in range(drivers.shape[1])))
    lowest, highest = idm.limits(record)
    step_length = jnp.float32(STEP)
    behind = jnp.concatenate([jnp.zeros_like(length[:1]), jnp.cumsum(length, axis=0)])

    def step(state: tuple[Array, ...], kicks: Array) -> tuple[tuple[Array, ...], Array]:
        x, v, extra = state
        extra = persistence * extra + kick * kicks[:-1, :, None]
        a = idm.acceleration(record, speed=v[:-1], leader_speed=v[1:], gap=net_gap(x[:-1], x[1:], length))
        a = jnp.where(led, jnp.clip(jnp.clip(a, lowest, highest) + extra, 2.0 * lowest, 2.0 * highest), 0.0)
        relaxed = v + relaxing * (target - v) + shock * kicks[:, :, None]
        faster = jnp.concatenate([v[:-1] + a * step_length, v[-1:]])
        v = jnp.clip(jnp.where(head, relaxed, faster), 0.0, limit)
        # nobody passes the rear of the vehicle ahead: from the head on, the smallest place less the lengths between
        moved = jax.lax.cummin(x + v * step_length - behind, axis=0, reverse=True) + behind
        moved = jnp.maximum(moved, x)
        return (moved, (moved - x) / step_length, extra), moved[:2]

    samples = noise.shape[2]
    state = tuple(jnp.broadcast_to(part, (len(part), samples, part.shape[2])) for part in (x, v, start))
    _, xs = jax.lax.scan(step, state, noise)
    return xs[:, 0].transpose(2, 1, 0), xs[:, 1].transpose(2, 1, 0)
