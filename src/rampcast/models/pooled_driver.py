"""One IDM for all drivers: a platoon driven along as a chain, and the fit of its parameters to positions."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from rampcast.horizon import FUTURE, STEP, WHOLE_SECONDS
from rampcast.physics import idm
from rampcast.traffic.platoons import Platoons, known_lengths

START = (2.0, 1.2, 1.0, 2.0, 20.0, 4.0)  # about the values of Treiber, Hennecke and Helbing 2000
LEAST_CASES = 20  # a fit to fewer says more of them than of drivers: `START` is taken then
MOST_CASES = 1500  # six parameters need no more, and the time of a fit grows with them
TYPICAL_ERROR = 1.0  # [m]; beyond it a residual counts by its size, not by its square


def roll_chain(
    parameters: Float[np.ndarray, "param"], platoons: Platoons, *, leaders: int
) -> Float[np.ndarray, "platoon step"]:
    """Returns the displacement [m] of each central vehicle after each of 75 steps of 0.2 s.

    Each vehicle follows the one ahead by the IDM, with the steps of the paper's algorithm 1; the last that
    counts keeps its speed, as a vehicle without a leader does.

    Args:
        parameters: the IDM's, the same for all.
        platoons: at least one.
        leaders: how many of the vehicles ahead count.
    """
    return _chain(parameters, _states_now(platoons, leaders))


def fit_pooled_driver(
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    *,
    leader_truth: Float[np.ndarray, "platoon step"] | None = None,
    leaders: int = 1,
) -> Float[np.ndarray, "param"]:
    """Returns the parameters that bring all central vehicles nearest to where they really went.

    Args:
        platoons: of the training cases.
        truth: their displacements [m]; NaN where not seen.
        leader_truth: makes them follow their leaders' true futures, counted from the same places [m].
        leaders: how many vehicles ahead count where no true futures are given.
    """
    seen = np.isfinite(truth)
    if leader_truth is not None:
        seen &= np.logical_and.accumulate(np.isfinite(leader_truth), axis=1)
    rows = np.flatnonzero((platoons.depth > 0) & seen.any(axis=1))
    if len(rows) < LEAST_CASES:
        return np.array(START)
    rows = rows[:: -(-len(rows) // MOST_CASES)]
    states = _states_now(platoons.select(rows), leaders)
    if leader_truth is None:
        return _least_squares(lambda driver: _chain(driver, states), truth[rows], seen[rows])
    ahead = true_leader(platoons.select(rows), leader_truth[rows])
    v, length = states[1][:, 0], states[2][:, 1]
    return _least_squares(lambda driver: _behind(driver, v, length, *ahead), truth[rows], seen[rows])


def true_leader(
    platoons: Platoons, leader_truth: Float[np.ndarray, "platoon step"]
) -> tuple[Float[np.ndarray, "platoon step"], Float[np.ndarray, "platoon step"]]:
    """Returns positions [m] and speeds [m/s] of the leaders at t = 0, 0.2 ... 14.8 s, the true ones after t = 0.

    Positions are counted from the central vehicle's at t = 0. Beyond what was seen, the last speed is kept.
    """
    now = platoons.x[:, 1, -1] - platoons.x[:, 0, -1]
    x = np.column_stack([now, leader_truth])
    v = np.diff(x, axis=1) / STEP
    last = np.maximum.accumulate(np.where(np.isfinite(v), np.arange(v.shape[1]), 0), axis=1)
    v = np.take_along_axis(v, last, axis=1)
    v = np.where(np.isfinite(v), v, platoons.v[:, 1, -1, None])
    v = np.column_stack([platoons.v[:, 1, -1], v])[:, :FUTURE]
    x = now[:, None] + np.column_stack([np.zeros(len(x)), np.cumsum(v[:, 1:] * STEP, axis=1)])
    return x, np.maximum(v, 0.0)


def _states_now(platoons: Platoons, leaders: int) -> tuple[np.ndarray, ...]:
    """Returns x, v, length and presence at t = 0 of the vehicles that count, x from the central vehicle's place."""
    some = slice(0, leaders + 1)
    present = platoons.present[:, some]
    x = np.where(present, platoons.x[:, some, -1] - platoons.x[:, :1, -1], 0.0)
    v = np.where(present, np.maximum(platoons.v[:, some, -1], 0.0), 0.0)
    return x, v, known_lengths(platoons)[:, some], present


def follow_true_leader(
    parameters: Float[np.ndarray, "param"], platoons: Platoons, leader_truth: Float[np.ndarray, "platoon step"]
) -> Float[np.ndarray, "platoon step"]:
    """Returns the displacement [m] of each central vehicle behind its leader's true future; NaN once that is not known.

    Args:
        parameters: the IDM's, the same for all.
        platoons: at least one.
        leader_truth: front of the leader, counted from the central vehicle's place at t = 0 [m]; NaN where not seen.
    """
    leader_x, leader_v = true_leader(platoons, leader_truth)
    _, v, length, present = _states_now(platoons, 1)
    whole = present[:, 1]
    leader_x, leader_v = np.where(whole[:, None], leader_x, 0.0), np.where(whole[:, None], leader_v, 0.0)
    displacement = _behind(parameters, v[:, 0], length[:, 1], leader_x, leader_v)
    known = whole[:, None] & np.logical_and.accumulate(np.isfinite(leader_truth), axis=1)
    return np.where(known, displacement, np.nan)


def _chain(driver: Float[np.ndarray, "param"], states: tuple[np.ndarray, ...]) -> Float[np.ndarray, "platoon step"]:
    from rampcast.models.driver_loops import chain  # numba: only who drives waits for it

    found = np.empty((len(states[0]), FUTURE))
    chain(driver, *states, found)
    return found


def _behind(
    driver: Float[np.ndarray, "param"],
    v: Float[np.ndarray, "platoon"],
    length: Float[np.ndarray, "platoon"],
    leader_x: Float[np.ndarray, "platoon step"],
    leader_v: Float[np.ndarray, "platoon step"],
) -> Float[np.ndarray, "platoon step"]:
    from rampcast.models.driver_loops import behind, free_table  # numba, as above

    found = np.empty((len(v), 1, FUTURE))
    drivers = np.append(driver, 0.0)[None]
    behind(drivers, free_table(drivers), v, length, leader_x, leader_v, found)
    return found[:, 0]


def _least_squares(
    displacements: Callable[[Float[np.ndarray, "param"]], Float[np.ndarray, "platoon step"]],
    truth: Float[np.ndarray, "platoon step"],
    seen: Bool[np.ndarray, "platoon step"],
) -> Float[np.ndarray, "param"]:
    # at whole seconds, as the scores are
    seen, truth = seen[:, WHOLE_SECONDS], np.where(seen, truth, 0.0)[:, WHOLE_SECONDS]
    low, high = np.array([(bound.low, bound.high) for bound in idm.NET_BOUNDS]).T
    fit = least_squares(
        lambda driver: (displacements(driver)[:, WHOLE_SECONDS] - truth)[seen],
        np.array(START),
        bounds=(low, high),
        x_scale=high - low,
        loss="soft_l1",
        f_scale=TYPICAL_ERROR,
        max_nfev=40,
    )
    return np.asarray(fit.x)
