"""What is the road where ramps, loops and bridges are in the same picture; roads that are made by hand say."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.recording import columns as c
from rampcast.roads.draft import draft_roads
from rampcast.sites import Lane, Site
from tests.formats.planes import Track, plane_of, straight
from tests.roads.test_draft import read

RADIUS = 45.0  # [m] of a loop
MAIN_LANES = (0.0, -3.6)
SPEED = 24.0  # [m/s] on the road; 12 on the ramp


def driven(points: np.ndarray, speed: float, noise: float = 0.0, seed: int = 1) -> Track:
    """Returns a vehicle that drives along the points at a speed [m/s]."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.arange(0.0, along[-1], speed * 0.1)
    trembles = noise * np.random.default_rng(seed).standard_normal((2, len(at)))
    px, py = (np.interp(at, along, points[:, axis]) + trembles[axis] for axis in (0, 1))
    return Track(px, py)


def beside(x: np.ndarray, y: np.ndarray, radius: float) -> np.ndarray:
    """Returns places in the plane of places x along, y to the left of a road that bends with that radius [m]."""
    if np.isinf(radius):
        return np.stack([x, y], axis=1)
    return np.stack([(radius - y) * np.sin(x / radius), radius - (radius - y) * np.cos(x / radius)], axis=1)


def ramp(kind: str, radius: float, merge_at: float) -> np.ndarray:
    """Returns the way of a vehicle that comes from afar, is in lane 3 from 120 m on, and merges, or goes on at inf."""
    x = np.linspace(120.0, 400.0, 200)
    share = np.clip((x - merge_at) / 60.0, 0.0, 1.0)
    auxiliary = beside(x, -7.2 + 3.6 * share**2 * (3 - 2 * share), radius)
    ahead = auxiliary[1] - auxiliary[0]
    heading, turn = np.arctan2(ahead[1], ahead[0]), 1.5 * np.pi if kind == "loop" else np.pi / 5
    size = RADIUS if kind == "loop" else 150.0
    right = np.array([np.sin(heading), -np.cos(heading)])
    around = heading + np.pi / 2 + np.linspace(turn, 0.0, 150)  # a loop comes from the left, over or under the road
    bend = auxiliary[0] + size * right + size * np.stack([np.cos(around), np.sin(around)], axis=1)
    back = bend[0] - bend[1]
    before = bend[0] + np.linspace(250.0, 1.0, 100)[:, None] * back / np.hypot(*back)
    return np.concatenate([before, bend[:-1], auxiliary])


def world(*, mains: int, ramps: int, radius: float, kind: str, merges: bool, noise: float):
    """Returns a plane: the first vehicles are on the road, the others on its ramp."""
    x = np.linspace(0.0, 400.0, 200)
    tracks = [
        driven(beside(x, np.full(200, MAIN_LANES[i % 2]), radius), SPEED + i % 3, noise, seed=i) for i in range(mains)
    ]
    ends = [200.0 + 30.0 * (i % 4) if merges else np.inf for i in range(ramps)]
    return plane_of([*tracks, *(driven(ramp(kind, radius, end), SPEED / 2, noise, seed=99) for end in ends)])


@pytest.mark.parametrize("merges", [True, False])
@pytest.mark.parametrize(("kind", "radius"), [("loop", np.inf), ("gentle", 600.0), ("gentle", -400.0), ("loop", 600.0)])
@pytest.mark.parametrize(("mains", "ramps", "noise"), [(2, 1, 0.0), (2, 6, 0.0), (8, 2, 0.05)])
def test_the_reference_line_follows_the_road_however_long_its_ramp_is_seen(mains, ramps, radius, kind, merges, noise):
    plane = world(mains=mains, ramps=ramps, radius=radius, kind=kind, merges=merges, noise=noise)
    (recording,), _ = read(plane)
    assert len(recording.site.lanes) == 3
    centres = np.array([lane.centre for lane in recording.site.lanes])
    assert np.diff(centres) == pytest.approx([-3.6, -3.6], abs=0.1 + noise)
    step = pl.col(c.X).diff().over(c.VEHICLE) / (pl.col(c.FRAME).diff().over(c.VEHICLE) * 0.1)
    tracks = recording.tracks.with_columns(speed=step).drop_nulls("speed")
    main = tracks.filter(pl.col(c.VEHICLE) <= mains)
    sways = main.group_by(c.VEHICLE).agg(pl.col(c.Y).quantile(0.98) - pl.col(c.Y).quantile(0.02))[c.Y].max()
    assert sways <= 0.1 + 5 * noise
    assert main["speed"].is_between(SPEED - 2 - 60 * noise, SPEED + 4 + 60 * noise).all()
    assert tracks["speed"].min() > 0  # no loop is folded onto the road
    on_ramp = tracks.filter(pl.col(c.VEHICLE) > mains)
    assert 3 in on_ramp[c.LANE].to_list()


