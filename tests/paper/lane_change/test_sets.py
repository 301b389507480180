"""Training and test sets of the lane-change classifiers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.forecast.tables import TIMES
from rampcast.paper.lane_change.sets import (
    KINDS,
    Anchors,
    Reading,
    Sampling,
    lane_change_anchors,
    sample_set,
    truth,
)
from tests.factories import random_anchors, random_scenes

NAN = float("nan")


def anchors_with(change_time: list[float], seen_for: list[float], vehicle: list[int] | None = None) -> Anchors:
    n = len(change_time)
    return Anchors(
        features=np.zeros((n, 42)),
        change_time=np.array(change_time),
        seen_for=np.array(seen_for),
        vehicle=np.array(vehicle if vehicle is not None else range(n)),
        reading=Reading.LABEL,
    )


#                       0    1    2    3     4    5          6          7
EXAMPLES = anchors_with([0.2, 1.8, 2.0, 2.2, 10.0, NAN, NAN, -0.4], [15.0, 15.0, 15.0, 15.0, 15.0, 2.0, 2.2, 15.0])


@pytest.mark.parametrize(
    ("kind", "t", "sampling", "positive", "negative", "censored"),
    [
        ("within", 2, Sampling.BALANCED, [0, 1], [3, 4, 6], [5]),  # exactly 2 s is neither less nor more
        ("at", 2, Sampling.BALANCED, [2], [3, 4, 6], [5]),  # earlier changes are neither
        ("within", 2, Sampling.NATURAL, [0, 1, 2], [3, 4, 6], [5]),
        ("at", 2, Sampling.NATURAL, [2], [0, 1, 3, 4, 6], [5]),
        ("within", 0, Sampling.BALANCED, [0], [1, 2, 3, 4, 5, 6], []),  # the step that begins at the anchor
        ("at", 0, Sampling.NATURAL, [0], [1, 2, 3, 4, 5, 6], []),
        ("within", 15, Sampling.BALANCED, [0, 1, 2, 3, 4], [], [5, 6]),
    ],
)
def test_truth_by_hand(
    kind: str, t: int, sampling: Sampling, positive: list[int], negative: list[int], censored: list[int]
) -> None:
    known = truth(kind, t, EXAMPLES, sampling=sampling)
    assert np.flatnonzero(known.positive).tolist() == positive
    assert np.flatnonzero(known.negative).tolist() == negative
    assert np.flatnonzero(known.censored).tolist() == censored
    assert np.flatnonzero(known.changed_already).tolist() == [7]


@settings(max_examples=60, deadline=None)
@given(
    times=st.lists(
        st.tuples(st.one_of(st.just(NAN), st.floats(-1.0, 20.0)), st.floats(0.0, 20.0)), min_size=1, max_size=8
    ),
    t=st.sampled_from(TIMES),
    kind=st.sampled_from(KINDS),
)
def test_no_anchor_has_two_truths_and_at_the_natural_rate_none_goes_missing(
    times: list[tuple[float, float]], t: int, kind: str
) -> None:
    anchors = anchors_with([change for change, _ in times], [seen for _, seen in times])
    for sampling in Sampling:
        known = truth(kind, t, anchors, sampling=sampling)
        total = known.positive.astype(int) + known.negative + known.censored + known.changed_already
        assert np.all(total <= 1)
        if sampling is Sampling.NATURAL:
            assert np.all(total == 1)


def test_within_grows_with_t() -> None:
    anchors = random_anchors(np.random.default_rng(0), 400)
    positive = np.stack([truth("within", t, anchors, sampling=Sampling.NATURAL).positive for t in TIMES])
    assert np.all(positive[1:] >= positive[:-1])


@pytest.mark.parametrize("kind", KINDS)
def test_a_balanced_set_holds_one_positive_and_one_negative_per_vehicle(kind: str) -> None:
    anchors = random_anchors(np.random.default_rng(1), 1000)
    known = truth(kind, 6, anchors, sampling=Sampling.BALANCED)
    samples = sample_set(kind, 6, anchors, sampling=Sampling.BALANCED, generator=np.random.default_rng(0))
    for wanted, mask in ((True, known.positive), (False, known.negative)):
        drawn = samples.rows[samples.positive == wanted]
        assert mask[drawn].all()
        assert sorted(anchors.vehicle[drawn]) == sorted(set(anchors.vehicle[mask]))


def test_the_generator_decides_which_anchors_are_drawn() -> None:
    anchors = random_anchors(np.random.default_rng(2), 1000)
    drawn = [
        sample_set("within", 6, anchors, sampling=Sampling.BALANCED, generator=np.random.default_rng(seed)).rows
        for seed in (0, 0, 1)
    ]
    assert np.array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[0], drawn[2])


def test_a_natural_set_holds_every_anchor_that_is_not_left_out() -> None:
    anchors = random_anchors(np.random.default_rng(3), 500)
    samples = sample_set("at", 9, anchors, sampling=Sampling.NATURAL, generator=np.random.default_rng(0))
    assert len(samples.rows) + samples.censored + samples.changed_already == 500
    assert samples.censored > 0


def test_one_vehicle_id_in_two_windows_is_two_vehicles() -> None:
    scenes = random_scenes(np.random.default_rng(4), 40)
    label, crossing = (lane_change_anchors(scenes, reading) for reading in Reading)
    keys = set(zip(scenes.recording.tolist(), scenes.vehicle[:, 0].tolist(), strict=True))
    assert len(set(label.vehicle.tolist())) == len(keys) == 10
    assert len(set(scenes.vehicle[:, 0].tolist())) == 5
    assert np.array_equal(label.change_time, scenes.change_label, equal_nan=True)
    assert np.array_equal(crossing.change_time, scenes.change_crossing, equal_nan=True)
