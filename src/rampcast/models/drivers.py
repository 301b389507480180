"""Drivers: a prior over the IDM's parameters from closed-loop trajectories, and what a vehicle's history adds to it.

The centre of the prior is the driver, and the habit of keeping the gap of now, that brings all training vehicles
nearest to where they went, driven in closed loop behind their real leaders; the logarithms of the parameters scatter
about it. A set of drivers drawn once from the prior stands for it, and the posterior of a vehicle weighs these by how
well each reproduces its history, again in closed loop. Nothing is optimised when forecasting: 0.4 s of history, or one
with holes, is as good an input as 4 s.

How far drivers scatter, and how much a history counts, is what forecasts the training vehicles best from their
histories alone. Where other sites are known, the centre is that of a site among them (`between_sites`), and drivers
scatter by what is not known of it too. Fits of six parameters to 4 s without a prior overfit: docs/limits.md measures
it.
"""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm, qmc

from rampcast.errors import ModelError
from rampcast.horizon import FUTURE, WHOLE_SECONDS
from rampcast.models.between_sites import Estimate, Evidence
from rampcast.models.pooled_driver import LEAST_CASES, START, TYPICAL_ERROR, true_leader
from rampcast.physics import idm
from rampcast.threads import shared_out
from rampcast.traffic.platoons import Platoons, known_lengths
from rampcast.traffic.situation import NOBODY, Situation

DRIVERS = 64  # that stand for the prior
SCATTERS = (0.1, 0.15, 0.2, 0.3)  # standard deviations of the logarithms that are tried
INDEPENDENCES = (0.4, 1.0, 2.5)  # [1/s] independent errors a second of history that are tried
MOST_CASES = 1000  # to choose among these; more choose the same
HABITS, START_HABIT = (0.0, 1.0), 0.5
DRIVEN = 1000  # vehicles that take a thread longer than it takes to begin
LEAST_SQUARE = 1e-4  # [m^2] of errors; who is driven nearer to where it went was driven by this law
NEAR, GROWTH = 0.3, 0.15  # [m], [m/s]: usual size of a closed-loop error, and its growth with the time driven
RAREST = 1e-3  # quantile beyond which no driver is drawn
SCATTERING = 5  # parameters that differ between drivers; all share the exponent
PARAMETERS = (*(f"log {name}" for name in idm.Parameters._fields), "habit")  # that differ between sites
LEAST_EXPONENT = 0.1  # whose logarithm is taken of one of 0


@dataclass(frozen=True)
class DriverPrior:
    """A prior over drivers.

    Attributes:
        centre: the parameters of the IDM, in the order of `physics.idm.Parameters`.
        habit: how far a driver's gaps are those of now; see `driver_loops.own_gap`.
        scatter: standard deviation of the logarithms of all of them but the exponent, among the drivers of a site.
        independence: independent errors in a second of history [1/s].
        drivers: parameters of the drivers that stand for the prior, equally likely.
    """

    centre: Float[np.ndarray, "param"]
    habit: float
    scatter: float
    independence: float
    drivers: Float[np.ndarray, "driver param"]

    def __post_init__(self) -> None:
        if not len(self.drivers) or len(self.centre) != len(idm.Parameters._fields):  # the compiled loops do not look
            raise ModelError(f"expected drivers of {len(idm.Parameters._fields)} parameters, got {self.drivers.shape}")

    @cached_property
    def table(self) -> Float[np.ndarray, "driver param_and_habit"]:
        """Returns the drivers as the loops take them."""
        return with_habit(self.drivers, self.habit)

    @cached_property
    def free(self) -> Float[np.ndarray, "driver speed"]:
        """Returns their accelerations behind nobody; see `driver_loops.free_table`."""
        from rampcast.models.driver_loops import free_table  # numba: only who drives waits for it

        return free_table(self.table)


