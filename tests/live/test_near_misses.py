"""Conflicts of merges in a recording, as the timeline marks them."""

import polars as pl
import pytest

from rampcast.live.near_misses import near_misses
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import load_site


def recording(gap: float, speeds: tuple[float, float]) -> Recording:
    """Returns a vehicle that merges after 2 s, `gap` metres ahead of one that drives in the target lane."""
    rows = []
    for frame in range(60):
        t = 0.1 * frame
        rows.append((1, frame, 150.0 + speeds[0] * t, 6 if frame >= 20 else 7))
        rows.append((2, frame, 150.0 + speeds[0] * 2.0 - 4.5 - gap + speeds[1] * (t - 2.0), 6))
    told = {c.RECORDING: "w", c.Y: -20.0, c.LENGTH: 4.5, c.WIDTH: 1.8, c.KIND: "car"}
    table = pl.DataFrame(rows, schema=[c.VEHICLE, c.FRAME, c.X, c.LANE], orient="row")
    table = table.with_columns(pl.lit(value).alias(name) for name, value in told.items())
    tracks = table.select(pl.col(name).cast(kind) for name, kind in c.SCHEMA.items()).sort(c.VEHICLE, c.FRAME)
    return Recording(tracks, load_site("simulated"), 0.1, "t")


def test_a_vehicle_that_merges_before_a_faster_one_is_marked_when_3_seconds_are_left():
    (found,) = near_misses(recording(40.0, (10.0, 20.0)))  # 10 m/s nearer: below 30 m after 1 s
    assert (found["id"], found["with"]) == (1, 2)
    assert found["t_obs_ms"] == pytest.approx(3_000.0, abs=100.0)


def test_a_merge_before_one_as_fast_is_no_conflict_however_near():
    assert near_misses(recording(3.0, (10.0, 10.0))) == []


def test_what_comes_long_after_a_merge_is_none_of_it():
    assert near_misses(recording(200.0, (10.0, 20.0))) == []
