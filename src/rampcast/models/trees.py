"""Trees that scikit-learn has grown, as plain arrays, and their prediction without scikit-learn.

The nodes of all trees lie in one row, each tree in breadth-first order, so that the right child follows the left one:
one level down is `left[node]`, plus one to the right. A leaf points to itself and sends nothing to the right, so trees
of different depth are walked together.

Trees may be soft: a value near a threshold goes both ways, with weights that change steadily across it, so that a
measurement's last digit does not throw a forecast into another leaf. Source: Jordan and Jacobs 1994 for soft splits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Final, NamedTuple

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int, Int32

from rampcast.compute import blocks, computing, jax, jnp, padded, program
from rampcast.errors import ModelError
from rampcast.models.plain_data import MAY_BE_MISSING
from rampcast.threads import shared_out

DEEPEST: Final = 1000  # levels; those that are grown have 50 at most
LEAST_SHARE: Final = 1000  # rows of a thread
SOFT: Final = 0.25  # standard deviations of a column to either side of a threshold over which a soft split turns
# Scenes are padded to one of these numbers, so that a new number does not compile again; beside it the number of trees
# that are walked together. Measured: few scenes need many trees to be worth an array operation, many scenes need few,
# for their nodes to stay in the cache.
TREES_TOGETHER: Final = {1: 400, 16: 400, 256: 100, 2048: 32}


class Tree(NamedTuple):
    """One tree as it was grown.

    Attributes:
        left, right: children; negative at a leaf.
        feature: column that a node compares; anything at a leaf.
        threshold: greatest value that goes left, of the kind of number that the columns are read as.
        missing_left: whether a missing value goes left.
        value: what a node predicts.
    """

    left: Int[np.ndarray, "node"]
    right: Int[np.ndarray, "node"]
    feature: Int[np.ndarray, "node"]
    threshold: Float[np.ndarray, "node"]
    missing_left: Bool[np.ndarray, "node"]
    value: Float[np.ndarray, "node output"]


@dataclass(frozen=True)
class Trees:
    """Trees over the same columns.

    Attributes:
        columns: of the tables that they were trained on.
        feature: column that a node compares; 0 at a leaf.
        threshold: greatest value that goes left; infinite at a leaf.
        missing_left: whether a missing value (NaN) goes left; True at a leaf.
        left: left child, the right child being the next node; the node itself at a leaf.
        value: what a node predicts.
        root: first node of each tree.
        width: to either side of a threshold within which a value of each column goes both ways; None for nowhere.
    """

    columns: int
    feature: Int32[np.ndarray, "node"]
    threshold: Float[np.ndarray, "node"] = field(metadata=MAY_BE_MISSING)
    missing_left: Bool[np.ndarray, "node"]
    left: Int32[np.ndarray, "node"]
    value: Float[np.ndarray, "node output"]
    root: Int32[np.ndarray, "tree"]
    width: Float[np.ndarray, "column"] | None = None

    def __post_init__(self) -> None:
        """Checks that these are trees, whose walks stay inside the arrays and end soon.

        Raises:
            ModelError: they are not.
        """
        nodes = np.arange(len(self.left))
        leaf = self.left == nodes
        inside = np.all(leaf | ((self.left > nodes) & (self.left < len(nodes) - 1)))
        inside &= np.all(~leaf | (np.isposinf(self.threshold) & self.missing_left))
        inside &= np.all((self.feature >= 0) & (self.feature < self.columns))
        inside &= np.all((self.root >= 0) & (self.root < len(nodes)))
        if not inside:
            raise ModelError("trees: a node points outside the arrays")
        inner = np.flatnonzero(~leaf)
        parents = np.bincount(np.concatenate([self.left[inner], self.left[inner] + 1, self.root]), minlength=len(nodes))
        if np.any(parents != 1):
            raise ModelError("trees: a node is below two others, or below none")
        if np.any(np.isnan(self.threshold)) or np.any(np.isneginf(self.threshold)):
            raise ModelError("trees: a threshold is no number")
        if self.width is not None and not np.all((self.width >= 0.0) & np.isfinite(self.width)):
            raise ModelError("trees: the width of a soft split is no length")
        if np.max(self.depths, initial=0) > DEEPEST:
            raise ModelError(f"trees: one is more than {DEEPEST} levels deep")

    @cached_property
    def depths(self) -> Int[np.ndarray, "tree"]:
        """Returns the number of levels below the root of each tree."""
        node, tree = self.root, np.arange(len(self.root))
        depth, level = np.zeros(len(node), np.int32), 0
        while True:
            inner = self.left[node] != node
            node, tree = self.left[node[inner]], tree[inner]
            if not len(node):
                return depth
            level += 1
            if level > DEEPEST:
                return depth + level
            depth[tree] = level
            node, tree = np.concatenate([node, node + 1]), np.concatenate([tree, tree])

    def sums(self, table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row output"]:
        """Returns the sum over all trees of what they predict for each row."""
        if table.shape[1] != self.columns:
            raise ValueError(f"expected {self.columns} columns, got {table.shape[1]}")
        from rampcast.models.tree_loops import sums  # numba: only who predicts waits for it

        found = np.zeros((len(table), self.value.shape[1]))
        values = np.ascontiguousarray(table, dtype=self.threshold.dtype)
        shared_out(lambda rows: sums(values[rows], *self._walked, found[rows]), len(table), least=LEAST_SHARE)
        return found

    @cached_property
    def _walked(self) -> tuple[Any, ...]:
        """Returns what `tree_loops.sums` takes, after the table."""
        width = np.zeros(self.columns) if self.width is None else self.width
        nodes = (self.feature, self.threshold, self.missing_left, self.left, self.root, self.value, width)
        return *nodes, int(np.max(self.depths, initial=0)) + 1


@dataclass(frozen=True)
class BoostedTrees:
    """Trees whose leaves add up to a prediction.

    Attributes:
        baseline: the prediction without any tree.
        trees: each with one output.
    """

    baseline: float
    trees: Trees

    def predict(self, table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row"]:
        """Returns the predictions of rows; of hard trees the same as scikit-learn's but for the order of the sum."""
        return self.baseline + self.trees.sums(table)[:, 0]


