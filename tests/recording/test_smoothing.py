"""Cleaning: gaps, the filter, the derivatives, and what is reported of them."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from rampcast.errors import RecordingError
from rampcast.recording import Recording, clean
from rampcast.recording import columns as c
from rampcast.recording.smoothing import ORDER, WINDOW, derivative, smooth_tracks
from rampcast.sites import load_site

SITE = load_site("i80")


def recording_of(frames, x, *, y=None, vehicle=1, lane=6) -> Recording:
    size = len(frames)
    columns = {
        c.RECORDING: ["i80-1"] * size,
        c.VEHICLE: [vehicle] * size if np.isscalar(vehicle) else vehicle,
        c.FRAME: frames,
        c.X: x,
        c.Y: np.zeros(size) if y is None else y,
        c.LANE: [lane] * size if np.isscalar(lane) else lane,
        c.LENGTH: [4.5] * size,
        c.WIDTH: [1.8] * size,
        c.KIND: ["car"] * size,
    }
    return Recording(tracks=pl.DataFrame(columns, schema=c.SCHEMA), site=SITE, time_step=0.1, source="ngsim")


def scipy_one_track(values):
    window = min(WINDOW, len(values) if len(values) % 2 else len(values) - 1)
    return savgol_filter(values, window, ORDER, mode="interp")


@settings(max_examples=60, deadline=None)
@given(
    lengths=st.lists(st.integers(5, 70), min_size=1, max_size=8),
    seed=st.integers(0, 2**32 - 1),
)
def test_smoothing_the_concatenation_equals_scipy_on_every_track(lengths, seed):
    values = np.random.default_rng(seed).normal(size=sum(lengths)).cumsum() + 400.0
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)
    expected = np.concatenate([scipy_one_track(track) for track in np.split(values, starts[1:])])
    np.testing.assert_allclose(smooth_tracks(values, starts), expected, rtol=0, atol=1e-9)


def test_derivative_of_a_parabola_is_exact_to_the_edges_of_every_track():
    t = np.arange(12) * 0.1
    values = np.concatenate([3 * t**2 + t, -(t**2)])
    slope = derivative(values, np.array([0, 12]), time_step=0.1)
    np.testing.assert_allclose(slope, np.concatenate([6 * t + 1, -2 * t]), atol=1e-10)


def test_constant_acceleration_comes_out_as_speed_and_acceleration_in_si():
    t = np.arange(100) * 0.1
    smoothed, report = clean(recording_of(np.arange(100), 5 + 8 * t + 0.5 * 1.2 * t**2))
    tracks = smoothed.tracks
    assert smoothed.time_step == 0.2
    assert tracks[c.FRAME].to_list() == list(range(50))
    np.testing.assert_allclose(tracks[c.V], 8 + 1.2 * np.arange(50) * 0.2, atol=1e-8)
    np.testing.assert_allclose(tracks[c.A], 1.2, atol=1e-6)
    assert report.impossible_after == 0


def test_skipped_frames_are_filled_linearly_and_the_lane_comes_from_the_nearest_frame():
    frames = [0, 1, 2, 3, 4, 8, 9, 10, 11, 12]
    lanes = [7] * 5 + [6] * 5
    smoothed, report = clean(recording_of(frames, np.array(frames) * 1.0, lane=lanes))
    assert report.filled_rows == 3
    by_frame = dict(zip(smoothed.tracks[c.FRAME], smoothed.tracks.rows(named=True), strict=True))
    assert by_frame[3][c.LANE] == 7  # raw frame 6 lies as near to frame 4 as to frame 8: the earlier one counts
    assert by_frame[4][c.LANE] == 6
    assert not by_frame[3][c.OBSERVED]
    assert by_frame[3][c.X] == pytest.approx(6.0, abs=1e-9)


def test_a_hole_too_long_to_fill_is_left_open_and_counted():
    frames = [*range(30), *range(200, 230)]
    smoothed, report = clean(recording_of(frames, np.array(frames) * 0.5))
    assert report.open_gaps == 1
    assert report.filled_rows == 0
    assert smoothed.tracks.height == 30


def test_short_tracks_are_left_out_and_counted():
    both = recording_of([*range(30), *range(4)], [*range(30), *range(4)], vehicle=[1] * 30 + [2] * 4)
    smoothed, report = clean(both)
    assert (report.short_tracks, report.short_track_rows) == (1, 4)
    assert smoothed.tracks[c.VEHICLE].unique().to_list() == [1]


def test_duplicate_rows_are_dropped_and_counted():
    once = recording_of(np.arange(30), np.arange(30) * 1.0)
    twice = Recording(tracks=pl.concat([once.tracks, once.tracks[:7]]), site=SITE, time_step=0.1, source="ngsim")
    smoothed, report = clean(twice)
    assert report.duplicate_rows == 7
    assert smoothed.tracks.equals(clean(once)[0].tracks)


def test_cleaning_changes_nothing_of_its_input():
    recording = recording_of(np.arange(40), np.arange(40) * 1.0)
    before = recording.tracks.clone()
    clean(recording)
    assert recording.tracks.equals(before)


def test_a_smoothed_recording_is_refused():
    smoothed, _ = clean(recording_of(np.arange(40), np.arange(40) * 1.0))
    with pytest.raises(RecordingError, match="smoothed already"):
        clean(smoothed)


def test_frames_further_apart_than_the_sampling_are_refused_with_advice():
    recording = recording_of(np.arange(40), np.arange(40) * 1.0)
    sparse = Recording(tracks=recording.tracks, site=SITE, time_step=0.5, source="sumo")
    with pytest.raises(RecordingError, match=r"up to 0.2 s, got 0.5 s.*--step-length 0.1"):
        clean(sparse)


def test_smoothing_looks_ahead_twelve_raw_frames_and_no_further():
    """Half the filter's window and one frame for each derivative: 1.2 s at 10 Hz, as docs/methods.md says."""
    x = np.random.default_rng(0).normal(8, 1, 120).cumsum()
    whole, _ = clean(recording_of(np.arange(120), x))
    early, _ = clean(recording_of(np.arange(80), x[:80]))
    last_sure = (79 - (WINDOW // 2 + 2)) // 2  # in steps of 0.2 s
    for name in (c.X, c.V, c.A):
        one, other = whole.tracks[name].to_numpy(), early.tracks[name].to_numpy()
        np.testing.assert_allclose(one[: last_sure + 1], other[: last_sure + 1], atol=1e-9)
        assert abs(one[39] - other[39]) > 1e-6  # the state at the cut does know of what follows
