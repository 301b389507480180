"""Random forests as plain arrays, and one compiled function that evaluates all of them at once.

The nodes of all trees lie in one row, each tree in breadth-first order, so that the right child follows the left one:
one level down is `left[node] + (x[feature[node]] > threshold[node])`. A leaf points to itself and its threshold is
infinite, so trees of different depth can be walked together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Array, Float, Int

from rampcast.compute import blocks, jax, jnp, padded
from rampcast.errors import ModelError

# Scenes are padded to one of these numbers, so that a new number does not compile again; beside it the number of trees
# that are walked together. Measured: few scenes need many trees to be worth an array operation, many scenes need few,
# for their nodes to stay in the cache.
TREES_TOGETHER: Final = {1: 400, 16: 400, 256: 100, 2048: 32}

NODE_ARRAYS: Final = ("feature", "threshold", "left", "share")


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
class PackedForests:
    """Binary forests of equally many trees.

    Attributes:
        feature: column that a node compares; 0 at a leaf.
        threshold: greatest value that goes left; infinite at a leaf.
        left: left child, the right child being the next node; the node itself at a leaf.
        share: share of positive training samples in a node.
        root: first node of each tree.
    """

    feature: Int[np.ndarray, "node"]
    threshold: Float[np.ndarray, "node"]
    left: Int[np.ndarray, "node"]
    share: Float[np.ndarray, "node"]
    root: Int[np.ndarray, "forest tree"]

    @cached_property
    def _on_device(self) -> tuple[Nodes, dict[int, Schedule]]:
        """Returns the arrays that the compiled function takes: the nodes, and a schedule for each padded size."""
        return _nodes(self), {size: _schedule(self, together) for size, together in TREES_TOGETHER.items()}

    def positive_share(self, features: Float[np.ndarray, "scene column"]) -> Float[np.ndarray, "scene forest"]:
        """Returns the probability of "positive" by each forest: the mean over its trees.

        Equal to scikit-learn's `predict_proba(...)[:, 1]`, which also reads features as float32.
        """
        # double precision sums, so that the answer does not depend on the order of the trees
        features = features.astype(np.float32)
        forests, trees = self.root.shape
        shares = np.empty((len(features), forests))
        nodes, schedules = self._on_device
        for block in blocks(len(features), sizes=tuple(TREES_TOGETHER)):
            sums = np.asarray(_sum_over_trees(padded(features, block), nodes, schedules[block.size], forests))
            shares[block.start : block.stop] = sums[:forests, : block.stop - block.start].T / trees
        return shares

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Returns the arrays by name."""
        return {name: getattr(self, name) for name in (*NODE_ARRAYS, "root")}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], *, n_features: int) -> "PackedForests":
        """Returns the forests that `to_arrays` described.

        Raises:
            ModelError: an array is missing, or their shapes differ, or a node points outside them.
        """
        missing = [name for name in (*NODE_ARRAYS, "root") if name not in arrays]
        if missing:
            raise ModelError(f"forests: the arrays {missing} are missing, got {sorted(arrays)}; train the model again")
        shapes = {name: arrays[name].shape for name in (*NODE_ARRAYS, "root")}
        if len({shapes[name] for name in NODE_ARRAYS}) != 1 or len(shapes["left"]) != 1 or len(shapes["root"]) != 2:
            raise ModelError(f"forests: expected nodes of one length and roots [forest, tree], got {shapes}")
        packed = cls(
            feature=arrays["feature"].astype(np.int32),
            threshold=arrays["threshold"].astype(np.float32),
            left=arrays["left"].astype(np.int32),
            share=arrays["share"].astype(np.float64),
            root=arrays["root"].astype(np.int32),
        )
        _check(packed, n_features)
        return packed


def pack(forests: Sequence[Sequence[Any]]) -> PackedForests:
    """Returns forests of scikit-learn trees (`tree_` of a fitted binary decision tree) as plain arrays."""
    trees = [_tree_arrays(tree) for forest in forests for tree in forest]
    start = np.cumsum([0, *(len(tree["left"]) for tree in trees)])
    columns = {name: np.concatenate([tree[name] for tree in trees]) for name in NODE_ARRAYS}
    columns["left"] = columns["left"] + np.repeat(start[:-1], np.diff(start)).astype(np.int32)
    return PackedForests(**columns, root=start[:-1].astype(np.int32).reshape(len(forests), -1))


