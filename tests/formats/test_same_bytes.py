"""The same files and sites whatever the order of rows, the company and the number of threads."""

from pathlib import Path

import polars as pl
import pytest

from rampcast.formats import convert_all, read_any
from rampcast.recording import columns as c
from rampcast.sites import write_site
from rampcast.threads import choosing_threads
from tests.made_up_traffic import random_traffic


def table() -> pl.DataFrame:
    rows = random_traffic(3, vehicles=12).tracks
    time = (pl.col(c.FRAME) * 0.1).round(1).alias("time")
    return rows.select(c.VEHICLE, time, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH)


def converted(rows: pl.DataFrame, folder: Path) -> bytes:
    folder.mkdir()
    rows.write_csv(folder / "table.csv")
    (written,), _ = convert_all([folder / "table.csv"], folder / "x.parquet")
    recording, _ = read_any([folder / "table.csv"])
    write_site(recording.site, folder / "x.toml")
    return written.read_bytes() + (folder / "x.toml").read_bytes()


def test_the_order_of_rows_changes_no_byte(tmp_path):
    rows = table()
    first = converted(rows, tmp_path / "1")
    assert converted(rows, tmp_path / "2") == first
    assert converted(rows.sample(fraction=1.0, shuffle=True, seed=1), tmp_path / "3") == first
    assert converted(rows.with_columns(pl.col(c.X) + 0.01), tmp_path / "4") != first


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_number_of_threads_changes_no_byte(threads, tmp_path):
    with choosing_threads(threads):
        found = converted(table(), tmp_path / "1")
    assert found == converted(table(), tmp_path / "2")


def test_company_changes_no_rows(tmp_path):
    """A table beside another of its place is read as it is alone, but for the name of its part."""
    rows = table()
    rows.write_csv(tmp_path / "a.csv")
    rows.filter(pl.col(c.VEHICLE) > 4).write_csv(tmp_path / "b.csv")
    site = read_any([tmp_path / "a.csv"])[0].site
    alone, _ = read_any([tmp_path / "a.csv"], site=site)
    both, _ = read_any([tmp_path / "b.csv", tmp_path / "a.csv"], site=site)
    part = next(name for name in both.names if name.endswith("a"))
    assert both.window(part).tracks.drop(c.RECORDING).equals(alone.tracks.drop(c.RECORDING))
