"""Minutes of the test window are taken out of the training windows, by the clock that rows were recorded with."""

from dataclasses import replace

import polars as pl

from rampcast.paper.shared_time import without_shared_time
from rampcast.recording import clean, concatenate
from rampcast.recording import columns as c
from tests.made_up_traffic import random_traffic

TEST_BEGAN = 5000.0  # [s]


def window(name, began):
    raw = random_traffic(3, vehicles=20, name=name)
    return clean(replace(raw, began={} if began is None else {name: began}))[0]


def times(recording):
    """Returns when each row was recorded [s]."""
    began = pl.col(c.RECORDING).replace_strict(dict(recording.began), return_dtype=pl.Float64)
    return recording.tracks.select(began + pl.col(c.FRAME) * recording.time_step).to_series()


def test_rows_recorded_while_the_test_window_was_are_left_out_raw_and_smoothed():
    """The window that begins 20 s later shares its beginning with the test; the one an hour before shares nothing."""
    test = window("i80-2", TEST_BEGAN)
    first, third = window("i80-1", TEST_BEGAN - 3600.0), window("i80-3", TEST_BEGAN + 20.0)
    kept = without_shared_time(concatenate([first, third]), test)
    assert kept.window("i80-1").tracks.equals(first.tracks)
    left = times(third) <= times(test).max()
    assert 0 < left.sum() < len(left)
    assert kept.window("i80-3").tracks.equals(third.tracks.filter(~left))
    left_raw = times(third.raw) <= times(test).max()
    assert kept.raw.window("i80-3").tracks.equals(third.raw.tracks.filter(~left_raw))


def test_windows_whose_clock_is_not_known_stay_whole():
    known, unknown = window("i80-2", TEST_BEGAN), window("i80-3", None)
    assert without_shared_time(unknown, known).tracks.equals(unknown.tracks)
    assert without_shared_time(window("i80-3", TEST_BEGAN), window("i80-2", None)).tracks.height == known.tracks.height
