"""Odd frame rates: interpolated to 0.1 s before smoothing; rates that fit are left as they are."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.recording import clean
from rampcast.recording import columns as c
from rampcast.recording.resampling import resample
from tests.recording.test_smoothing import recording_of

ODD_STEPS = (1001 / 30000, 0.0333, 0.08, 0.125, 0.15, 1 / 24)  # 29.97, about 30, 12.5, 8, 6.7 and 24 Hz
FITTING_STEPS = (0.04, 0.05, 0.1, 0.2, 1 / 30, 1 / 60)


def drive(time_step, *, frames=None, duration=20.0):
    """Returns a recording of one vehicle of x = 5 + 8 t + 0.6 t^2, y = -2 + 0.1 t."""
    frames = np.arange(round(duration / time_step) + 1) if frames is None else frames
    t = np.asarray(frames) * time_step
    return replace(recording_of(frames, 5 + 8 * t + 0.6 * t**2, y=-2 + 0.1 * t), time_step=time_step)


@pytest.mark.parametrize("time_step", ODD_STEPS)
def test_position_speed_and_acceleration_of_an_odd_rate_are_the_true_ones(time_step):
    smoothed, report = clean(drive(time_step))
    t = smoothed.tracks[c.FRAME].to_numpy() * 0.2
    assert smoothed.time_step == 0.2
    assert t[0] == 0.0
    assert t[-1] == pytest.approx(20.0, abs=0.2)
    assert report.resampled_rows == pytest.approx(201, abs=1)
    chord = 1.2 * time_step**2 / 8  # [m] what a straight line between two frames leaves of the path
    np.testing.assert_allclose(smoothed.tracks[c.X], 5 + 8 * t + 0.6 * t**2, atol=chord + 1e-9)
    np.testing.assert_allclose(smoothed.tracks[c.Y], -2 + 0.1 * t, atol=1e-9)
    np.testing.assert_allclose(smoothed.tracks[c.V], 8 + 1.2 * t, atol=0.03)
    np.testing.assert_allclose(smoothed.tracks[c.A], 1.2, atol=0.35)
    assert abs(smoothed.tracks[c.A].mean() - 1.2) < 0.01


@pytest.mark.parametrize("time_step", FITTING_STEPS)
def test_a_rate_that_fits_is_not_resampled(time_step):
    smoothed, report = clean(drive(time_step))
    assert report.resampled_rows == 0
    t = smoothed.tracks[c.FRAME].to_numpy() * 0.2
    np.testing.assert_allclose(smoothed.tracks[c.X], 5 + 8 * t + 0.6 * t**2, atol=1e-8)


def test_rows_between_frames_are_interpolated_by_hand():
    # 12.5 Hz: frames at 0, 0.08, 0.16, 0.24, 0.32 s, x = 0, 8, 16, 24, 40 m. At 0.1 s: 8 + 8 * 0.02 / 0.08 = 10;
    # at 0.2 s: 16 + 8 * 0.04 / 0.08 = 20; at 0.3 s: 24 + 16 * 0.06 / 0.08 = 36. Lanes change at frame 3 (0.24 s).
    tracks = recording_of(np.arange(5), [0.0, 8.0, 16.0, 24.0, 40.0], lane=[6, 6, 6, 5, 5]).tracks
    tracks = tracks.with_columns(pl.Series(c.OBSERVED, [True, True, False, True, True]))
    even, starts = resample(tracks, np.array([0]), time_step=0.08)
    assert even[c.FRAME].to_list() == [0, 1, 2, 3]
    np.testing.assert_allclose(even[c.X], [0, 10, 20, 36], atol=1e-9)
    assert even[c.LANE].to_list() == [6, 6, 6, 5]  # 0.2 s is half-way: the earlier frame's
    assert even[c.OBSERVED].to_list() == [True, False, False, True]
    assert starts.tolist() == [0]


def test_every_track_is_resampled_by_itself():
    one, two = drive(0.08, duration=8.0), drive(0.08, frames=np.arange(30, 150))
    both = pl.concat([one.tracks, two.tracks.with_columns(pl.lit(2, pl.Int32).alias(c.VEHICLE))])
    together, report = clean(replace(one, tracks=both))
    alone = clean(one)[0].tracks, clean(two)[0].tracks
    for vehicle, expected in enumerate(alone, start=1):
        found = together.tracks.filter(pl.col(c.VEHICLE) == vehicle)
        assert found[c.FRAME].equals(expected[c.FRAME])
        for name in (c.X, c.V, c.A):
            np.testing.assert_allclose(found[name], expected[name], atol=1e-9)
    assert report.short_tracks == 0


def test_a_track_too_short_after_resampling_is_left_out_and_counted():
    long, short = drive(1 / 24), drive(1 / 24, frames=np.arange(1, 8))  # 7 frames are 0.25 s: 0.1, 0.2 s, two rows
    both = pl.concat([long.tracks, short.tracks.with_columns(pl.lit(2, pl.Int32).alias(c.VEHICLE))])
    smoothed, report = clean(replace(long, tracks=both))
    assert smoothed.tracks[c.VEHICLE].unique().to_list() == [1]
    assert report.short_tracks == 1


def test_only_short_tracks_of_an_odd_rate_are_an_error():
    with pytest.raises(RecordingError, match="no track"):
        clean(drive(1 / 24, frames=np.arange(1, 8)))


def test_skipped_frames_of_an_odd_rate_are_filled_and_not_called_observed():
    frames = np.delete(np.arange(126), np.arange(50, 60))
    smoothed, report = clean(drive(0.08, frames=frames))
    filled = smoothed.tracks.filter(~pl.col(c.OBSERVED))
    assert report.filled_rows == 10
    assert filled[c.FRAME].min() * 0.2 == pytest.approx(50 * 0.08, abs=0.2)
    assert filled[c.FRAME].max() * 0.2 == pytest.approx(59 * 0.08, abs=0.2)
