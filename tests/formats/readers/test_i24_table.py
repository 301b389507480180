"""All vehicles of I-24 MOTION at once are as one by one, at the frames of their recording."""

from itertools import pairwise

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from rampcast.formats.readers.i24 import table as i24_table
from rampcast.formats.readers.i24.table import clock_of_rows, sampled_rows
from rampcast.formats.readers.i24.tracks import HOLE, KINDS, ON_FRAME, ROADS, clock_of_times, day_of
from rampcast.formats.steps.units import FOOT
from rampcast.formats.steps.vehicles import TYPICAL_SIZES, with_sizes
from rampcast.recording import columns as c
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, ROAD, SOURCE_LANE


def made_up(rng):
    """Returns six vehicles whose times jitter by up to half a step, with holes, blank speeds and sizes of zero."""
    parts = []
    for number in range(1, 7):
        kept = np.flatnonzero((rng.random(200) < 0.9) & (np.arange(200) % 60 > 8))
        jitter = rng.uniform(-0.4, 0.4, len(kept)) * (rng.random(len(kept)) < 0.5)
        parts.append(
            pl.DataFrame(
                {"time": 1_669_125_200.0 + 0.04 * (kept + jitter + 10 * number), "x": 1.2 * kept}
            ).with_columns(
                id=pl.lit(f"v{number}", pl.Categorical()),
                number=pl.lit(number, pl.Int32()),
                y=pl.Series(rng.normal(-3.0 if number % 2 else 0.1, 1.0, len(kept))),
                v=pl.Series(np.where(rng.random(len(kept)) < 0.1, np.nan, 30.0), nan_to_null=True),
                a=pl.lit(None, pl.Float64()),
                lane=pl.Series(rng.integers(0, 4, len(kept)), dtype=pl.Int16()),
                length=pl.lit(15.0 * (number % 3)),
                width=pl.lit(6.0),
                direction=pl.lit(-1 if number < 4 else 1, pl.Int8()),
                **{"class": pl.lit(number - 1, pl.Int8())},
            )
        )
    return pl.concat(parts)


def frames_of(place):
    """Returns the frames at which a vehicle is seen, or between two moments that are not too far apart."""
    frames = {round(one) for one in place if abs(one - round(one)) <= ON_FRAME}
    for before, after in pairwise(place):
        if after - before <= HOLE:
            frames.update(range(int(np.ceil(before - ON_FRAME)), int(np.floor(after + ON_FRAME)) + 1))
    return np.array(sorted(frames))


def one_by_one(vehicle, clock):
    """Returns the rows of one vehicle in the plane, and how many of them lie between two times of the source."""
    first = vehicle.row(0, named=True)
    place = (vehicle["time"].to_numpy() - clock.start) / clock.step
    frames = frames_of(place)
    distance = np.abs(place[:, None] - frames)
    nearest = distance.argmin(axis=0)
    kind, direction = KINDS[first["class"]], first["direction"]
    length = first["length"] * FOOT or TYPICAL_SIZES[kind][0]
    y = vehicle["y"].to_numpy()
    right = y if np.median(y) >= 0 else -y
    lanes = [str(lane) if lane else None for lane in vehicle["lane"].to_numpy()[nearest].tolist()]
    columns = {
        c.RECORDING: day_of(clock),
        ROAD: ROADS[direction],
        c.VEHICLE: first["number"],
        c.FRAME: frames,
        PX: np.interp(frames, place, vehicle["x"].to_numpy() + direction * length),
        PY: np.interp(frames, place, right) * -direction,
        SOURCE_LANE: lanes,
        c.LENGTH: first["length"] * FOOT or None,
        c.WIDTH: first["width"] * FOOT,
        c.KIND: kind,
        c.RECORDED_V: pl.Series(np.interp(frames, place, vehicle["v"].to_numpy()), nan_to_null=True),
        c.RECORDED_A: None,
    }
    size = {name: value for name, value in columns.items() if not isinstance(value, np.ndarray | pl.Series | list)}
    rows = pl.DataFrame({name: value for name, value in columns.items() if name not in size})
    rows = rows.with_columns(pl.lit(value).alias(name) for name, value in size.items())
    between = int((distance.min(axis=0) > ON_FRAME).sum())
    return rows.select(PLANE_SCHEMA.keys()).cast(dict(PLANE_SCHEMA)), between


@pytest.mark.parametrize("block", [100, 1 << 15])
def test_all_vehicles_at_once_are_as_one_by_one(block, monkeypatch):
    monkeypatch.setattr(i24_table, "BLOCK", block)
    table = made_up(np.random.default_rng(1))
    vehicles = table.partition_by("number", maintain_order=True)
    clock = clock_of_rows(table)
    assert clock == clock_of_times(max(vehicles, key=len)["time"].to_numpy())
    plain = [one_by_one(vehicle, clock) for vehicle in vehicles]
    rows, filled = with_sizes(pl.concat([rows for rows, _ in plain]))
    sampled, found = sampled_rows(table, clock)
    assert_frame_equal(sampled, rows, abs_tol=1e-9, rel_tol=1e-12)
    assert found.rows_interpolated == sum(between for _, between in plain) > 100
    assert found.rows_off_frames == table.height - (rows.height - found.rows_interpolated) > 100
    assert found.sizes_filled == filled > 0
