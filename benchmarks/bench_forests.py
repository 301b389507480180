"""32 lane-change forests: one compiled evaluation of all trees against 32 calls of scikit-learn.

Run: python benchmarks/bench_forests.py
Reach: one vehicle 20 times faster than scikit-learn's own calls, 10,000 vehicles at least as fast.
Both ways run in one process on the same trees; scikit-learn with its default of one thread.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from sklearn.ensemble import RandomForestClassifier

from measure import how_many, peak_memory, print_ratio, seconds
from rampcast.forecast.tables import TIMES
from rampcast.models.trees import Forests, classification_tree, joined
from rampcast.paper.lane_change.features import FEATURE_NAMES
from rampcast.paper.lane_change.forests import SPECS, fit
from rampcast.paper.lane_change.sets import KINDS, Anchors, Reading, Sampling, sample_set
from rampcast.paper.laws.mode import Mode

VEHICLES = how_many(256, tiny=16)  # I-80, windows 1 and 3: 117 + 139 on-ramp vehicles seen for more than 19 s
ANCHORS = 75  # each vehicle 0.2 s apart over 15 s
REPEATS = {1: 30, how_many(10_000, tiny=100): 5}
TREES = how_many(100, tiny=3)  # of each forest


def made_up_anchors(seed: int) -> Anchors:
    """Returns anchors as many as in I-80's windows 1 and 3, whose features tell roughly when the change comes."""
    rng = np.random.default_rng(seed)
    vehicle, number = np.divmod(np.arange(VEHICLES * ANCHORS), ANCHORS)
    left = (rng.uniform(15.0, 25.0, VEHICLES)[vehicle] - number * 0.2).round(1)
    habits = rng.normal(size=(VEHICLES, len(FEATURE_NAMES)))[vehicle]
    features = habits + 0.5 * rng.normal(size=habits.shape) + left[:, None] * rng.normal(size=habits.shape[1]) * 0.05
    return Anchors(features, left, left + 10.0, vehicle, Reading.LABEL)


def sklearn_forests(anchors: Anchors) -> list[RandomForestClassifier]:
    """Returns the 32 forests of paper mode as scikit-learn objects."""
    generator = np.random.default_rng(0)
    sets = [
        sample_set(kind, t, anchors, sampling=Sampling.BALANCED, generator=generator) for kind in KINDS for t in TIMES
    ]
    return [RandomForestClassifier(TREES, random_state=0).fit(anchors.features[s.rows], s.positive) for s in sets]


def main() -> None:
    """Prints times, ratios and memory."""
    anchors = made_up_anchors(0)
    for mode in Mode:
        start = time.perf_counter()
        fit(anchors, spec=replace(SPECS[mode], n_trees=TREES), seed=0)
        print(f"training, {mode} mode, {len(anchors):,} anchors: {time.perf_counter() - start:.1f} s")
    slow = sklearn_forests(anchors)
    trees = joined(
        [classification_tree(tree.tree_) for forest in slow for tree in forest.estimators_], columns=len(FEATURE_NAMES)
    )
    fast = Forests(trees, len(slow[0].estimators_))
    size = sum(getattr(trees, name).nbytes for name in ("feature", "threshold", "missing_left", "left", "value")) / 1e6
    print(f"{len(slow)} forests of {fast.each} trees, {len(trees.left):,} nodes, {size:.1f} MB as arrays")
    for scenes, repeats in REPEATS.items():
        features = made_up_anchors(1).features[:scenes]
        compare(slow, fast.positive_share, features, repeats)


def compare(
    slow: list[RandomForestClassifier],
    fast: Callable[[Float[np.ndarray, "scene 42"]], Float[np.ndarray, "scene 32"]],
    features: Float[np.ndarray, "scene 42"],
    repeats: int,
) -> None:
    """Prints both ways side by side for those scenes."""

    def plain() -> Float[np.ndarray, "scene 32"]:
        return np.stack([forest.predict_proba(features)[:, 1] for forest in slow], axis=1)

    memory = peak_memory(lambda: fast(features)), peak_memory(plain)  # of first calls: with compiling
    difference = np.abs(plain() - fast(features)).max()
    ours, theirs = seconds(lambda: fast(features), repeats), seconds(plain, max(repeats // 3, 2))
    print(
        f"{len(features):,} vehicles: scikit-learn {theirs * 1e3:.1f} ms, +{memory[1]:.1f} MB; "
        f"rampcast {ours * 1e3:.2f} ms, +{memory[0]:.1f} MB; "
        f"largest difference {difference:.0e}"
    )
    print_ratio(f"time of scikit-learn over ours, {len(features):,} vehicles", theirs / ours)


if __name__ == "__main__":
    main()
