"""Traffic of a moment: from the past alone, the same of a recording and of a stream, bit for bit."""

from dataclasses import fields, replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.errors import RecordingError
from rampcast.recording import Recording, clean
from rampcast.recording import columns as c
from rampcast.sites import load_site
from rampcast.traffic.moments import moments, traffic
from rampcast.traffic.stream import Stream

SITE = load_site("simulated")
NAMES = (c.VEHICLE, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH, c.KIND)


def _recording(*, vehicles=6, seconds=9.0, time_step=0.1, seed=1, lost=0.0):
    generator = np.random.default_rng(seed)
    frames = np.arange(round(seconds / time_step) + 1)
    rows = []
    for vehicle in range(vehicles):
        seen = frames[generator.random(len(frames)) >= lost]
        time = seen * time_step
        x = 40.0 * vehicle + (8 + vehicle) * time + np.sin(time + vehicle) + 0.05 * generator.normal(size=len(time))
        rows.append(
            pl.DataFrame(
                {
                    c.RECORDING: ["made"] * len(seen),
                    c.VEHICLE: [vehicle + 1] * len(seen),
                    c.FRAME: seen,
                    c.X: x,
                    c.Y: np.full(len(seen), 1.5) + 0.02 * generator.normal(size=len(seen)),
                    c.LANE: [SITE.target_lane if vehicle % 2 else SITE.ramp_lanes[0]] * len(seen),
                    c.LENGTH: [4.57] * len(seen),
                    c.WIDTH: [1.83] * len(seen),
                    c.KIND: ["car"] * len(seen),
                },
                schema=c.SCHEMA,
            )
        )
    return Recording(pl.concat(rows).sort(c.RECORDING, c.VEHICLE, c.FRAME), SITE, time_step, "made up")


def _frames(recording, until):
    early = pl.col(c.FRAME) * recording.time_step <= until + 1e-9
    rows = recording.tracks.filter(early).sort(c.FRAME, maintain_order=True)
    for (frame,), part in rows.group_by(c.FRAME, maintain_order=True):
        yield frame * recording.time_step, {name: part[name].to_list() for name in NAMES}


def _same(one, other):
    for field in fields(one):
        left, right = getattr(one, field.name), getattr(other, field.name)
        if isinstance(left, np.ndarray):
            assert np.array_equal(left, right, equal_nan=left.dtype.kind == "f"), field.name
        else:
            assert left == right, field.name


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    time_step=st.sampled_from([0.2, 0.1, 0.08, 0.04, 1 / 30]),
    lost=st.sampled_from([0.0, 0.2]),
    shuffle=st.integers(0, 4),
)
def test_a_stream_gives_the_same_traffic_as_the_recording_bit_for_bit(seed, time_step, lost, shuffle):
    recording = _recording(seed=seed, time_step=time_step, lost=lost)
    frames = list(_frames(recording, 7.0))
    generator = np.random.default_rng(seed)
    if shuffle:  # frames come up to so many places late, and some come twice
        order = np.argsort(np.arange(len(frames)) + generator.uniform(0, shuffle, len(frames)), kind="stable")
        frames = [frames[place] for place in order] + [frames[-1]]
    stream = Stream(SITE)
    for time, frame in frames:
        found = stream.push(time, frame)
    _same(found, traffic(recording, at=found.t0))


def test_what_comes_after_t0_changes_nothing_at_all():
    recording = _recording(lost=0.1)
    future = pl.col(c.FRAME) * recording.time_step > 6.0 + 1e-9
    wild = recording.tracks.with_columns(
        pl.when(future).then(pl.col(c.X) * -7.0 + 1e4).otherwise(pl.col(c.X)).alias(c.X),
        pl.when(future).then(99.0).otherwise(pl.col(c.Y)).alias(c.Y),
        pl.when(future).then(1).otherwise(pl.col(c.LANE)).cast(pl.Int16).alias(c.LANE),
    )
    for other in (wild, recording.tracks.filter(~future)):
        _same(traffic(replace(recording, tracks=other), at=6.0), traffic(recording, at=6.0))


def test_moments_are_the_traffic_at_each_of_them():
    recording = _recording()
    found = list(moments(recording, every=0.5))
    assert [one.t0 for one in found] == pytest.approx(np.arange(4.0, 9.01, 0.5))
    for one in found:
        _same(one, traffic(recording, at=one.t0))


