"""The measures of realism find what was put in."""

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.simulate.realism import CELL_LENGTH, CELL_TIME, realism, space_time, wave_speed
from rampcast.sites import load_site


@pytest.mark.parametrize("speed", [3.0, 5.0, 7.0, -8.0])
def test_the_speed_of_a_wave_that_was_put_in_is_found(speed: float) -> None:
    time, place = np.arange(0, 900, CELL_TIME)[:, None], np.arange(0, 500, CELL_LENGTH)[None, :]
    moments = np.arange(-300.0, 1300.0, 15.0)
    drawn = np.random.default_rng(0).uniform(3, 13, len(moments))
    speeds = np.interp(time + place / speed, moments, drawn)
    assert wave_speed(speeds) == pytest.approx(speed, rel=0.1)


def recording_of(x: np.ndarray, lane: np.ndarray) -> Recording:
    tracks = pl.DataFrame(
        {
            c.RECORDING: "simulated-1",
            c.VEHICLE: 1,
            c.FRAME: np.arange(len(x)),
            c.X: x,
            c.Y: 0.0,
            c.LANE: lane,
            c.LENGTH: 4.5,
            c.WIDTH: 1.8,
            c.KIND: "car",
        }
    ).cast(c.SCHEMA)  # type: ignore[arg-type]
    return Recording(tracks=tracks, site=load_site("simulated"), time_step=0.1, source="simulated")


def value(table: pl.DataFrame, measure: str) -> float:
    return float(table.filter(pl.col("measure") == measure)["value"].item())


def test_merge_place_speed_and_braking_of_one_vehicle_are_measured() -> None:
    # From 0 to 500 m at 10 m/s, to the target lane at 160 m: half of the way from the gore, 118 m, to 202 m.
    x = np.arange(0, 500, 1.0)
    table = realism(recording_of(x, np.where(x <= 160, 7, 6)))
    assert value(table, "merge place, 50 %") == pytest.approx(0.5)
    assert value(table, "mean speed in the target lane") == pytest.approx(10.0)
    assert value(table, "vehicles braking harder than 6 m/s^2") == 0.0


def test_hard_braking_is_found() -> None:
    time = np.arange(0, 60, 0.1)
    x = np.where(time < 15, 20 * time, 300 + 20 * (time - 15) - 4 * (time - 15) ** 2)
    x = np.where(time < 17.5, x, 325 + 4.0 * (time - 17.5))
    table = realism(recording_of(x, np.where(x <= 160, 7, 6)))
    assert value(table, "vehicles braking harder than 6 m/s^2") == 1.0


def test_a_recording_without_merges_is_refused() -> None:
    x = np.arange(0, 500, 1.0)
    with pytest.raises(RecordingError, match="no vehicle changes from the ramp to lane 6"):
        realism(recording_of(x, np.full(len(x), 6)))


def test_the_space_time_diagram_has_the_speed_of_each_cell() -> None:
    x = np.arange(0, 500, 1.0)
    speeds = space_time(recording_of(x, np.full(len(x), 6)), lane=6)
    assert speeds.shape == (25, 25)
    np.testing.assert_allclose(speeds, 10.0)
