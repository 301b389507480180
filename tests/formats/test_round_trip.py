"""A recording written in each of NGSIM's forms reads back equal, to the precision of the form."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from rampcast.formats import read_any
from rampcast.recording import Recording, concatenate
from rampcast.recording import columns as c
from tests import ngsim_writer
from tests.made_up_traffic import random_traffic

PLACE = 0.001 * 0.3048 / 2 * 1.001  # [m] positions are written with three decimals of a foot
SIZE = 0.1 * 0.3048 / 2 * 1.001  # [m] lengths and widths with one


@pytest.fixture(scope="module")
def traffic() -> Recording:
    parts = [random_traffic(seed, vehicles=12, name=f"i80-{seed}") for seed in (1, 2, 3)]
    joined = concatenate(parts)
    kinds = pl.col(c.VEHICLE).mod(3).replace_strict({0: "motorcycle", 1: "car", 2: "truck"}).cast(c.SCHEMA[c.KIND])
    return replace(joined, tracks=joined.tracks.with_columns(kinds.alias(c.KIND)))


def zipped(write: Callable[[Recording, Path], list[Path]]) -> Callable[[Recording, Path], list[Path]]:
    return lambda recording, folder: [ngsim_writer.zipped(path) for path in write(recording, folder)]


def gzipped(write: Callable[[Recording, Path], list[Path]]) -> Callable[[Recording, Path], list[Path]]:
    return lambda recording, folder: [ngsim_writer.gzipped(path) for path in write(recording, folder)]


def portal(recording: Recording, folder: Path) -> list[Path]:
    return [ngsim_writer.write_portal_csv(recording, folder / "portal.csv")]


def portal_cut(recording: Recording, folder: Path) -> list[Path]:
    return [ngsim_writer.write_portal_cut_csv(recording, folder / "portal.csv")]


WRITERS = {
    "text": ngsim_writer.write_ngsim_txt,
    "text in zip": zipped(ngsim_writer.write_ngsim_txt),
    "text in gz": gzipped(ngsim_writer.write_ngsim_txt),
    "csv": ngsim_writer.write_site_csv,
    "csv in zip": zipped(ngsim_writer.write_site_csv),
    "portal": portal,
    "portal's 19 columns": portal_cut,
    "portal in gz": gzipped(portal),
}


@pytest.mark.parametrize("form", WRITERS)
def test_a_recording_reads_back_equal(form, traffic, tmp_path):
    paths = WRITERS[form](traffic, tmp_path)
    again, report = read_any(paths)
    same = [c.RECORDING, c.VEHICLE, c.FRAME, c.LANE, c.KIND]
    assert again.tracks.select(same).equals(traffic.tracks.select(same))
    assert (again.site, again.time_step) == (traffic.site, traffic.time_step)
    for name, precision in ((c.X, PLACE), (c.Y, PLACE), (c.LENGTH, SIZE), (c.WIDTH, SIZE)):
        off = (again.tracks[name].cast(pl.Float64) - traffic.tracks[name].cast(pl.Float64)).abs().max()
        assert off <= precision + 1e-6, name
    assert (report.duplicates, report.rows_outside_windows, report.clock_slips) == (0, 0, 0)


def test_the_same_windows_given_twice_are_read_once(traffic, tmp_path):
    paths = [*ngsim_writer.write_ngsim_txt(traffic, tmp_path), *ngsim_writer.write_site_csv(traffic, tmp_path)]
    again, report = read_any(paths)
    assert again.tracks.height == traffic.tracks.height
    assert (report.duplicates, report.conflicting_duplicates) == (traffic.tracks.height, 0)
