"""Where the vehicles of a scene will be: predicted by the neighbour models, or taken on at constant speed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rampcast.horizon import PAST, STEP
from rampcast.paper.neighbours.lstm import NeighbourLstm
from rampcast.paper.scenes.scenes import TARGET_SLOTS, Scenes
from rampcast.traffic.anchors import V, X


@dataclass(frozen=True)
class NeighbourForecast:
    """Positions and speeds of every slot from t = 0 on; the step axis begins with the state at t = 0.

    Attributes:
        x: front position [m].
        v: speed [m/s].
    """

    x: Float[np.ndarray, "scene slot step"]
    v: Float[np.ndarray, "scene slot step"]


def predict_neighbours(scenes: Scenes, *, ramp: NeighbourLstm, target: NeighbourLstm, steps: int) -> NeighbourForecast:
    """Returns what the two neighbour models predict for every vehicle; virtual vehicles stand still.

    A vehicle is predicted once for each anchor time and shared by all scenes in which it appears. The central vehicle's
    own row is the baseline "LSTM alone".

    Args:
        scenes: their futures are not read.
        ramp: predicts the central vehicle, its leader and its follower.
        target: predicts the four vehicles in the target lane.
        steps: how many steps of 0.2 s to predict.
    """
    x = np.repeat(scenes.past[:, :, PAST - 1 : PAST, X], steps + 1, axis=2)
    of_target = np.zeros(scenes.virtual.shape, dtype=bool)
    of_target[:, TARGET_SLOTS] = True
    for model, mine in ((ramp, ~of_target), (target, of_target)):
        rows = np.flatnonzero(mine & ~scenes.virtual)
        first, share = _once_each(scenes, rows)
        predicted = model.predict(scenes.past[..., X].reshape(-1, PAST)[first], steps=steps)
        x.reshape(-1, steps + 1)[rows, 1:] = predicted[share]
    return _with_speeds(scenes, x)


def continue_at_constant_speed(scenes: Scenes, *, steps: int) -> NeighbourForecast:
    """Returns every vehicle taken on at the speed that it has at t = 0, for so many steps of 0.2 s."""
    now = scenes.past[:, :, -1]
    time = np.arange(steps + 1) * STEP
    return NeighbourForecast(
        x=now[..., X, None] + now[..., V, None] * time,
        v=np.repeat(now[..., V, None], steps + 1, axis=2),
    )


def _once_each(scenes: Scenes, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns one flat (scene, slot) row for each (recording, vehicle, t0), and which of them serves each of `rows`."""
    scene, slot = np.divmod(rows, scenes.virtual.shape[1])
    key = np.rec.fromarrays([scenes.recording[scene].astype(str), scenes.vehicle[scene, slot], scenes.t0[scene]])
    _, first, share = np.unique(key, return_index=True, return_inverse=True)
    return rows[first], share


def _with_speeds(scenes: Scenes, x: Float[np.ndarray, "scene slot step"]) -> NeighbourForecast:
    """Returns positions with speeds by second-order differences; at t = 0 the observed speed."""
    v = np.gradient(x, STEP, axis=2, edge_order=2)
    v[:, :, 0] = scenes.past[:, :, -1, V]
    return NeighbourForecast(x=x, v=v)
