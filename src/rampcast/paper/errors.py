"""Errors of position forecasts, second by second, as a tidy table."""

from collections.abc import Mapping

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.evaluate.positions import position_errors
from rampcast.paper.neighbours.predict import NeighbourForecast
from rampcast.paper.scenes.scenes import CENTRAL, FOLLOWER, LEADER, TARGET_SLOTS, Scenes
from rampcast.traffic.anchors import X


def central_errors(scenes: Scenes, forecasts: Mapping[str, Float[np.ndarray, "scene future"]]) -> pl.DataFrame:
    """Returns `position_errors` of each model's forecast of the central vehicle, with the columns group and model."""
    observed, valid = scenes.future[:, CENTRAL, :, X], scenes.future_valid[:, CENTRAL]
    tables = [_labelled(position_errors(x, observed, valid), "central", name) for name, x in forecasts.items()]
    return pl.concat(tables)


def neighbour_errors(scenes: Scenes, predicted: NeighbourForecast, *, model: str = "lstm") -> pl.DataFrame:
    """Returns `position_errors` of predicted neighbours, on the ramp and in the target lane, under a model's name."""
    tables = []
    for group, slots in (("ramp_neighbour", [LEADER, FOLLOWER]), ("target_neighbour", list(TARGET_SLOTS))):
        steps = scenes.future.shape[2]
        x = predicted.x[:, slots, 1:].reshape(-1, steps)
        observed = scenes.future[..., X][:, slots].reshape(-1, steps)
        valid = scenes.future_valid[:, slots].reshape(-1, steps)
        tables.append(_labelled(position_errors(x, observed, valid), group, model))
    return pl.concat(tables)


def _labelled(table: pl.DataFrame, group: str, model: str) -> pl.DataFrame:
    return table.select(pl.lit(group).alias("group"), pl.lit(model).alias("model"), pl.all())
