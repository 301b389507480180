"""How likely vehicles like this one merge by each moment: a forest of what is seen at t = 0, joined to the roll-outs.

Roll-outs know the traffic and geometry, but their hazard is a simple law. A forest knows what became of vehicles in a
like situation, but not what is new in this one. The curve of each moment is a mean of the two; how far the forest
counts is what forecasts training vehicles best that it was not trained on. All moments share the trees, so the curves
never fall.

A vehicle that left the recording before counts after that moment with what the roll-outs say of it.

Source: Ishwaran et al. 2008 for forests of survival curves; Breiman 2001.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped
from sklearn.ensemble import RandomForestRegressor

from rampcast.horizon import FUTURE, STEP
from rampcast.models.folds import Fold
from rampcast.models.trees import Trees, decision_tree, joined, softness
from rampcast.threads import thread_count

# steps of 0.2 s at which the curves are known: every 0.4 s for 4 s, then every second
MOMENTS = np.concatenate([np.arange(0, 20, 2), np.arange(24, FUTURE, 5)])
TREES, TREES_OF_A_FOLD = 100, 40
LEAST_IN_LEAF = 5
COLUMNS_TRIED = 0.4  # of all, at each split: they are much alike
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the forest in the mean, that are tried
LEAST_ROWS = 100  # of fewer nothing is learned
MOST_ROWS = 2000  # to choose the shares; more choose the same
MISSING = -1000.0  # in place of what is not known: below all that is
SURE = 1e-3  # no probability is nearer to 1 when curves are compared
NOISE = 2e-4  # hazard between two moments below which neither curve says anything
SLOWEST, FASTEST = 0.05, 20.0  # limits of the rate: a hazard of the roll-outs is no farther off


@dataclass(frozen=True)
class MergeForest:
    """A fitted forest, as arrays.

    Attributes:
        trees: their outputs are the probability to have merged by `MOMENTS`; None if nothing was learned.
        share: how far the forest counts at each of the moments.
    """

    trees: Trees | None
    share: Float[np.ndarray, "moment"]

    def curves(
        self, table: Float[np.ndarray, "row column"], rolled: Float[np.ndarray, "row step"]
    ) -> Float[np.ndarray, "row step"]:
        """Returns the probability to have merged by 0.2, 0.4 ... 15 s; it never falls.

        Args:
            table: what is seen at t = 0; NaN where not known.
            rolled: the same probability, of the roll-outs.
        """
        if self.trees is None:
            return rolled
        at_moments = _predict(self.trees, table)
        mean = self.share * at_moments + (1.0 - self.share) * rolled[:, MOMENTS]
        return _over_time(np.maximum.accumulate(mean, axis=1), rolled)


def fit_merge_forest(
    table: Float[np.ndarray, "row column"],
    rolled: Float[np.ndarray, "row step"],
    *,
    change_time: Float[np.ndarray, "row"],
    seen_for: Float[np.ndarray, "row"],
    group: Shaped[np.ndarray, "row"],
    folds: Sequence[Fold],
    seed: int = 1,
) -> MergeForest:
    """Returns the forest that the training vehicles teach.

    Args:
        table: what is seen of each at t = 0; NaN where not known.
        rolled: probability to have merged by 0.2, 0.4 ... 15 s, of the roll-outs.
        change_time: time to the lane change [s]; NaN where none was seen.
        seen_for: time for which each was seen [s].
        group: name of the vehicle of each: vehicles count alike by the root of their number of rows.
        folds: to choose how far the forest counts; together they test every row.
        seed: of the trees.
    """
    if len(table) < LEAST_ROWS or not np.isfinite(change_time).any():
        return MergeForest(None, np.zeros(len(MOMENTS)))
    merged = _merged_by(rolled, change_time, seen_for)
    _, number = np.unique(group, return_inverse=True)
    weight = 1.0 / np.sqrt(np.bincount(number)[number])
    unseen = _out_of_fold(table, merged, weight, folds, seed)
    errors = [
        np.nansum(weight[:, None] * (part * unseen + (1.0 - part) * rolled[:, MOMENTS] - merged) ** 2, axis=0)
        for part in SHARES
    ]
    best = np.array(SHARES)[np.argmin(errors, axis=0)]
    forest = _forest(TREES, seed).fit(_filled(table), merged, sample_weight=weight)
    return MergeForest(_as_arrays(forest, softness(table)), best)


def rate_of(
    wanted: Float[np.ndarray, "row step"], rolled: Float[np.ndarray, "row step"]
) -> Float[np.ndarray, "row step"]:
    """Returns by what the hazard of roll-outs is to be multiplied in each step, for the curve wanted.

    Args:
        wanted: probability to have merged by each step.
        rolled: the same of the roll-outs.
    """
    hazards = []
    for curve in (wanted, rolled):
        gathered = -np.log(1.0 - np.clip(curve[:, MOMENTS], 0.0, 1.0 - SURE))
        hazards.append(np.diff(gathered, axis=1, prepend=0.0) + NOISE)
    rate = np.clip(hazards[0] / hazards[1], SLOWEST, FASTEST)
    return rate[:, np.searchsorted(MOMENTS, np.arange(FUTURE))]


def _merged_by(
    rolled: Float[np.ndarray, "row step"], change_time: Float[np.ndarray, "row"], seen_for: Float[np.ndarray, "row"]
) -> Float[np.ndarray, "row moment"]:
    """Returns whether each vehicle had merged by the moments; after it was seen last, how likely it had."""
    time = (MOMENTS + 1) * STEP + STEP / 100.0
    known = np.isfinite(change_time)[:, None] | (seen_for[:, None] >= time - STEP)
    merged = np.where(np.isfinite(change_time)[:, None], change_time[:, None] <= time, False)
    last = np.clip((seen_for / STEP + 1e-6).astype(np.int64) - 1, 0, FUTURE - 1)
    by_then = np.take_along_axis(rolled, last[:, None], axis=1)
    later = np.clip((rolled[:, MOMENTS] - by_then) / np.maximum(1.0 - by_then, SURE), 0.0, 1.0)
    return np.where(known, merged, later)


def _over_time(
    at_moments: Float[np.ndarray, "row moment"], rolled: Float[np.ndarray, "row step"]
) -> Float[np.ndarray, "row step"]:
    """Returns curves at every step: between moments they are straight."""
    place, value = np.concatenate([[-1], MOMENTS]), np.column_stack([np.zeros(len(at_moments)), at_moments])
    step = np.arange(rolled.shape[1])
    right = np.clip(np.searchsorted(place, step, side="left"), 1, len(place) - 1)
    share = np.clip((step - place[right - 1]) / (place[right] - place[right - 1]), 0.0, 1.0)
    return value[:, right - 1] * (1.0 - share) + value[:, right] * share


def _filled(table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
    return np.where(np.isfinite(table), table, MISSING).astype(np.float32)


def _forest(trees: int, seed: int) -> Any:
    return RandomForestRegressor(
        trees,
        min_samples_leaf=LEAST_IN_LEAF,
        max_features=COLUMNS_TRIED,
        random_state=seed,
        n_jobs=thread_count(),
    )


def _out_of_fold(
    table: Float[np.ndarray, "row column"],
    merged: Float[np.ndarray, "row moment"],
    weight: Float[np.ndarray, "row"],
    folds: Sequence[Fold],
    seed: int,
) -> Float[np.ndarray, "row moment"]:
    """Returns what forests that have not seen a row give for it; NaN where too few are left to train on."""
    found = np.full(merged.shape, np.nan)
    for train, test in folds:
        rows = train[:: max(1, len(train) // MOST_ROWS)]
        if len(rows) >= LEAST_ROWS // 2 and len(test):
            forest = _forest(TREES_OF_A_FOLD, seed).fit(_filled(table[rows]), merged[rows], sample_weight=weight[rows])
            found[test] = _predict(_as_arrays(forest, softness(table[rows])), table[test])
    return found


def _as_arrays(forest: Any, width: Float[np.ndarray, "column"]) -> Trees:
    """Returns a fitted forest as arrays, with soft splits; the curves of its nodes never fall."""
    grown = [tree.tree_ for tree in forest.estimators_]
    curves = [np.maximum.accumulate(tree.value[:, :, 0], axis=1).astype(np.float32) for tree in grown]
    trees = [decision_tree(tree, value) for tree, value in zip(grown, curves, strict=True)]
    return joined(trees, columns=forest.n_features_in_, width=width)


def _predict(trees: Trees, table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row moment"]:
    return trees.sums(_filled(table)) / len(trees.root)
