import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from rampcast.formats.readers.i24 import table as i24_table
from rampcast.formats.readers.i24.stream import plane_rows
from rampcast.formats.readers.i24.table import sampled_rows
from rampcast.formats.readers.i24.tracks import FOOT, KINDS, Track, clock_of, sampled
from rampcast.recording import columns as c


def table_of(rng):
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


def track_of(rows):
    first, y = rows.row(0, named=True), rows["y"].to_numpy()
    return Track(
        id=first["id"],
        time=rows["time"].to_numpy(),
        x=rows["x"].to_numpy(),
        right=y if np.median(y) >= 0 else -y,
        direction=first["direction"],
        length=first["length"] * FOOT or np.nan,
        width=first["width"] * FOOT,
        kind=KINDS[first["class"]],
        lane=rows["lane"].to_numpy(),
        extra={c.RECORDED_V: rows["v"].to_numpy(), c.RECORDED_A: rows["a"].to_numpy()},
    )


@pytest.mark.parametrize("block", [100, 1 << 15])
def test_all_vehicles_at_once_are_as_one_by_one(block, monkeypatch):
    monkeypatch.setattr(i24_table, "BLOCK", block)
    table = table_of(np.random.default_rng(1))
    tracks = [track_of(part) for part in table.partition_by("number", maintain_order=True)]
    clock = clock_of(tracks)
    vehicles = [sampled(track, clock) for track in tracks]
    found = sampled_rows(table)
    assert found.clock == clock
    assert found.names == tuple(f"v{number}" for number in range(1, 7))
    assert_frame_equal(found.rows, plane_rows(vehicles, clock, first=1), check_exact=True)
    assert found.interpolated == sum(one.between for one in vehicles) > 100
    assert found.off_frames == sum(one.off for one in vehicles) > 100