class TreeArrays(NamedTuple):
    """One tree, in the form of scikit-learn's `tree_`."""

    children_left: Int[np.ndarray, "node"]
    children_right: Int[np.ndarray, "node"]
    feature: Int[np.ndarray, "node"]
    threshold: Float[np.ndarray, "node"]
    value: Float[np.ndarray, "node 1 2"]


def leaf(positive_share: float) -> TreeArrays:
    """Returns a tree that always gives that share: the classifier of a set with a single class."""
    nowhere = np.array([-1])
    value = np.array([[[1.0 - positive_share, positive_share]]])
    return TreeArrays(nowhere, nowhere, nowhere, np.array([np.inf]), value)


def _tree_arrays(tree: Any) -> dict[str, np.ndarray]:
    order = [0]
    for node in order:  # it grows while it is walked, which makes the order breadth first
        if tree.children_left[node] >= 0:
            order += [tree.children_left[node], tree.children_right[node]]
    rows = np.array(order)
    place = np.empty(len(rows), np.int32)
    place[rows] = np.arange(len(rows), dtype=np.int32)
    is_leaf = tree.children_left[rows] < 0
    value = tree.value[rows, 0, :]  # shares since scikit-learn 1.3, weighted counts before
    return {
        "feature": np.where(is_leaf, 0, tree.feature[rows]).astype(np.int32),
        "threshold": _rounded_down(np.where(is_leaf, np.inf, tree.threshold[rows])),
        "left": np.where(is_leaf, place[rows], place[tree.children_left[rows]]).astype(np.int32),
        "share": value[:, 1] / value.sum(axis=1),
    }


def _rounded_down(threshold: Float[np.ndarray, "node"]) -> Float[np.ndarray, "node"]:
    """Returns the greatest float32 not above each threshold: it splits float32 features exactly alike."""
    near = threshold.astype(np.float32)
    return np.where(near > threshold, np.nextafter(near, np.float32(-np.inf)), near)


def _depths(packed: PackedForests) -> Int[np.ndarray, "tree"]:
    """Returns the number of levels below the root of each tree."""
    node = packed.root.ravel()
    tree = np.arange(len(node))
    depth = np.zeros(len(node), np.int32)
    level = 0
    while True:
        inner = packed.left[node] != node
        node, tree = packed.left[node[inner]], tree[inner]
        if not len(node):
            return depth
        level += 1
        depth[tree] = level
        node, tree = np.concatenate([node, node + 1]), np.concatenate([tree, tree])


def _nodes(packed: PackedForests) -> Nodes:
    empty = len(packed.left)
    return Nodes(
        feature=jnp.asarray(np.append(packed.feature, 0), jnp.int32),
        threshold=jnp.asarray(np.append(packed.threshold, np.inf), jnp.float32),
        left=jnp.asarray(np.append(packed.left, empty), jnp.int32),
        share=jnp.asarray(np.append(packed.share, 0.0), jnp.float64),
    )


def _schedule(packed: PackedForests, together: int) -> Schedule:
    forests, trees = packed.root.shape
    depth = _depths(packed)
    order = np.argsort(depth, kind="stable")
    padding = -len(order) % together
    # the padding's leaf adds 0 to a forest beyond the last
    root = np.append(np.full(padding, len(packed.left)), packed.root.ravel()[order]).reshape(-1, together)
    forest = np.append(np.full(padding, forests), order // trees).reshape(-1, together)
    deepest = np.append(np.zeros(padding, np.int32), depth[order]).reshape(-1, together).max(axis=1)
    return Schedule(jnp.asarray(root, jnp.int32), jnp.asarray(forest, jnp.int32), jnp.asarray(deepest, jnp.int32))


def _check(packed: PackedForests, n_features: int) -> None:
    nodes = np.arange(len(packed.left))
    inside = np.all((packed.left >= nodes) & ((packed.left == nodes) | (packed.left + 1 < len(nodes))))
    inside &= np.all((packed.feature >= 0) & (packed.feature < n_features))
    inside &= np.all((packed.root >= 0) & (packed.root < len(nodes)))
    if not inside:
        raise ModelError("forests: a node points outside the arrays: the file is damaged; train the model again")


@partial(jax.jit, static_argnums=3)
def _sum_over_trees(
    features: Float[Array, "scene column"], nodes: Nodes, schedule: Schedule, forests: int
) -> Float[Array, "forest scene"]:
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