class Schedule(NamedTuple):
    """The order in which trees are walked: blocks of trees of about equal depth."""

    root: Int[Array, "block tree"]
    forest: Int[Array, "block tree"]
    depth: Int[Array, "block"]


class Nodes(NamedTuple):
    """The nodes of all trees, with one empty leaf at the end that pads the last block."""

    feature: Int[Array, "node"]
    threshold: Float[Array, "node"]
    left: Int[Array, "node"]
    share: Float[Array, "node"]


@dataclass(frozen=True)
class Forests:
    """Binary forests of equally many trees, which one compiled function evaluates all at once.

    Attributes:
        trees: those of the first forest, of the second, and so on; their output is the share of positive samples.
        each: trees in each forest.
    """

    trees: Trees
    each: int

    @cached_property
    @computing()
    def _on_device(self) -> tuple[Nodes, dict[int, Schedule]]:
        """Returns the arrays that the compiled function takes: the nodes, and a schedule for each padded size."""
        schedules = {size: _schedule(self, together) for size, together in TREES_TOGETHER.items()}
        return _nodes(self.trees), schedules

    def __len__(self) -> int:
        return len(self.trees.root) // self.each

    def positive_share(self, features: Float[np.ndarray, "scene column"]) -> Float[np.ndarray, "scene forest"]:
        """Returns the probability of "positive" by each forest: the mean over its trees.

        Equal to scikit-learn's `predict_proba(...)[:, 1]`, which also reads features as float32.
        """
        # double precision sums, so that the answer does not depend on the order of the trees
        features = features.astype(np.float32)
        shares = np.empty((len(features), len(self)))
        nodes, schedules = self._on_device
        for block in blocks(len(features), sizes=tuple(TREES_TOGETHER)):
            sums = np.asarray(_sum_over_trees(padded(features, block), nodes, schedules[block.size], len(self)))
            shares[block.start : block.stop] = sums[: len(self), : block.stop - block.start].T / self.each
        return shares


def softness(table: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "column"]:
    """Returns the widths of soft splits in a table's columns; NaN, which is missing, does not count.

    Tails do not count either: a standard deviation is a quarter of what the middle 95 % span.
    """
    known = np.where(np.isfinite(table).any(axis=0), table, 0.0)
    low, high = np.nanquantile(known, (0.025, 0.975), axis=0)
    return SOFT * (high - low) / 4.0


def joined(trees: Sequence[Tree], *, columns: int, width: Float[np.ndarray, "column"] | None = None) -> Trees:
    """Returns at least one tree, or more, as arrays.

    Args:
        trees: as they were grown.
        columns: of the tables that they were trained on.
        width: see `Trees`.
    """
    ordered = [_breadth_first(tree) for tree in trees]
    start = np.cumsum([0, *(len(tree.left) for tree in ordered)])
    first = np.repeat(start[:-1], np.diff(start)).astype(np.int32)
    feature, threshold, missing_left, left, value = (
        np.concatenate([getattr(tree, name) for tree in ordered])
        for name in ("feature", "threshold", "missing_left", "left", "value")
    )
    return Trees(columns, feature, threshold, missing_left, left + first, value, start[:-1].astype(np.int32), width)


def decision_tree(tree: Any, value: Float[np.ndarray, "node output"]) -> Tree:
    """Returns scikit-learn's `tree_` with the values that its nodes shall predict; it misses no values."""
    threshold = _rounded_down(tree.threshold)
    everywhere = np.ones(len(value), dtype=bool)
    return Tree(tree.children_left, tree.children_right, tree.feature, threshold, everywhere, value)


def classification_tree(tree: Any) -> Tree:
    """Returns scikit-learn's `tree_` of a binary classifier; it predicts the share of positive samples."""
    value = tree.value[:, 0, :]  # shares since scikit-learn 1.3, weighted counts before
    return decision_tree(tree, value[:, 1:] / value.sum(axis=1, keepdims=True))


