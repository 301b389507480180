"""Quality of the lane-change forecasts: one row for each model, test set, kind and t.

Test sets are made in the same way as training sets: balanced as in the paper, and of all anchors (natural base rate).
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from rampcast.evaluate.yes_or_no import accuracy, best_threshold
from rampcast.forecast.tables import TIMES
from rampcast.paper.lane_change.forests import FORESTS, LaneChangeForests, predict
from rampcast.paper.lane_change.sets import KINDS, Anchors, SampleSet, Sampling, sample_set
from rampcast.paper.laws.mode import Mode

# A model says "lane change" above this probability: scikit-learn's rule, which gives a tie to "no lane change".
THRESHOLD: Final = 0.5

METRICS: Final = ("accuracy", "tpr", "tnr", "ppv", "npv", "base_rate", "brier", "best_accuracy", "brier_skill")


def lane_change_table(forests: LaneChangeForests, anchors: Anchors, *, seed: int) -> pl.DataFrame:
    """Returns the quality of the forests on those anchors; see `lane_change_scores`.

    Args:
        forests: fitted on other anchors.
        anchors: test scenes, their lane changes dated as the caller likes.
        seed: fixes which anchors the balanced sets draw.
    """
    probability = dict(zip(KINDS, predict(forests, anchors.features), strict=True))
    return lane_change_scores(probability, anchors, model=FORESTS, mode=forests.spec.mode, seed=seed)


def lane_change_scores(
    probability: Mapping[str, Float[np.ndarray, "scene 16"]],
    anchors: Anchors,
    *,
    model: str,
    mode: Mode,
    seed: int,
    samplings: Sequence[Sampling] = tuple(Sampling),
) -> pl.DataFrame:
    """Returns the quality of lane-change probabilities, on balanced sets and at the natural base rate.

    Columns: mode, model, reading, sampling, kind, t [s], n, positives, accuracy, tpr, tnr, ppv, npv, base_rate, brier,
    best_accuracy (with the threshold that is the best on this very set), brier_skill (against always saying the base
    rate), and censored and changed_already (anchors left out, see `forest_sets`). A metric is null where it is
    undefined.

    Args:
        probability: by kind, for t = 0 to 15 s.
        anchors: test scenes, their lane changes dated as the caller likes.
        model: what gave the probabilities.
        mode: of the paper.
        seed: fixes which anchors the balanced sets draw.
        samplings: which sets.
    """
    rows = []
    for sampling in samplings:
        for number, (kind, t) in enumerate((kind, t) for kind in KINDS for t in TIMES):
            generator = np.random.default_rng([seed, number])
            samples = sample_set(kind, t, anchors, sampling=sampling, generator=generator)
            metrics = binary_metrics(probability[kind][samples.rows, t], samples.positive)
            rows.append({"sampling": sampling.value, "kind": kind, "t": float(t), **_counts(samples), **metrics})
    names = {"mode": mode.value, "model": model, "reading": anchors.reading.value}
    head = [pl.lit(value).alias(name) for name, value in names.items()]
    tail = ["sampling", "kind", "t", "n", "positives", *METRICS, "censored", "changed_already"]
    floats = dict.fromkeys(METRICS, pl.Float64)
    return pl.DataFrame(rows, schema_overrides=floats).select(*head, *tail)


def binary_metrics(
    probability: Float[np.ndarray, "sample"], positive: Bool[np.ndarray, "sample"]
) -> dict[str, float | None]:
    """Returns the `METRICS`; None where undefined. All are without a sample, or an answer (a probability of NaN)."""
    if not len(positive) or np.isnan(probability).any():
        return dict.fromkeys(METRICS)
    said = probability > THRESHOLD
    right = said == positive
    brier, rate = float(np.mean((probability - positive) ** 2)), float(positive.mean())
    by_chance = rate * (1.0 - rate)  # the Brier score of always saying the base rate
    alike = np.ones(len(positive))
    return {
        "accuracy": _mean(right),
        "tpr": _mean(right[positive]),
        "tnr": _mean(right[~positive]),
        "ppv": _mean(right[said]),
        "npv": _mean(right[~said]),
        "base_rate": rate,
        "brier": brier,
        "best_accuracy": accuracy(probability, positive, alike, threshold=best_threshold(probability, positive, alike)),
        "brier_skill": 1.0 - brier / by_chance if by_chance else None,
    }


def _mean(values: Bool[np.ndarray, "chosen"]) -> float | None:
    return float(values.mean()) if len(values) else None


def _counts(samples: SampleSet) -> dict[str, int]:
    return {
        "n": len(samples.rows),
        "positives": int(samples.positive.sum()),
        "censored": samples.censored,
        "changed_already": samples.changed_already,
    }
