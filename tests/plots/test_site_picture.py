"""The picture of a site: what it names, with and without a ramp, along the road and in the plane of the source."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure

from rampcast.plots.site_picture import site_picture, write_site_picture
from rampcast.recording import Recording, read_recording
from rampcast.recording import columns as c
from rampcast.roads.ramp import without_ramp
from rampcast.simulate import shipped_sample
from tests.plots.looking import assert_readable, texts

BEND = tuple((300.0 * np.sin(s / 300.0) + 1000.0, 300.0 * (1 - np.cos(s / 300.0))) for s in range(0, 504, 3))


@pytest.fixture(scope="module")
def recording() -> Recording:
    whole = read_recording(shipped_sample()[0])
    return replace(whole, tracks=whole.tracks.filter(pl.col(c.FRAME) < 1500))


def words(figure: Figure) -> set[str]:
    return {text.get_text().strip() for text in texts(figure.axes[0])}


def test_the_lanes_the_ramp_and_the_number_of_vehicles_are_named(recording):
    figure = site_picture(recording)
    assert len(figure.axes) == 1
    assert {"gore 118 m", "ramp ends 230 m", "6  target lane", "7  on-ramp"} <= words(figure)
    assert any("vehicles, simulated, coloured by lane" in text for text in words(figure))
    assert_readable(figure.axes[0])


def test_a_source_in_a_plane_is_drawn_there_as_well(recording):
    figure = site_picture(replace(recording, site=replace(recording.site, reference=BEND)))
    road, plane = figure.axes
    assert {"gore", "ramp ends", "x = 0"} <= words(figure)
    width, height = plane.bbox.width, plane.bbox.height
    assert np.ptp(plane.get_xlim()) / width == pytest.approx(np.ptp(plane.get_ylim()) / height)  # one scale
    for x, y in BEND:
        assert plane.get_xlim()[0] < x < plane.get_xlim()[1]
        assert plane.get_ylim()[0] < y < plane.get_ylim()[1]
    assert_readable(road)


def test_a_site_without_a_ramp_shows_its_lanes(recording):
    figure = site_picture(replace(recording, site=without_ramp(recording.site)))
    assert {"1", "6", "7"} <= words(figure)
    assert not any("gore" in text for text in words(figure))
    assert_readable(figure.axes[0])


def test_a_ramp_lane_that_goes_on_is_named_so_and_has_no_end(recording):
    site = replace(recording.site, ramp_end=np.inf, merge_zone=(np.nan, np.nan), reference=BEND)
    figure = site_picture(replace(recording, site=site))
    assert {"gore 118 m", "ramp lane goes on"} <= words(figure)
    assert not any("merge zone" in text or "ramp ends" in text for text in words(figure))
    assert_readable(figure.axes[0])


def test_a_lane_far_off_does_not_make_wide_lanes(recording):
    lanes = tuple(replace(lane, centre=-60.0) if lane.number == 7 else lane for lane in recording.site.lanes)
    figure = site_picture(replace(recording, site=replace(recording.site, lanes=lanes)))
    assert max(patch.get_height() for patch in figure.axes[0].patches[:7]) <= 5.0


def test_a_recording_without_rows_is_drawn(recording, tmp_path):
    empty = replace(recording, tracks=recording.tracks.head(0))
    write_site_picture(empty, tmp_path / "empty.png")
    assert (tmp_path / "empty.png").stat().st_size > 10_000


def test_a_road_of_one_lane_is_drawn(recording):
    site = without_ramp(recording.site)
    alone = replace(site, lanes=site.lanes[:1])
    tracks = recording.tracks.with_columns(pl.lit(alone.lanes[0].number, pl.Int16).alias(c.LANE))
    assert "1" in words(site_picture(replace(recording, site=alone, tracks=tracks)))
