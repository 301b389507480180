"""Boosted regression trees as plain arrays, and their prediction without scikit-learn.

Each tree keeps the places that it has in scikit-learn; a leaf points to itself on both sides, so trees of different
depth are walked together. A missing value (NaN) goes to the side that training has chosen for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

TOGETHER = 1 << 17  # tree walks at a time: their arrays stay in a processor's cache


@dataclass(frozen=True)
class BoostedTrees:
    """Trees whose leaves add up to a prediction.

    Attributes:
        baseline: the prediction without any tree.
        columns: of the tables that it was trained on.
        feature: column that a node compares; 0 at a leaf.
        threshold: greatest value that goes left; infinite at a leaf.
        missing_left: whether a missing value goes left.
        left, right: children; the node itself at a leaf.
        value: what a leaf adds.
        root: first node of each tree.
        depth: levels below the deepest root.
    """

    baseline: float
    columns: int
    feature: Int[np.ndarray, "node"]
    threshold: Float[np.ndarray, "node"]
    missing_left: Bool[np.ndarray, "node"]
    left: Int[np.ndarray, "node"]
    right: Int[np.ndarray, "node"]
    value: Float[np.ndarray, "node"]
    root: Int[np.ndarray, "tree"]
    depth: int

    def predict(self, table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row"]:
        """Returns the predictions of rows; the same as scikit-learn's but for the order of the sum."""
        if table.shape[1] != self.columns:
            raise ValueError(f"expected {self.columns} columns, got {table.shape[1]}")
        together = max(1, TOGETHER // max(len(self.root), 1))
        parts = [self._predict(table[first : first + together]) for first in range(0, len(table), together)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _predict(self, table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row"]:
        values = np.ascontiguousarray(table, dtype=np.float64).ravel()
        start = (np.arange(len(table)) * self.columns)[:, None]
        node = np.broadcast_to(self.root, (len(table), len(self.root)))
        for _ in range(self.depth):
            x = values[start + self.feature[node]]
            goes_left = np.where(np.isnan(x), self.missing_left[node], x <= self.threshold[node])
            node = np.where(goes_left, self.left[node], self.right[node])
        return self.baseline + self.value[node].sum(axis=1)


def boosted_trees(model: Any) -> BoostedTrees:
    """Returns a fitted `HistGradientBoostingRegressor` as arrays.

    Args:
        model: with an identity link and without categories, as those for absolute and squared errors are.
    """
    # the nodes are not in scikit-learn's public interface; a test compares predictions, so a change of theirs shows
    trees: list[np.ndarray] = [predictor.nodes for (predictor,) in model._predictors]
    begin = np.cumsum([0, *(len(nodes) for nodes in trees)])
    nodes = np.concatenate(trees)
    first = np.repeat(begin[:-1], np.diff(begin))
    leaf, here = nodes["is_leaf"].astype(bool), np.arange(len(nodes))
    return BoostedTrees(
        baseline=float(np.asarray(model._baseline_prediction).item()),
        columns=int(model.n_features_in_),
        feature=np.where(leaf, 0, nodes["feature_idx"]).astype(np.int32),
        threshold=np.where(leaf, np.inf, nodes["num_threshold"]),
        missing_left=nodes["missing_go_to_left"].astype(bool),
        left=np.where(leaf, here, first + nodes["left"]).astype(np.int32),
        right=np.where(leaf, here, first + nodes["right"]).astype(np.int32),
        value=np.where(leaf, nodes["value"], 0.0),
        root=begin[:-1].astype(np.int32),
        depth=_depth(trees),
    )


def _depth(trees: Sequence[np.ndarray]) -> int:
    return max((int(nodes["depth"].max()) for nodes in trees), default=0)