def test_states_are_near_those_of_smoothing_that_looks_ahead():
    recording = _recording(seconds=12.0)
    smoothed, _ = clean(recording)
    at = smoothed.tracks.filter(pl.col(c.FRAME) == round(8.0 / 0.2)).sort(c.VEHICLE)
    found = traffic(recording, at=8.0)
    np.testing.assert_allclose(found.x[:, -1], at[c.X].to_numpy(), atol=0.15)
    np.testing.assert_allclose(found.v[:, -1], at[c.V].to_numpy(), atol=0.6)


def test_who_has_left_is_known_for_four_seconds_and_who_comes_in_at_once():
    recording = _recording(vehicles=2)
    some = recording.tracks.filter(~((pl.col(c.VEHICLE) == 1) & (pl.col(c.FRAME) > 49)))
    some = some.filter(~((pl.col(c.VEHICLE) == 2) & (pl.col(c.FRAME) < 50)))
    short = replace(recording, tracks=some)
    found = traffic(short, at=5.4)
    assert found.vehicle.tolist() == [1, 2]
    np.testing.assert_allclose(found.age, [0.5, 0.0], atol=1e-9)
    assert found.valid[1].sum() == 3
    assert traffic(short, at=9.0).vehicle.tolist() == [2]


def test_lanes_that_a_frame_does_not_tell_come_from_the_place():
    stream = Stream(SITE)
    lanes = SITE.lanes[:2]
    found = stream.push(0.0, {"vehicle": ["a", "b"], "x": [100.0, 120.0], "y": [lane.centre for lane in lanes]})
    assert found.lane.tolist() == [lane.number for lane in lanes]
    assert stream.push(0.1, {"vehicle": ["c"], "x": [90.0], "y": [np.nan]}).lane.tolist()[-1] == 0


def test_an_empty_frame_is_no_error_and_late_old_and_repeated_rows_are_counted():
    stream = Stream(SITE)
    assert len(stream.push(0.0, {"vehicle": [], "x": [], "y": []})) == 0
    frame = {"vehicle": [7], "x": [100.0], "y": [1.0]}
    for time in (10.0, 10.1, 10.05, 10.1, 2.0):
        stream.push(time, frame)
    assert (stream.counts.frames, stream.counts.rows) == (6, 3)
    assert (stream.counts.late_frames, stream.counts.repeated_rows, stream.counts.old_rows) == (2, 1, 1)


@pytest.mark.parametrize(
    ("time", "frame", "said"),
    [
        (np.nan, {"vehicle": [1], "x": [1.0], "y": [1.0]}, "finite number of seconds"),
        (1.0, {"vehicle": [1], "x": [1.0]}, "lacks y"),
        (1.0, {"vehicle": [1, 2], "x": [1.0], "y": [1.0]}, "2 vehicles, but 'x'"),
        (1.0, {"vehicle": [1], "x": [np.inf], "y": [1.0]}, "vehicle .*1.*: x is inf"),
        (1.0, {"vehicle": [1], "x": ["far"], "y": [1.0]}, "numbers in 'x', got .*far"),
        (1.0, {"vehicle": [[1]], "x": [1.0], "y": [1.0]}, "'vehicle'"),
        (1.0, {"vehicle": [1.5], "x": [1.0], "y": [1.0]}, "whole numbers or texts"),
        (1.0, {"vehicle": [1], "x": [1.0], "y": [1.0], "kind": ["boat"]}, "kind 'boat'"),
        (1.0, [1, 2], "columns by name"),
    ],
)
def test_a_frame_that_is_none_gets_a_sentence(time, frame, said):
    with pytest.raises(RecordingError, match=said):
        Stream(SITE).push(time, frame)


def test_smoothed_recordings_and_several_windows_are_told_apart():
    recording = _recording()
    with pytest.raises(RecordingError, match="knows what comes"):
        traffic(clean(recording)[0], at=5.0)
    two = pl.concat([recording.tracks, recording.tracks.with_columns(pl.lit("other").alias(c.RECORDING))])
    with pytest.raises(RecordingError, match='window="made"'):
        traffic(replace(recording, tracks=two), at=5.0)
    assert len(traffic(replace(recording, tracks=two), at=5.0, window="other")) == 6
