"""What the compiled loops of the joint roll-out take: arrays, and nothing else."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rampcast.traffic.situation import NOBODY

__all__ = ["NOBODY", "Draws", "Law", "Start"]


class Start(NamedTuple):
    """What is known at t0, a row for each vehicle of each moment, and of each lane of each moment.

    Attributes:
        first: of the vehicles of each moment, and their number at the end.
        order: vehicles of each moment from upstream to downstream, counted within it.
        x, v, residual, around: front [m], speed [m/s], residual acceleration [m/s^2], and mean speed about [m/s].
        length: [m].
        gap: net, to the leader at t0 [m]; infinite behind nobody.
        lane: index of the lane, within the moment.
        offset, approach, ready: see `models.merging.merge_features`.
        draw: row of the random numbers.
        end, begin: where each lane ends, and from where on vehicles may leave it for its target [m].
        target, source: lane that a lane merges into, and lane that merges into it; `NOBODY` for none.
        left, right: lanes beside it that vehicles may change to; likewise.
    """

    first: Int[np.ndarray, "moments_and_one"]
    order: Int[np.ndarray, "vehicle"]
    x: Float[np.ndarray, "vehicle"]
    v: Float[np.ndarray, "vehicle"]
    residual: Float[np.ndarray, "vehicle"]
    around: Float[np.ndarray, "vehicle"]
    length: Float[np.ndarray, "vehicle"]
    gap: Float[np.ndarray, "vehicle"]
    lane: Int[np.ndarray, "vehicle"]
    offset: Float[np.ndarray, "vehicle"]
    approach: Float[np.ndarray, "vehicle"]
    ready: Float[np.ndarray, "vehicle"]
    draw: Int[np.ndarray, "vehicle"]
    end: Float[np.ndarray, "moment lane"]
    begin: Float[np.ndarray, "moment lane"]
    target: Int[np.ndarray, "moment lane"]
    source: Int[np.ndarray, "moment lane"]
    left: Int[np.ndarray, "moment lane"]
    right: Int[np.ndarray, "moment lane"]


class Law(NamedTuple):
    """What is learned, as numbers.

    Attributes:
        drivers: parameters of the IDM, and the habit.
        free: their accelerations behind nobody; see `driver_loops.free_table`.
        numbers: persistence and kick of the residual; 1/relaxation [1/s], noise a step and share of the free
            acceleration of heads; weight of the putative leader, courtesy; rate of lane changes [1/s]; highest speed.
        hazard: weights, constant, first and last distance to the end of the lane; see `models.merging.MergeHazard`.
    """

    drivers: Float[np.ndarray, "driver param_and_habit"]
    free: Float[np.ndarray, "driver speed"]
    numbers: Float[np.ndarray, "number"]
    hazard: Float[np.ndarray, "weight"]


class Draws(NamedTuple):
    """Random numbers, a row for each vehicle; see `Start.draw`. The pace is the same for all vehicles of a sample.

    Attributes:
        noise, threshold, change: of what drivers do beside their law, of merges, and of changes between main lanes.
        pace: by what all hazards of the site are multiplied.
    """

    noise: Float[np.ndarray, "row sample step"]
    threshold: Float[np.ndarray, "row sample"]
    change: Float[np.ndarray, "row sample"]
    pace: Float[np.ndarray, "sample"]