def fit_drivers(
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    leader_truth: Float[np.ndarray, "platoon step"],
    *,
    about: Estimate | None = None,
    like: DriverPrior | None = None,
) -> DriverPrior:
    """Returns the prior that forecasts the training vehicles best behind the true futures of their leaders.

    Args:
        platoons: of the training vehicles.
        truth: their displacements [m] after t = 0; NaN where not seen.
        leader_truth: front of their leaders, counted from the same places [m]; NaN where not seen.
        about: the centre, and how far it is known, of `PARAMETERS`; None for that of the training vehicles alone.
        like: how far drivers scatter and histories count, if too few vehicles tell; None for little.
    """
    if about is None:
        fit, _ = _fit_centre(platoons, truth, leader_truth)
        prior = partial(_prior, fit.x[:-1], float(fit.x[-1]), np.zeros(SCATTERING))
    else:
        prior = partial(_prior, *_driver(about.mean), about.deviation[:SCATTERING])
    known = (platoons.depth > 0) & np.isfinite(truth).all(axis=1) & np.isfinite(leader_truth).all(axis=1)
    rows = np.flatnonzero(known)
    rows = rows[:: max(1, len(rows) // MOST_CASES)]
    if not len(rows) or (like is not None and len(rows) < LEAST_CASES):
        return prior(*((SCATTERS[0], INDEPENDENCES[0]) if like is None else (like.scatter, like.independence)))
    some = platoons.select(rows)
    best, found = np.inf, None
    for scatter in SCATTERS:
        tried = prior(scatter, 1.0)
        futures = behind_leader(tried.table, some, leader_truth[rows])
        likelihood = history_likelihood(tried, some)
        for independence in INDEPENDENCES:
            mean = np.einsum("pd,pds->ps", _normalised(independence * likelihood), futures)
            error = float(np.abs(mean - truth[rows]).mean())
            if error < best:
                best, found = error, prior(scatter, independence)
    assert found is not None
    return found


def driver_evidence(
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    leader_truth: Float[np.ndarray, "platoon step"],
    vehicle: Shaped[np.ndarray, "platoon"],
) -> Evidence:
    """Returns what training vehicles say of `PARAMETERS`: nothing of what none of them shows, or if they are few.

    The errors of a vehicle are alike at all moments and seconds, so they count as fewer than they are, by how much
    alike they are. Vehicles that met the same minutes are taken for independent, which says too much.

    Args:
        platoons, truth, leader_truth: see `fit_drivers`.
        vehicle: which each is.
    """
    fit, rows = _fit_centre(platoons, truth, leader_truth)
    if not len(rows):
        return Evidence(np.zeros((len(PARAMETERS),) * 2), np.zeros(len(PARAMETERS)))
    change = np.append(np.maximum(fit.x[:-1], LEAST_EXPONENT), 1.0)  # of the parameters with their logarithms
    square = 2.0 * fit.cost / max(len(fit.fun) - len(change), 1)
    slope = fit.jac * change
    precision = slope.T @ slope / (max(square, LEAST_SQUARE) * _alike(fit.fun, vehicle[rows]))
    own = np.append(np.log(change[:-1]), fit.x[-1])
    return Evidence(precision, precision @ own)


def _alike(error: Float[np.ndarray, "error"], vehicle: Shaped[np.ndarray, "error"]) -> float:
    """Returns how many errors say as much as one that no other is like: 1 if all are of themselves, at most all.

    The variance of the sum of a vehicle's errors over what it were if they were independent: the design effect of
    samples in clusters. Source: Moulton 1986, "Random group effects and the precision of regression estimates".
    """
    counted = error / np.sqrt(1.0 + (error / TYPICAL_ERROR) ** 2)  # as the fit counts them
    _, number = np.unique(vehicle, return_inverse=True)
    sums, squares = np.bincount(number, weights=counted), float((counted**2).sum())
    return float(max((sums**2).sum() / squares, 1.0)) if squares > 0.0 else 1.0


def assumed_centre() -> Float[np.ndarray, "param"]:
    """Returns what is assumed of `PARAMETERS` where no site tells: a driver of the literature."""
    return np.append(np.log(START), START_HABIT)


def posterior(prior: DriverPrior, platoons: Platoons) -> Float[np.ndarray, "platoon driver"]:
    """Returns the weight of each driver for each central vehicle, from its own history; sums to 1.

    Args:
        prior: see `fit_drivers`.
        platoons: at least one; behind no leader all weights are equal.
    """
    return _normalised(prior.independence * history_likelihood(prior, platoons))


def posteriors(
    prior: DriverPrior, situation: Situation, vehicles: Bool[np.ndarray, "vehicle"]
) -> Float[np.ndarray, "chosen driver"]:
    """Returns the weight of each driver for some vehicles; equal weights behind no leader.

    Args:
        prior: see `fit_drivers`.
        situation: of any number of moments.
        vehicles: which are wanted.
    """
    rows = np.flatnonzero(vehicles)
    leader = np.where(situation.leader[rows] == NOBODY, 0, situation.leader[rows])
    seen = situation.valid[rows] & situation.valid[leader] & (situation.leader[rows] != NOBODY)[:, None]
    found = _likelihood(
        prior,
        situation.x[rows],
        np.maximum(situation.v[rows], 0.0),
        situation.x[leader],
        situation.v[leader],
        seen,
        situation.length[leader],
    )
    return _normalised(prior.independence * found)


def history_likelihood(prior: DriverPrior, platoons: Platoons) -> Float[np.ndarray, "platoon driver"]:
    """Returns the logarithm of each history's likelihood under each driver, per independent error a second.

    Args:
        prior: whose drivers are meant.
        platoons: at least one.
    """
    return _likelihood(
        prior,
        platoons.x[:, 0],
        np.maximum(platoons.v[:, 0], 0.0),
        platoons.x[:, 1],
        platoons.v[:, 1],
        platoons.valid[:, 0] & platoons.valid[:, 1],
        known_lengths(platoons)[:, 1],
    )


def behind_leader(
    drivers: Float[np.ndarray, "driver param_and_habit"],
    platoons: Platoons,
    leader_truth: Float[np.ndarray, "platoon step"],
) -> Float[np.ndarray, "platoon driver step"]:
    """Returns the displacement [m] of each central vehicle under each driver behind its leader's given future.

    Args:
        drivers: see `DriverPrior.table`.
        platoons: each with a leader.
        leader_truth: front of the leader, counted from the central vehicle's place at t = 0 [m]; none is missing.
    """
    from rampcast.models.driver_loops import behind, free_table  # numba: only who drives waits for it

    leader_x, leader_v = true_leader(platoons, leader_truth)
    found, free = np.empty((len(platoons), len(drivers), FUTURE)), free_table(drivers)
    rows_of = (np.maximum(platoons.v[:, 0, -1], 0.0), known_lengths(platoons)[:, 1], leader_x, leader_v, found)
    shared_out(
        lambda rows: behind(drivers, free, *(values[rows] for values in rows_of)),
        len(platoons),
        least=DRIVEN // len(drivers),
    )
    return found


def _likelihood(
    prior: DriverPrior,
    x: Float[np.ndarray, "row past"],
    v: Float[np.ndarray, "row past"],
    leader_x: Float[np.ndarray, "row past"],
    leader_v: Float[np.ndarray, "row past"],
    seen: Bool[np.ndarray, "row past"],
    length: Float[np.ndarray, "row"],
) -> Float[np.ndarray, "row driver"]:
    from rampcast.models.driver_loops import likelihood  # numba, as above

    found = np.empty((len(x), len(prior.drivers)))

    def work(rows: slice) -> None:
        parts = (values[rows] for values in (x, v, leader_x, leader_v, seen, length))
        likelihood(prior.table, prior.free, *parts, (NEAR, GROWTH), found[rows])

    shared_out(work, len(x))
    return found


def with_habit(drivers: Float[np.ndarray, "driver param"], habit: float) -> Float[np.ndarray, "driver param_and_habit"]:
    """Returns drivers as the loops take them: the habit beside the parameters of the IDM."""
    return np.column_stack([drivers, np.full(len(drivers), habit)])


def _fit_centre(
    platoons: Platoons, truth: Float[np.ndarray, "platoon step"], leader_truth: Float[np.ndarray, "platoon step"]
) -> tuple[OptimizeResult, Int[np.ndarray, "error"]]:
    """Returns the fit of the driver and the habit that bring the training vehicles nearest to where they went.

    And of which of them each error is; of too few there is none, and the fit is where it starts.
    """
    seen = np.isfinite(truth) & np.logical_and.accumulate(np.isfinite(leader_truth), axis=1)
    rows = np.flatnonzero((platoons.depth > 0) & seen.any(axis=1))
    if len(rows) < LEAST_CASES:
        return OptimizeResult(x=np.array([*START, 0.0])), rows[:0]
    rows = rows[:: -(-len(rows) // MOST_CASES)]
    some, ahead, at = platoons.select(rows), leader_truth[rows], seen[rows][:, WHOLE_SECONDS]
    wanted = truth[rows][:, WHOLE_SECONDS][at]
    low, high = np.array([*((bound.low, bound.high) for bound in idm.NET_BOUNDS), HABITS]).T
    fit = least_squares(
        lambda driver: behind_leader(driver[None], some, ahead)[:, 0][:, WHOLE_SECONDS][at] - wanted,
        np.array([*START, START_HABIT]),
        bounds=(low, high),
        x_scale=high - low,
        loss="soft_l1",
        f_scale=TYPICAL_ERROR,
        max_nfev=30,
    )
    return fit, rows[np.nonzero(at)[0]]


def _driver(parameters: Float[np.ndarray, "param_and_habit"]) -> tuple[Float[np.ndarray, "param"], float]:
    """Returns the driver and the habit of `PARAMETERS`, within the limits that fits have."""
    low, high = np.array([*((bound.low, bound.high) for bound in idm.NET_BOUNDS), HABITS]).T
    driver = np.clip(np.append(np.exp(parameters[:-1]), parameters[-1]), low, high)
    return driver[:-1], float(driver[-1])


def _prior(
    centre: Float[np.ndarray, "param"],
    habit: float,
    unknown: Float[np.ndarray, "scattering"],
    scatter: float,
    independence: float,
) -> DriverPrior:
    points = qmc.Sobol(SCATTERING, seed=1).random(DRIVERS)
    offsets = np.hypot(scatter, unknown) * norm.ppf(np.clip(points, RAREST, 1 - RAREST))
    scattered = centre[:SCATTERING] * np.exp(offsets - offsets.mean(axis=0))
    drivers = np.column_stack([scattered, np.full(DRIVERS, centre[SCATTERING])])
    return DriverPrior(centre, habit, scatter, independence, drivers)


def _normalised(log_weight: Float[np.ndarray, "platoon driver"]) -> Float[np.ndarray, "platoon driver"]:
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return weight / weight.sum(axis=1, keepdims=True)