def leaf(positive_share: float) -> Tree:
    """Returns a tree that always gives that share: the classifier of a set with a single class."""
    nowhere = np.array([-1])
    threshold = np.array([np.inf], np.float32)
    return Tree(nowhere, nowhere, nowhere, threshold, np.array([True]), np.array([[positive_share]]))


def boosted_trees(model: Any, *, width: Float[np.ndarray, "column"] | None = None) -> BoostedTrees:
    """Returns a fitted `HistGradientBoostingRegressor` as arrays.

    Args:
        model: with an identity link and without categories, as those for absolute and squared errors are.
        width: see `Trees`.
    """
    # the nodes are not in scikit-learn's public interface; a test compares predictions, so a change of theirs shows
    trees = [_boosted_tree(predictor.nodes) for (predictor,) in model._predictors]
    return BoostedTrees(
        float(np.asarray(model._baseline_prediction).item()), joined(trees, columns=model.n_features_in_, width=width)
    )


def _boosted_tree(nodes: Any) -> Tree:
    leaf = nodes["is_leaf"].astype(bool)
    left, right = (np.where(leaf, -1, nodes[side].astype(np.int64)) for side in ("left", "right"))
    missing_left, value = nodes["missing_go_to_left"].astype(bool), np.where(leaf, nodes["value"], 0.0)
    return Tree(
        left, right, nodes["feature_idx"].astype(np.int64), nodes["num_threshold"], missing_left, value[:, None]
    )


def _breadth_first(tree: Tree) -> Tree:
    """Returns the tree with its nodes in the order of `Trees`."""
    order = [0]
    for node in order:  # it grows while it is walked, which makes the order breadth first
        if tree.left[node] >= 0:
            order += [tree.left[node], tree.right[node]]
    rows = np.array(order)
    place = np.empty(len(rows), np.int32)
    place[rows] = np.arange(len(rows), dtype=np.int32)
    is_leaf = tree.left[rows] < 0
    left = np.where(is_leaf, place[rows], place[tree.left[rows]]).astype(np.int32)
    return Tree(
        left=left,
        right=left + 1,
        feature=np.where(is_leaf, 0, tree.feature[rows]).astype(np.int32),
        threshold=np.where(is_leaf, np.array(np.inf, tree.threshold.dtype), tree.threshold[rows]),
        missing_left=is_leaf | tree.missing_left[rows],
        value=tree.value[rows],
    )


def _rounded_down(threshold: Float[np.ndarray, "node"]) -> Float[np.ndarray, "node"]:
    """Returns the greatest float32 not above each threshold: it splits float32 features exactly alike."""
    near = threshold.astype(np.float32)
    return np.where(near > threshold, np.nextafter(near, np.float32(-np.inf)), near)


def _nodes(trees: Trees) -> Nodes:
    empty = len(trees.left)
    return Nodes(
        feature=jnp.asarray(np.append(trees.feature, 0), jnp.int32),
        threshold=jnp.asarray(np.append(trees.threshold, np.inf), jnp.float32),
        left=jnp.asarray(np.append(trees.left, empty), jnp.int32),
        share=jnp.asarray(np.append(trees.value[:, 0], 0.0), jnp.float64),
    )


def _schedule(forests: Forests, together: int) -> Schedule:
    depth = forests.trees.depths
    order = np.argsort(depth, kind="stable")
    padding = -len(order) % together
    # the padding's leaf adds 0 to a forest beyond the last
    root = np.append(np.full(padding, len(forests.trees.left)), forests.trees.root[order]).reshape(-1, together)
    forest = np.append(np.full(padding, len(forests)), order // forests.each).reshape(-1, together)
    deepest = np.append(np.zeros(padding, np.int32), depth[order]).reshape(-1, together).max(axis=1)
    return Schedule(jnp.asarray(root, jnp.int32), jnp.asarray(forest, jnp.int32), jnp.asarray(deepest, jnp.int32))


@partial(program, static_argnums=3)
def _sum_over_trees(
    features: Float[ArrayLike, "scene column"], nodes: Nodes, schedule: Schedule, forests: int
) -> Float[Array, "forest scene"]:
    features = jnp.asarray(features)
    scenes = features.shape[0]
    column_first = features.T.ravel()
    scene = jnp.arange(scenes, dtype=jnp.int32)

    def take(values: Array, index: Array) -> Array:
        return values.at[index].get(mode="promise_in_bounds")

    def down(_: Array, node: Array) -> Array:
        x = take(column_first, take(nodes.feature, node) * scenes + scene)
        return take(nodes.left, node) + (x > take(nodes.threshold, node)).astype(jnp.int32)

    def walk(sums: Array, block: Schedule) -> tuple[Array, None]:
        start = jnp.broadcast_to(block.root[:, None], (block.root.shape[0], scenes))
        leaf = jax.lax.fori_loop(0, block.depth, down, start)
        return sums.at[block.forest].add(take(nodes.share, leaf)), None

    return jax.lax.scan(walk, jnp.zeros((forests + 1, scenes)), schedule)[0]
