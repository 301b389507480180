"""The 32 random forests that classify lane changes: "within t seconds" and "at t seconds" for t = 0 to 15 s.

Trained with scikit-learn, kept as plain arrays, evaluated all at once.
Source: Li, Fischer, Kontar, Ahn, arXiv 2108.10397, section "RF Classifier".
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.errors import ModelError
from rampcast.forecast.tables import TIMES
from rampcast.models.plain_data import MAY_BE_MISSING
from rampcast.models.trees import Forests, Tree, classification_tree, joined, leaf
from rampcast.paper.lane_change.features import FEATURE_NAMES, GROUPINGS
from rampcast.paper.lane_change.sets import KINDS, Anchors, Reading, SampleSet, Sampling, sample_set
from rampcast.paper.laws.mode import Mode

Progress = Callable[[int, int], None]  # classifiers trained, classifiers in all

FORESTS: Final = "forests"  # in the column "model" of lane-change tables
COUNTS: Final = ("n", "positives", "censored", "changed_already")


class Cumulative(StrEnum):
    """Whether "within t" may fall with t, as 16 forests that know nothing of each other can (erratum 5)."""

    AS_TRAINED = "as trained"
    RUNNING_MAXIMUM = "running maximum"


class Training(IntEnum):
    """How the training of one classifier ended. The codes are part of the saved form."""

    TRAINED = 0
    ONE_CLASS = 1  # only positives or only negatives: the classifier always gives that answer
    NO_SAMPLES = 2  # nothing to learn from: the classifier gives NaN


@dataclass(frozen=True)
class ForestSpec:
    """Hyper-parameters of the 32 forests; the rest is scikit-learn's default.

    Attributes:
        mode: what the spec is for, a column of the tables.
        n_trees: trees in each forest; scikit-learn's default (the paper gives none).
        sampling: which anchors make the training sets.
        cumulative: whether "within t" is made to grow with t.
    """

    mode: Mode = Mode.PAPER
    n_trees: int = 100
    sampling: Sampling = Sampling.BALANCED
    cumulative: Cumulative = Cumulative.AS_TRAINED


SPECS: Final = {
    Mode.PAPER: ForestSpec(),
    Mode.CORRECTED: ForestSpec(mode=Mode.CORRECTED, sampling=Sampling.NATURAL, cumulative=Cumulative.RUNNING_MAXIMUM),
}


@dataclass(frozen=True)
class LaneChangeForests:
    """32 fitted forests: first "within" for t = 0 to 15 s, then "at".

    Attributes:
        spec: what they were trained with.
        reading: how the lane changes were dated.
        packed: the trees.
        training: how each training ended, a code of `Training`.
        counts: for each classifier the numbers named in `COUNTS`: samples, positive samples, anchors left out because
            the truth was not seen, anchors left out because the change lay before them.
        importance: mean decrease of impurity by each feature, of sum 1; NaN where no tree splits.
    """

    spec: ForestSpec
    reading: Reading
    packed: Forests
    training: Int[np.ndarray, "32"]
    counts: Int[np.ndarray, "32 4"]
    importance: Float[np.ndarray, "32 42"] = field(metadata=MAY_BE_MISSING)

    def __post_init__(self) -> None:
        """Checks that there are 32 forests of as many trees as the spec says, over the 42 features.

        Raises:
            ModelError: there are not.
        """
        found = (len(self.packed.trees.root), self.packed.each, self.packed.trees.columns)
        if found != (len(KINDS) * len(TIMES) * self.spec.n_trees, self.spec.n_trees, len(FEATURE_NAMES)):
            raise ModelError(
                f"expected {len(KINDS) * len(TIMES)} forests of {self.spec.n_trees} trees over {len(FEATURE_NAMES)} "
                f"features, got {found[0]} trees, {found[1]} in a forest, over {found[2]}"
            )


def fit(anchors: Anchors, *, spec: ForestSpec, seed: int, progress: Progress | None = None) -> LaneChangeForests:
    """Returns 32 forests trained on those anchors.

    Args:
        anchors: one row for each training scene (see `lane_change_anchors`), best 0.2 s apart.
        spec: hyper-parameters; `SPECS` holds those of the two modes.
        seed: fixes which anchors are drawn and which trees grow.
        progress: called after each classifier.

    Raises:
        ModelError: there are no anchors, or a feature is not a finite number.
    """
    _check(anchors)
    trees: list[Tree] = []
    training, counts, importance = [], [], []
    jobs = [(kind, t) for kind in KINDS for t in TIMES]
    for number, (kind, t) in enumerate(jobs):
        draw, grow = np.random.SeedSequence([seed, number]).spawn(2)
        samples = sample_set(kind, t, anchors, sampling=spec.sampling, generator=np.random.default_rng(draw))
        forest, outcome, weight = _train(anchors, samples, spec, int(grow.generate_state(1)[0]))
        trees += forest
        training.append(outcome.value)
        counts.append((len(samples.rows), samples.positive.sum(), samples.censored, samples.changed_already))
        importance.append(weight)
        if progress is not None:
            progress(number + 1, len(jobs))
    return LaneChangeForests(
        spec=spec,
        reading=anchors.reading,
        packed=Forests(joined(trees, columns=len(FEATURE_NAMES)), spec.n_trees),
        training=np.array(training),
        counts=np.array(counts, dtype=np.int64),
        importance=np.array(importance),
    )


def predict(
    forests: LaneChangeForests, features: Float[np.ndarray, "scene 42"]
) -> tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]:
    """Returns the probability of a lane change within t and at t, for t = 0 to 15 s; NaN where untrainable."""
    within, at = np.split(forests.packed.positive_share(features), [len(TIMES)], axis=1)
    if forests.spec.cumulative is Cumulative.RUNNING_MAXIMUM:
        within = np.where(np.isnan(within), np.nan, np.fmax.accumulate(within, axis=1))
    return within, at


def importance_table(forests: LaneChangeForests) -> pl.DataFrame:
    """Returns feature importance by feature kind and by vehicle group: mode, kind, t [s], grouping, group, importance.

    The importances of one kind, t and grouping sum to 1; null where no tree of the classifier splits.
    """
    parts = []
    for grouping, groups in GROUPINGS.items():
        for group in dict.fromkeys(groups):
            share = forests.importance[:, np.array(groups) == group].sum(axis=1)
            parts.append(
                _classifier_columns().with_columns(grouping=pl.lit(grouping), group=pl.lit(group), importance=share)
            )
    mode = pl.lit(forests.spec.mode.value).alias("mode")
    table = pl.concat(parts).select(mode, pl.exclude("importance"), pl.col("importance").fill_nan(None))
    return table.sort("kind", "t", "grouping", maintain_order=True)


def training_table(forests: LaneChangeForests) -> pl.DataFrame:
    """Returns what each classifier was trained on: mode, reading, kind, t [s], outcome, and the counts of `COUNTS`."""
    outcome = [Training(code).name.lower() for code in forests.training]
    return _classifier_columns().select(
        pl.lit(forests.spec.mode.value).alias("mode"),
        pl.lit(forests.reading.value).alias("reading"),
        pl.all(),
        pl.Series("outcome", outcome),
        *(pl.Series(name, forests.counts[:, column]) for column, name in enumerate(COUNTS)),
    )


def _train(
    anchors: Anchors, samples: SampleSet, spec: ForestSpec, random_state: int
) -> tuple[list[Tree], Training, Float[np.ndarray, "42"]]:
    """Returns the trees of one classifier, how its training ended, and the importance of each feature."""
    from sklearn.ensemble import RandomForestClassifier  # here, for predicting needs none of it and importing is slow

    nothing = np.full(len(FEATURE_NAMES), np.nan)
    if len(samples.rows) == 0:
        return [leaf(np.nan)] * spec.n_trees, Training.NO_SAMPLES, nothing
    if samples.positive.all() or not samples.positive.any():
        return [leaf(float(samples.positive[0]))] * spec.n_trees, Training.ONE_CLASS, nothing
    classifier = RandomForestClassifier(
        n_estimators=spec.n_trees, max_samples=_draws_per_tree(anchors, samples, spec), random_state=random_state
    )
    classifier.fit(anchors.features[samples.rows], samples.positive)
    weight = classifier.feature_importances_
    trees = [classification_tree(tree.tree_) for tree in classifier.estimators_]
    return trees, Training.TRAINED, weight if weight.any() else nothing


def _draws_per_tree(anchors: Anchors, samples: SampleSet, spec: ForestSpec) -> int | None:
    """Returns how many anchors each tree draws; None for as many as there are.

    Anchors of one vehicle 0.2 s apart are nearly equal: trees that draw all of them learn each vehicle by heart. Here
    each tree draws two per vehicle on average, as many as a balanced set holds.
    """
    if spec.sampling is Sampling.BALANCED:
        return None
    return min(2 * len(np.unique(anchors.vehicle[samples.rows])), len(samples.rows))


def _classifier_columns() -> pl.DataFrame:
    return pl.DataFrame({"kind": np.repeat(KINDS, len(TIMES)), "t": np.tile(np.array(TIMES, np.float64), len(KINDS))})


def _check(anchors: Anchors) -> None:
    if not len(anchors):
        raise ModelError("lane-change forests need at least one scene with an on-ramp vehicle, got none")
    row, column = np.nonzero(~np.isfinite(anchors.features))
    if len(row):
        raise ModelError(
            f"lane-change forests: expected finite features, got {anchors.features[row[0], column[0]]} "
            f"for '{FEATURE_NAMES[column[0]]}' in scene {row[0]} ({len(row)} such values); build the scenes again"
        )
