"""The neighbour search against a slow one that is obviously right."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.recording import clean
from rampcast.traffic.neighbours import NONE, find_neighbours, on_ramp_vehicles
from tests.made_up_traffic import random_traffic


def slow_neighbours(recording, row):
    """Looks at every vehicle of the frame, one by one."""
    rows = recording.tracks.rows(named=True)
    me = rows[row]
    here = [
        (other["x"], number)
        for number, other in enumerate(rows)
        if other["recording"] == me["recording"] and other["frame"] == me["frame"] and number != row
    ]
    lane = {number: rows[number]["lane"] for _, number in here}
    target = recording.site.target_lane

    def pick(where, ahead):
        found = sorted(
            ((x, n) for x, n in here if lane[n] == where and (x >= me["x"] if ahead else x < me["x"])),
            reverse=not ahead,
        )
        return [n for _, n in found] + [NONE, NONE]

    return [
        pick(me["lane"], True)[0],
        pick(me["lane"], False)[0],
        *pick(target, True)[:2],
        *pick(target, False)[:2],
    ]


@pytest.mark.parametrize("seed", range(4))
def test_fast_neighbours_equal_the_slow_ones_before_and_after_the_lane_change(seed):
    recording, _ = clean(random_traffic(seed, vehicles=14, seconds=20))
    rng = np.random.default_rng(seed)
    rows = np.sort(rng.choice(recording.tracks.height, size=60, replace=False))
    expected = [slow_neighbours(recording, int(row)) for row in rows]
    np.testing.assert_array_equal(find_neighbours(recording, rows), expected)


def test_on_ramp_vehicles_are_those_with_a_row_in_a_ramp_lane():
    recording, _ = clean(random_traffic(3))
    rows = recording.tracks
    crossing = rows["vehicle"].max()  # begins and ends in another lane
    rows = rows.with_columns(
        lane=pl.when((pl.col("vehicle") == crossing) & (pl.col("frame") % 50 == 0)).then(7).otherwise(pl.col("lane"))
    )
    recording = replace(recording, tracks=rows.cast({"lane": pl.Int16}))
    expected = sorted(rows.filter(rows["lane"] == 7)["vehicle"].unique().to_list())
    assert on_ramp_vehicles(recording)["vehicle"].to_list() == expected
    assert len(expected) > 3