def test_a_bridge_over_the_road_is_not_on_the_site_of_the_road():
    crossing = Track(np.full(45, 150.0), 40.0 - 2.0 * np.arange(45))
    slow = Track(np.full(120, 250.0), 12.0 - 0.2 * np.arange(120))  # 2 m/s
    road = [straight(y, speed=25.0) for y in (0.0, -3.6, -7.2)]
    lanes = tuple(Lane(number, "main", y) for number, y in ((1, 0.0), (2, -3.6), (3, -7.2)))
    site = Site("over", "Over", False, 400.0, 30.0, lanes, reference=((0.0, 0.0), (400.0, 0.0)))
    (recording,), report = read(plane_of([*road, crossing, slow]), site)
    assert set(recording.tracks[c.VEHICLE]) == {1, 2, 3}
    assert report.rows_off_road == 45 + 120


@pytest.mark.parametrize("degrees", [12, 20, 35, 50])
def test_a_bridge_aslant_over_the_road_is_not_on_it(degrees):
    way = 20.0 * 0.1 * (np.arange(150) - 75)
    aslant = np.radians(degrees)
    over = [Track(200.0 + shift + way * np.cos(aslant), -3.6 + way * np.sin(aslant)) for shift in (0.0, 15.0, 40.0)]
    weaves = Track(2.0 * np.arange(200), np.interp(np.arange(200), [40, 160], [3.6, -10.8]))  # 3.4 degrees
    road = [*(straight(y, speed=25.0) for y in (3.6, 0.0, -3.6, -7.2, -10.8)), weaves]
    (drafted,), report = read(plane_of([*road, *over]))
    assert set(drafted.tracks[c.VEHICLE]) == {1, 2, 3, 4, 5, 6}
    assert report.rows_off_road == 3 * 150
    (with_site,), report = read(plane_of([*road, *over]), drafted.site)
    assert set(with_site.tracks[c.VEHICLE]) == {1, 2, 3, 4, 5, 6}


def test_a_vehicle_of_the_other_way_is_left_out_even_where_it_is_seen_for_ten_metres():
    road = [straight(y, speed=25.0) for y in (0.0, -3.6)]
    against = straight(0.0, start=110.0, end=100.0, speed=10.0)
    site = replace(draft_roads(plane_of(road))[0].site)
    (recording,), report = read(plane_of([*road, against]), site)
    assert set(recording.tracks[c.VEHICLE]) == {1, 2}
    assert report.rows_off_road == len(against.px)


def test_a_change_of_lane_in_one_step_is_no_crossing():
    jumps = Track(np.full(30, 50.0) + 0.1 * np.arange(30), np.where(np.arange(30) < 15, 0.0, -3.6))
    lanes = (Lane(1, "main", 0.0), Lane(2, "main", -3.6))
    site = Site("made", "Made", False, 400.0, 30.0, lanes, reference=((0.0, 0.0), (400.0, 0.0)))
    (recording,), report = read(plane_of([jumps]), site)
    assert recording.tracks.height == 30
    assert report.rows_off_road == 0


@pytest.mark.parametrize("speeds", [(2.0, 6.0, 2.0), (0.0, 6.0, 0.0), (0.0, 2.0, 0.0)])
def test_in_a_clip_of_half_a_second_the_road_leads_where_vehicles_creep(speeds):
    tracks = [
        Track(start + v * 0.1 * np.arange(6), np.full(6, 50.0))
        for start, v in zip((100.0, 111.0, 121.0), speeds, strict=True)
    ]
    (recording,), report = read(plane_of(tracks))
    assert recording.tracks.height == 18
    moved = recording.tracks.group_by(c.VEHICLE).agg(pl.col(c.X).max() - pl.col(c.X).min()).sort(c.VEHICLE)[c.X]
    assert moved.to_list() == pytest.approx([v * 0.5 for v in speeds], abs=1e-3)
    assert recording.tracks[c.Y].abs().max() < 1e-3
    assert report.rows_off_road == 0


def test_in_a_short_clip_of_two_carriageways_each_is_a_road():
    east = [Track(100.0 + 20.0 * i + 0.6 * np.arange(6), np.full(6, 50.0)) for i in range(3)]
    west = [Track(100.0 + 20.0 * i - 0.6 * np.arange(6), np.full(6, 60.0)) for i in range(3)]
    recordings, _ = read(plane_of([*east, *west]))
    assert [recording.tracks[c.VEHICLE].unique().to_list() for recording in recordings] == [[1, 2, 3], [4, 5, 6]]
    for recording in recordings:
        assert recording.tracks.select(pl.col(c.X).diff().over(c.VEHICLE)).drop_nulls()[c.X].min() > 0


def test_a_clip_in_which_nothing_moves_is_a_road_where_the_vehicles_stand():
    tracks = [Track(np.full(6, 100.0 + 10.0 * i), np.full(6, 50.0)) for i in range(3)]
    (recording,), _ = read(plane_of(tracks))
    assert recording.tracks.height == 18
    assert sorted(recording.tracks[c.X].unique().round(3)) == [0.0, 10.0, 20.0]


def test_files_of_two_places_are_not_made_one_recording():
    here = plane_of([straight(y) for y in (0.0, -3.6, 0.0)])
    parts = [
        here.rows.with_columns(pl.lit(name, pl.Categorical()).alias(c.RECORDING), pl.col("px") + far)
        for name, far in (("1", 0.0), ("2", 5000.0))
    ]
    with pytest.raises(FormatError, match="files of two places"):
        read(replace(here, rows=pl.concat(parts)))
    both = pl.concat([parts[0], parts[1].with_columns(pl.col("px") - 4900.0)])
    assert read(replace(here, rows=both))[1].rows == both.height
