"""What SUMO drove, read as a recording."""

import math
import sys
from dataclasses import replace

import polars as pl
import pytest

from rampcast.errors import MissingExtra, RampcastError, RecordingError, SiteError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.simulate import simulate
from rampcast.simulate.network import full_width_end, main_lanes
from rampcast.sites import Site, load_site
from rampcast.sites.site import site_from_dict, site_to_dict

SHORT = {"minutes": 0.2, "warm_up": 60.0, "seed": 5}


@pytest.fixture(scope="module")
def i80() -> Recording:
    pytest.importorskip("sumo", reason="needs the extra [sumo]")
    return simulate(load_site("i80"), **SHORT)


@pytest.mark.sumo
def test_any_site_can_be_simulated(i80: Recording) -> None:
    assert i80.names == ["i80-1"]
    assert i80.source == "simulated"
    assert dict(i80.tracks.schema) == c.SCHEMA
    assert set(i80.tracks[c.LANE].unique()) == {1, 2, 3, 4, 5, 6, 7}
    assert i80.tracks[c.FRAME].max() == 119


@pytest.mark.sumo
def test_the_ramp_lane_ends_where_it_stops_being_full_width(i80: Recording) -> None:
    ramp = i80.tracks.filter(pl.col(c.LANE) == 7)
    assert ramp[c.X].max() <= full_width_end(i80.site)
    assert full_width_end(i80.site) == pytest.approx(202.0, abs=0.5)


@pytest.mark.sumo
def test_vehicles_move_less_than_the_speed_limit_and_a_fifth_allows(i80: Recording) -> None:
    moved = i80.tracks.select((pl.col(c.X).diff().over(c.VEHICLE) / i80.time_step).alias("speed"))["speed"].drop_nulls()
    assert moved.min() > -0.011
    assert moved.max() < 1.2 * i80.site.speed_limit


@pytest.mark.slow
@pytest.mark.sumo
def test_the_same_seed_gives_the_same_recording_and_another_seed_another(i80: Recording) -> None:
    assert simulate(load_site("i80"), **SHORT).tracks.equals(i80.tracks)
    assert not simulate(load_site("i80"), **(SHORT | {"seed": 6})).tracks.equals(i80.tracks)


@pytest.mark.sumo
def test_progress_is_reported_and_grows() -> None:
    pytest.importorskip("sumo", reason="needs the extra [sumo]")
    done: list[float] = []
    simulate(load_site("simulated"), **SHORT, progress=done.append)
    assert done == sorted(done)
    assert 0 <= done[0] < done[-1] <= 1


def test_without_sumo_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sumo", None)
    with pytest.raises(MissingExtra, match=r'pip install "rampcast\[sumo\]"'):
        simulate(load_site("i80"), minutes=1.0, seed=1)


def test_a_recording_of_no_time_is_refused() -> None:
    with pytest.raises(RecordingError, match="minutes > 0"):
        simulate(load_site("i80"), minutes=0.0, seed=1)


def test_a_target_lane_that_is_not_the_rightmost_is_refused() -> None:
    site: Site = site_from_dict(site_to_dict(load_site("i80")) | {"target_lane": 5})
    with pytest.raises(SiteError, match="rightmost main lane"):
        simulate(site, minutes=1.0, seed=1)


def test_a_ramp_lane_that_goes_on_cannot_be_simulated() -> None:
    with pytest.raises(SiteError, match="needs a ramp lane that ends in the section; length is 503 m, ramp_end inf m"):
        main_lanes(replace(load_site("i80"), ramp_end=math.inf))


@pytest.mark.sumo
def test_drivers_are_named_by_their_set() -> None:
    with pytest.raises(RampcastError, match="drivers: expected one of default, queue_headway, got"):
        simulate(load_site("i80"), **SHORT, drivers="angry")


@pytest.mark.slow
@pytest.mark.sumo
def test_drivers_who_left_a_queue_keep_a_longer_headway(i80: Recording) -> None:
    other = simulate(load_site("i80"), **SHORT, drivers="queue_headway")
    assert other.names == i80.names
    assert other.tracks.height < i80.tracks.height  # fewer get in within the same time
