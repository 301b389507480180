"""Quality of the lane-change classifiers: one row for each test set, kind and t.

Test sets are made in the same way as training sets: balanced as in the paper, and of all anchors (natural base rate).
"""

from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from rampcast.models.forest_sets import KINDS, TIMES, Anchors, SampleSet, Sampling, sample_set
from rampcast.models.forests import LaneChangeForests, predict

# A classifier says "lane change" above this probability: scikit-learn's rule, which gives a tie to "no lane change".
THRESHOLD: Final = 0.5

METRICS: Final = ("accuracy", "tpr", "tnr", "ppv", "npv", "base_rate", "brier")


def lane_change_table(forests: LaneChangeForests, anchors: Anchors, *, seed: int) -> pl.DataFrame:
    """Returns the quality of the forests on those anchors, on balanced sets and at the natural base rate.

    Columns: mode, reading, sampling, kind, t [s], n, positives, accuracy, tpr, tnr, ppv, npv, base_rate, brier, and
    censored and changed_already (anchors left out, see `forest_sets`). A metric is null where it is undefined.

    Args:
        forests: fitted on other anchors.
        anchors: test scenes, their lane changes dated as the caller likes.
        seed: fixes which anchors the balanced sets draw.
    """
    probability = dict(zip(KINDS, predict(forests, anchors.features), strict=True))
    rows = []
    for sampling in Sampling:
        for number, (kind, t) in enumerate((kind, t) for kind in KINDS for t in TIMES):
            generator = np.random.default_rng([seed, number])
            samples = sample_set(kind, t, anchors, sampling=sampling, generator=generator)
            metrics = binary_metrics(probability[kind][samples.rows, t], samples.positive)
            rows.append({"sampling": sampling.value, "kind": kind, "t": float(t), **_counts(samples), **metrics})
    head = pl.lit(forests.spec.mode.value).alias("mode"), pl.lit(anchors.reading.value).alias("reading")
    tail = ["sampling", "kind", "t", "n", "positives", *METRICS, "censored", "changed_already"]
    floats = dict.fromkeys(METRICS, pl.Float64)
    return pl.DataFrame(rows, schema_overrides=floats).select(*head, *tail)


def binary_metrics(
    probability: Float[np.ndarray, "sample"], positive: Bool[np.ndarray, "sample"]
) -> dict[str, float | None]:
    """Returns accuracy, TPR, TNR, PPV, NPV, base rate and Brier score; None where undefined.

    All are None where the classifier has no answer (a probability of NaN).
    """
    if np.isnan(probability).any():
        return dict.fromkeys(METRICS)
    said = probability > THRESHOLD
    right = said == positive
    squared_error = (probability - positive) ** 2
    return {
        "accuracy": _mean(right),
        "tpr": _mean(right[positive]),
        "tnr": _mean(right[~positive]),
        "ppv": _mean(right[said]),
        "npv": _mean(right[~said]),
        "base_rate": _mean(positive),
        "brier": _mean(squared_error),
    }


def _mean(values: Bool[np.ndarray, "chosen"] | Float[np.ndarray, "chosen"]) -> float | None:
    return float(values.mean()) if len(values) else None


def _counts(samples: SampleSet) -> dict[str, int]:
    return {
        "n": len(samples.rows),
        "positives": int(samples.positive.sum()),
        "censored": samples.censored,
        "changed_already": samples.changed_already,
    }
