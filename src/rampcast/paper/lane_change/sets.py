"""Training and test sets of the lane-change classifiers: what is true of an anchor, and which anchors are drawn.

Everything is read to one step of 0.2 s: a change belongs to step k = round(change time / 0.2 s), and t to step 5 t.

- "within" t is true where k <= 5 t; "at" t is true where k = 5 t. Balanced sets, as the paper prints them, hold changes
  in less and in more than t alone: one in exactly t is in neither, so that what is learned there means "within" too.
- At t = 0 both are true where k <= 1: the change happens in the step that begins at the anchor. "In less than 0 s" and
  "in exactly 0 s" have no sample, for a scene's central vehicle is in the ramp lane at its anchor.
- Where no change was seen, an anchor is negative only if its vehicle was seen for more than t; else it is censored:
  the truth is unknown, the anchor is left out and counted.
- An anchor whose change lies at or before t = 0 (the line is crossed before the label changes) is left out and counted.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.horizon import STEP, STEPS_PER_SECOND
from rampcast.paper.lane_change.features import lane_change_features
from rampcast.paper.scenes.scenes import CENTRAL, Scenes

KINDS: Final = ("within", "at")


class Reading(StrEnum):
    """How the time of a lane change is read: the lane label changes, or the vehicle crosses the lane line."""

    LABEL = "label"
    CROSSING = "crossing"


class Sampling(StrEnum):
    """Which anchors make a set.

    BALANCED: one positive and one negative per vehicle, drawn at random (the paper); negative means "in more than t".
    NATURAL: every anchor whose truth is known; negative means "not so", so that probabilities have the base rate.
    """

    BALANCED = "balanced"
    NATURAL = "natural"


@dataclass(frozen=True)
class Anchors:
    """Scenes as a lane-change classifier sees them.

    Attributes:
        features: in the order of `FEATURE_NAMES`.
        change_time: time from the anchor to the lane change [s]; NaN if none was seen.
        seen_for: time from the anchor to the vehicle's last row [s].
        vehicle: a number for each (recording, vehicle).
        reading: how `change_time` was read.
    """

    features: Float[np.ndarray, "scene 42"]
    change_time: Float[np.ndarray, "scene"]
    seen_for: Float[np.ndarray, "scene"]
    vehicle: Int[np.ndarray, "scene"]
    reading: Reading

    def __len__(self) -> int:
        return len(self.change_time)


@dataclass(frozen=True)
class Truth:
    """Which anchors are positive, which negative, and which are left out because the truth was not seen."""

    positive: Bool[np.ndarray, "scene"]
    negative: Bool[np.ndarray, "scene"]
    censored: Bool[np.ndarray, "scene"]
    changed_already: Bool[np.ndarray, "scene"]


@dataclass(frozen=True)
class SampleSet:
    """The anchors of one training or test set: their rows, their truth, and how many anchors had to be left out."""

    rows: Int[np.ndarray, "sample"]
    positive: Bool[np.ndarray, "sample"]
    censored: int
    changed_already: int


def lane_change_anchors(scenes: Scenes, reading: Reading) -> Anchors:
    """Returns the scenes as anchors of lane-change classifiers, their lane changes dated by `reading`."""
    _, recording = np.unique(scenes.recording, return_inverse=True)
    ids, vehicle = np.unique(scenes.vehicle[:, CENTRAL], return_inverse=True)
    return Anchors(
        features=lane_change_features(scenes),
        change_time=scenes.change_label if reading is Reading.LABEL else scenes.change_crossing,
        seen_for=scenes.seen_for,
        vehicle=recording * len(ids) + vehicle,
        reading=reading,
    )


def truth(kind: str, t: int, anchors: Anchors, *, sampling: Sampling) -> Truth:
    """Returns what is known of "a lane change within / at `t` [s]" for each anchor."""
    seen = ~np.isnan(anchors.change_time)
    ahead = seen & (np.nan_to_num(anchors.change_time) > 0.0)
    step = np.rint(np.nan_to_num(anchors.change_time) / STEP).astype(np.int64)
    this = t * STEPS_PER_SECOND
    if t == 0:
        positive, later = ahead & (step <= 1), ahead & (step > 1)
    else:
        below = step < this if sampling is Sampling.BALANCED else step <= this
        positive, later = ahead & (below if kind == "within" else step == this), ahead & (step > this)
    kept = ~seen & (np.rint(anchors.seen_for / STEP).astype(np.int64) > this)
    return Truth(
        positive=positive,
        negative=kept | (later if sampling is Sampling.BALANCED else ahead & ~positive),
        censored=~seen & ~kept,
        changed_already=seen & ~ahead,
    )


def sample_set(kind: str, t: int, anchors: Anchors, *, sampling: Sampling, generator: np.random.Generator) -> SampleSet:
    """Returns the set for "a lane change within / at `t` [s]".

    A balanced set holds at most one positive and one negative per vehicle: a vehicle that has none of one class gives
    only the other.
    """
    known = truth(kind, t, anchors, sampling=sampling)
    if sampling is Sampling.BALANCED:
        positive = _one_per_vehicle(known.positive, anchors.vehicle, generator)
        negative = _one_per_vehicle(known.negative, anchors.vehicle, generator)
    else:
        positive, negative = np.flatnonzero(known.positive), np.flatnonzero(known.negative)
    rows = np.concatenate([positive, negative])
    return SampleSet(
        rows=rows,
        positive=np.arange(len(rows)) < len(positive),
        censored=int(known.censored.sum()),
        changed_already=int(known.changed_already.sum()),
    )


def _one_per_vehicle(
    mask: Bool[np.ndarray, "scene"], vehicle: Int[np.ndarray, "scene"], generator: np.random.Generator
) -> Int[np.ndarray, "sample"]:
    rows = generator.permutation(np.flatnonzero(mask))
    _, first = np.unique(vehicle[rows], return_index=True)
    return rows[first]
