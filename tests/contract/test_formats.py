"""Every format: one simulated traffic written in it reads back the same, to the precision of the format."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RampcastError
from rampcast.formats import FORMATS, BadRows, read_any
from rampcast.formats.files.head import look
from rampcast.paper.scenes import build_scenes
from rampcast.recording import Recording, clean
from rampcast.recording import columns as c
from rampcast.simulate import shipped_sample
from tests.formats.writers import WRITERS

FRAMES = 600  # one minute of the simulated traffic is enough for every lane and kind
BEND = tuple((300.0 * np.sin(s / 300.0) - 1000.0, 50.0 + 300.0 * (1 - np.cos(s / 300.0))) for s in range(0, 504, 3))
PLACES = [(name, bent) for name, writer in WRITERS.items() for bent in (False, True) if writer.curved or not bent]


@pytest.fixture(scope="module")
def traffic() -> Recording:
    whole, _ = read_any(shipped_sample()[:1])
    tracks = whole.tracks.filter(pl.col(c.FRAME).is_between(1000, 1000 + FRAMES))
    kinds = pl.col(c.VEHICLE).mod(5).replace_strict({0: "motorcycle", 1: "truck"}, default="car").cast(c.SCHEMA[c.KIND])
    return replace(whole, tracks=tracks.with_columns(kinds.alias(c.KIND)))


@pytest.fixture(scope="module", params=PLACES, ids=[f"{name}{' on a bend' * bent}" for name, bent in PLACES])
def written(request, traffic, tmp_path_factory):
    """Gives the format's name, the recording that was written, the site to read it with, and the files."""
    name, bent = request.param
    site = replace(traffic.site, reference=BEND) if bent else traffic.site
    recording = replace(traffic, site=site)
    paths = WRITERS[name].write(recording, tmp_path_factory.mktemp(name))
    return name, recording, WRITERS[name].site_of(site), paths


def test_every_format_has_a_writer():
    assert set(WRITERS) == set(FORMATS) - {"rampcast"}


def test_the_format_is_told_by_content_and_by_no_other_reader(written):
    name, _, _, paths = written
    claimed = [entry.name for entry in FORMATS.values() if entry.needs.misses(look(paths[0])) is None]
    assert claimed == [name]


def test_a_recording_reads_back_equal(written):
    name, recording, site, paths = written
    writer = WRITERS[name]
    again, report = read_any(paths, site=site, bad_rows=BadRows.RAISE)
    moment = pl.col(c.FRAME) * again.time_step
    ours = recording.tracks.with_columns(moment=(pl.col(c.FRAME) * recording.time_step).round(3))
    both = ours.join(again.tracks.with_columns(moment=moment.round(3)), on=[c.VEHICLE, "moment"], suffix="_again")
    assert again.tracks.height == both.height == recording.tracks.height == report.rows
    for column, precision in ((c.X, writer.x), (c.Y, writer.y), (c.LENGTH, writer.size), (c.WIDTH, writer.size)):
        if column not in writer.without:
            off = (both[column].cast(pl.Float64) - both[f"{column}_again"].cast(pl.Float64)).abs().max()
            assert off <= precision + 1e-5, column
    if c.KIND not in writer.without:
        kinds = both[c.KIND].cast(pl.String).replace(dict(writer.kinds))
        assert both[f"{c.KIND}_again"].cast(pl.String).equals(kinds)
    assert both[f"{c.LANE}_again"].equals(_lanes_by_place(both, recording) if writer.lanes_by_place else both[c.LANE])
    assert report.rows_off_road == report.duplicates == report.rows_skipped == 0


def _lanes_by_place(both: pl.DataFrame, recording: Recording) -> pl.Series:
    """Returns the lane whose centre is nearest to where a vehicle was read to be, by a plain loop."""
    lanes = recording.site.lanes
    numbers = [min(lanes, key=lambda lane: abs(lane.centre - y)).number for y in both[f"{c.Y}_again"]]
    return pl.Series(f"{c.LANE}_again", numbers, dtype=pl.Int16)


@pytest.mark.slow
def test_everything_downstream_runs(written):
    _, recording, site, paths = written
    scenes = build_scenes(clean(read_any(paths, site=site)[0])[0], every=5.0)
    ours = build_scenes(clean(recording)[0], every=5.0)
    assert len(scenes) > 0.8 * len(ours) > 0


@pytest.mark.slow
def test_bytes_lost_in_the_middle_are_an_error_that_names_the_file(written):
    name, _, site, paths = written
    content = paths[0].read_bytes()
    cut = paths[0].with_name(paths[0].name)
    cut.write_bytes(content[: len(content) // 2 - 1])
    try:
        with pytest.raises(RampcastError, match=paths[0].name):
            read_any(paths, site=site, format=name)
    finally:
        cut.write_bytes(content)
