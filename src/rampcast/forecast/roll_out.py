"""The joint roll-out: all vehicles of a site driven into the future together, many times over.

In each sample every vehicle has one driver, drawn from its own posterior, one residual acceleration and one trajectory,
and all others react to that one. A vehicle on the ramp brakes for the end of its lane, minds who is beside it, and
changes lane when its hazard has added up to a threshold drawn beforehand; never into a vehicle. Vehicles of main lanes
change to the next one at a learned rate where they find room.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtri

from rampcast.forecast.roll_out_arrays import Draws, Law, Start
from rampcast.horizon import FUTURE, STEP
from rampcast.models.disturbance import Disturbance, residuals_now
from rampcast.models.drivers import DriverPrior, posteriors, with_habit
from rampcast.models.merging import UNKNOWN_OFFSET, MergeHazard
from rampcast.models.platoon_head import Head
from rampcast.threads import in_threads, thread_count
from rampcast.traffic.situation import ROWS_OF_DRAWS, Situation

Task = tuple[int, int, int, int]
Result = TypeVar("Result")
FEW_ROWS = 32  # of random numbers: what merge scenes need, whose places have their own


class Drivers(NamedTuple):
    """Drivers as the kernel takes them: with their habits, and what they do behind nobody; see `Law`."""

    table: Float[np.ndarray, "driver param_and_habit"]
    free: Float[np.ndarray, "driver speed"]


@dataclass(frozen=True)
class Manners:
    """How vehicles mind each other across a lane line.

    Attributes:
        putative_leader: weight with which a ramp vehicle follows the vehicle ahead in its target lane before it merges;
            the paper's actual leader has one half.
        courtesy: weight with which a vehicle of the target lane follows a ramp vehicle ahead of it.
        change_rate: of lane changes between main lanes [1/s].
    """

    putative_leader: float = 0.0
    courtesy: float = 0.0
    change_rate: float = 0.0


@dataclass(frozen=True)
class RollOut:
    """All that is learned for driving the traffic of a site along.

    Attributes:
        main, ramp: priors over the drivers of the main lanes and of the ramp.
        disturbance: what drivers do beside their law.
        head: how a vehicle without a leader goes on.
        hazard: when vehicles on the ramp merge.
        manners: see there.
        limit: speed that none exceeds who does not at t0 [m/s].
    """

    main: DriverPrior
    ramp: DriverPrior
    disturbance: Disturbance
    head: Head
    hazard: MergeHazard
    manners: Manners
    limit: float

    @cached_property
    def drivers(self) -> Drivers:
        """Returns the drivers of the main lanes, and then those of the ramp."""
        return _drivers(np.concatenate([self.main.table, self.ramp.table]))

    @cached_property
    def average(self) -> Drivers:
        """Returns the average driver of the main lanes, and that of the ramp."""
        return _drivers(np.concatenate([with_habit(one.centre[None], one.habit) for one in (self.main, self.ramp)]))


def _drivers(table: Float[np.ndarray, "driver param_and_habit"]) -> Drivers:
    from rampcast.models.driver_loops import free_table  # numba: only who drives waits for it

    return Drivers(table, free_table(table))


class Driven(NamedTuple):
    """Sampled futures at 0.2, 0.4 ... 15 s of the vehicles asked for.

    Attributes:
        x: fronts [m].
        lane: index of the lane.
        chance: probability to merge in each step, as the hazards give it.
        seen, can: features of the hazard at each step of a vehicle that does not merge, and whether it could; empty
            unless asked for.
    """

    x: Float[np.ndarray, "vehicle sample step"]
    lane: Int[np.ndarray, "vehicle sample step"]
    chance: Float[np.ndarray, "vehicle step"]
    seen: Float[np.ndarray, "vehicle sample watched feature"]
    can: Bool[np.ndarray, "vehicle sample watched"]


@dataclass(frozen=True)
class Beginning:
    """A situation, made ready to be driven with a model.

    Attributes:
        situation: see there.
        start: the same as the kernel takes it.
        weights: of the drivers of each vehicle; they add up to 1.
    """

    situation: Situation
    start: Start
    weights: Float[np.ndarray, "vehicle driver"]


def begin(model: RollOut, situation: Situation) -> Beginning:
    """Returns the situation with what its histories tell of the drivers."""
    merging = situation.merging
    weights, expected = (
        np.empty((len(merging), len(model.main.drivers))),
        np.empty((len(merging), len(model.main.centre) + 1)),
    )
    for prior, some in ((model.main, ~merging), (model.ramp, merging)):
        weights[some] = posteriors(prior, situation, some)
        expected[some] = weights[some] @ prior.table
    moment, x = situation.moment, np.ascontiguousarray(situation.x[:, -1])  # one layout: loops are compiled for each
    by_place = np.lexsort((x, moment))
    start = Start(
        first=situation.first,
        order=by_place - situation.first[moment],
        x=x,
        v=np.maximum(situation.v[:, -1], 0.0),
        residual=model.disturbance.trust * residuals_now(expected, situation),
        around=_mean_speeds(situation),
        length=situation.length,
        gap=situation.gap,
        lane=situation.lane,
        offset=np.where(np.isfinite(situation.offset), situation.offset, UNKNOWN_OFFSET),
        approach=np.where(np.isfinite(situation.approach), situation.approach, 0.0),
        ready=situation.ready,
        draw=situation.draw,
        end=situation.end,
        begin=situation.begin,
        target=situation.target,
        source=situation.source,
        left=situation.left,
        right=situation.right,
    )
    return Beginning(situation, start, weights)


def drive(
    model: RollOut,
    beginning: Beginning,
    *,
    samples: int,
    seed: int,
    rate: Float[np.ndarray, "vehicle step"] | None = None,
    wanted: Bool[np.ndarray, "vehicle"] | None = None,
) -> Driven:
    """Returns sampled futures.

    A vehicle has the same random numbers whatever its company.

    Args:
        model: see `RollOut`.
        beginning: see `begin`.
        samples: how many futures.
        seed: of the random numbers.
        rate: by what the hazard of each vehicle is multiplied in each step; None for 1.
        wanted: whose futures are returned; None for all.
    """
    may = np.ones(len(beginning.weights), dtype=bool)
    return _driven(model, beginning, samples=samples, seed=seed, rate=rate, wanted=wanted, may=may, watched=0)


def drive_waiting(model: RollOut, beginning: Beginning, *, samples: int, seed: int) -> Driven:
    """Returns sampled futures in which the first vehicle of each moment does not merge, and what its hazard sees."""
    first = np.zeros(len(beginning.weights), dtype=bool)
    first[beginning.situation.first[:-1]] = True
    return _driven(
        model, beginning, samples=samples, seed=seed, rate=None, wanted=first, may=~first, watched=FUTURE
    )  # fmt: skip


def drive_average(model: RollOut, beginning: Beginning) -> Float[np.ndarray, "vehicle step"]:
    """Returns fronts [m] if all drivers were the average one, did nothing beside their law, and did not merge."""
    start = beginning.start._replace(residual=np.zeros_like(beginning.start.residual))
    count = len(beginning.weights)
    still = Draws(
        np.zeros((FEW_ROWS, 1, FUTURE), np.float32),
        np.full((FEW_ROWS, 1), np.inf),
        np.full((FEW_ROWS, 1), np.inf),
        np.ones(1),
    )
    found = _filled(
        model,
        start._replace(draw=np.zeros_like(start.draw)),
        still,
        model.average,
        np.where(beginning.situation.merging, 1, 0)[:, None],
        rate=np.ones((count, FUTURE)),
        may=np.ones(count, dtype=bool),
        wanted=np.ones(count, dtype=bool),
        watched=0,
    )
    return found.x[:, 0].astype(float)


def _driven(
    model: RollOut,
    beginning: Beginning,
    *,
    samples: int,
    seed: int,
    rate: Float[np.ndarray, "vehicle step"] | None,
    wanted: Bool[np.ndarray, "vehicle"] | None,
    may: Bool[np.ndarray, "vehicle"],
    watched: int,
) -> Driven:
    rows = FEW_ROWS if beginning.start.draw.max(initial=0) < FEW_ROWS else ROWS_OF_DRAWS
    draws, order = _draws(rows, samples, seed)
    draws = draws._replace(pace=draws.pace**model.hazard.unknown)
    driver = drawn_drivers(beginning.weights, order[beginning.start.draw])
    driver += np.where(beginning.situation.merging, len(model.main.drivers), 0)[:, None]
    count = len(beginning.weights)
    return _filled(
        model,
        beginning.start,
        draws,
        model.drivers,
        driver,
        rate=np.ones((count, FUTURE)) if rate is None else rate,
        may=may,
        wanted=np.ones(count, dtype=bool) if wanted is None else wanted,
        watched=watched,
    )


def _filled(
    model: RollOut,
    start: Start,
    draws: Draws,
    drivers: Drivers,
    driver: Int[np.ndarray, "vehicle sample"],
    *,
    rate: Float[np.ndarray, "vehicle step"],
    may: Bool[np.ndarray, "vehicle"],
    wanted: Bool[np.ndarray, "vehicle"],
    watched: int,
) -> Driven:
    """Returns what the kernel fills in, moments or samples shared out among the threads."""
    from rampcast.forecast.roll_out_kernel import CHANCES  # numba: only who forecasts waits for it
    from rampcast.forecast.roll_out_kernel import drive as run

    samples, moments = driver.shape[1], len(start.first) - 1
    row = np.where(wanted, np.cumsum(wanted) - 1, -1)
    count, features = int(wanted.sum()), len(model.hazard.weights)
    found = Driven(
        x=np.empty((count, samples, FUTURE), np.float32),
        lane=np.empty((count, samples, FUTURE), np.int16),
        chance=np.zeros((count, FUTURE)),
        seen=np.empty((count, samples, watched, features)),
        can=np.zeros((count, samples, watched), dtype=bool),
    )
    hazard = np.array([*model.hazard.weights, model.hazard.constant, model.hazard.first, model.hazard.last])
    learned = Law(*drivers, _numbers(model), hazard)

    def work(task: Task) -> np.ndarray:
        chance = np.zeros(rate.shape, np.int64)
        run(
            start, learned, draws, driver, rate, may, row, task[:2], task[2:], found.x, found.lane, chance,
            found.seen, found.can,
        )  # fmt: skip
        return chance

    found.chance[:] = np.sum(sharing(work, moments, samples), axis=0)[wanted] / (CHANCES * samples)
    return found


def sharing(work: Callable[[Task], Result], moments: int, samples: int) -> list[Result]:
    """Returns what the threads made of their shares: of the moments where there are enough of them, else of samples.

    Args:
        work: takes first and stop of the moments, then of the samples.
        moments, samples: how many there are.
    """
    threads = thread_count()
    if moments >= 4 * threads:
        edges = np.linspace(0, moments, threads + 1).astype(int).tolist()
        return in_threads(work, [(low, high, 0, samples) for low, high in itertools.pairwise(edges)])
    parts = max(1, min(threads, samples))
    edges = [samples * part // parts for part in range(parts + 1)]
    return in_threads(work, [(0, moments, low, high) for low, high in itertools.pairwise(edges)])


def _numbers(model: RollOut) -> Float[np.ndarray, "number"]:
    """Returns the numbers of `roll_out_kernel.Law`."""
    persistence, size = model.disturbance.persistence, model.disturbance.size
    kick = size * np.sqrt(1.0 - persistence**2)
    head, manners = model.head, model.manners
    return np.array(
        [
            *(persistence, kick),
            *(1.0 / head.relaxation, head.noise * np.sqrt(STEP), head.free),
            *(manners.putative_leader, manners.courtesy, manners.change_rate),
            model.limit,
        ]
    )


@lru_cache(maxsize=4)  # of the last few seeds and numbers of samples: they take longer to draw than a forecast
def _draws(rows: int, samples: int, seed: int) -> tuple[Draws, Int[np.ndarray, "row sample"]]:
    """Returns noise with mean zero over the samples, and orders of drivers; thresholds and paces are stratified.

    Thresholds have a unit exponential distribution, logarithms of paces a unit normal one.
    """
    generators = np.random.default_rng(seed).spawn(5)
    ordering, merging, changing, driving, pacing = generators  # so that few rows begin as many do
    share = (np.arange(samples) + 0.5) / samples
    order = np.stack([ordering.permutation(samples) for _ in range(rows)])
    threshold, change = (
        np.stack([-np.log(chance.permutation(share)) for _ in range(rows)]) for chance in (merging, changing)
    )
    noise = driving.standard_normal((rows, samples, FUTURE), dtype=np.float32)
    noise -= noise.mean(axis=1, keepdims=True)
    return Draws(noise, threshold, change, np.exp(ndtri(pacing.permutation(share)))), order


def drawn_drivers(
    weights: Float[np.ndarray, "vehicle driver"], order: Int[np.ndarray, "vehicle sample"]
) -> Int[np.ndarray, "vehicle sample"]:
    """Returns drivers in proportion to their weights, by systematic resampling, each vehicle in an order of its own."""
    samples = order.shape[1]
    shares = np.cumsum(weights, axis=1)
    # the places of all shares among the samples' own, one row after the other
    count = np.ceil(np.clip(shares, 0.0, 1.0) * samples - 0.5).astype(np.int64)
    count[:, -1] = samples
    taken = np.diff(count, axis=1, prepend=0)
    driver = np.repeat(np.tile(np.arange(weights.shape[1]), len(weights)), taken.ravel()).reshape(len(weights), samples)
    return np.take_along_axis(driver, order, axis=1)


def _mean_speeds(situation: Situation) -> Float[np.ndarray, "vehicle"]:
    """Returns the mean speed of all vehicles of its lane over their histories, for each vehicle [m/s]."""
    key = situation.moment * (int(situation.lane.max(initial=0)) + 1) + situation.lane
    total = np.bincount(key, weights=np.where(situation.valid, situation.v, 0.0).sum(axis=1))
    count = np.bincount(key, weights=situation.valid.sum(axis=1))
    return (total / np.maximum(count, 1))[key]
