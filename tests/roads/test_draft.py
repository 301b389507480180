"""Sites drafted from tracks, against roads made by hand."""

import math
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.recording import columns as c
from rampcast.recording.reading import ReadReport
from rampcast.roads.draft import draft_roads
from rampcast.roads.plane import PX, PY, ROAD, Road
from rampcast.roads.project import on_roads
from rampcast.roads.reference import along_road, reference_line
from rampcast.sites import Lane, Site
from tests.formats.planes import Track, plane_of, straight

ANGLE = np.radians(30.0)


def read(plane, site=None):
    """Returns the recordings of a plane and the report."""
    return on_roads(plane, site, ReadReport(("made",), ("made",), plane.rows.height))


def sites(plane):
    """Returns the sites drafted from a plane."""
    return tuple(draft.site for draft in draft_roads(plane))


def two_ways() -> list[Track]:
    """Returns two lanes each way, turned by 30 degrees: left of x = 0 the other way; 4 m between the inner lanes.

    Eastbound centres are y = 0 and -3.5, seen from one vehicle of the left lane; westbound y = 4 and 7.5.
    """
    east = [straight(-3.5 * (i % 2), angle=ANGLE, speed=20 + i, first_frame=20 * i) for i in range(12)]
    west = [
        straight(4.0 + 3.5 * (i % 2), start=400.0, end=0.0, angle=ANGLE, speed=20 + i, first_frame=20 * i)
        for i in range(10)
    ]
    return [*east, *west]


def test_two_carriageways_are_two_roads_named_by_the_compass():
    east, west = sites(plane_of(two_ways()))
    assert (east.name, west.name) == ("made-east", "made-west")
    assert [len(site.lanes) for site in (east, west)] == [2, 2]
    heading = [math.atan2(*np.subtract(site.reference[-1], site.reference[0])[::-1]) for site in (east, west)]
    assert heading == pytest.approx([ANGLE, ANGLE - math.pi], abs=1e-3)
    for site in (east, west):
        left, right = site.lanes
        assert left.number == 1
        assert left.centre - right.centre == pytest.approx(3.5, abs=0.02)
        assert len(site.reference) == 2
        assert site.length == pytest.approx(400, abs=5)


def test_every_row_of_two_carriageways_comes_out_on_its_own():
    plane = plane_of(two_ways())
    recordings, report = read(plane)
    assert report.rows_off_road == report.rows_without_lane == 0
    assert [recording.tracks[c.VEHICLE].n_unique() for recording in recordings] == [12, 10]
    assert report.rows == plane.rows.height
    for recording in recordings:
        steps = recording.tracks.select(pl.col(c.X).diff().over(c.VEHICLE)).drop_nulls()[c.X]
        assert steps.min() > 0


def test_a_given_site_of_one_carriageway_leaves_out_the_vehicles_of_the_other():
    plane = plane_of(two_ways())
    east, _ = sites(plane)
    (recording,), report = read(plane, east)
    assert set(recording.tracks[c.VEHICLE]) == set(range(1, 13))
    assert report.rows_off_road == plane.rows.filter(pl.col(c.VEHICLE) > 12).height


def test_between_two_lanes_that_lie_wide_apart_the_nearest_counts():
    # Lanes at 0, -3.5 and -7 m, and one at -13 m: half a lane width of 3.5 m from the outer two ends at -8.75 m, but -9
    # and -11 m lie between lanes. -15.5 m is 2.5 m beside the outermost one, and in no lane.
    lanes = tuple(Lane(number, "main", y) for number, y in enumerate((0.0, -3.5, -7.0, -13.0), start=1))
    at_hand = Site("made", "made", False, 400.0, 30.0, lanes, reference=((0.0, 0.0), (400.0, 0.0)))
    (recording,), _ = read(plane_of([straight(y) for y in (-9.0, -11.0, -15.5, 1.0)]), at_hand)
    found = recording.tracks.group_by(c.VEHICLE).agg(pl.col(c.LANE).unique()).sort(c.VEHICLE)
    assert found[c.LANE].to_list() == [[3], [4], [0], [1]]


def test_a_right_angle_bend_is_one_road():
    """200 m straight, a quarter of a circle of 100 m radius to the left (157.08 m), 200 m straight: 557.08 m."""
    recordings, report = read(plane_of([bend(-3.5 * (i % 3), speed=20 + i) for i in range(9)]))
    (recording,) = recordings
    site = recording.site
    assert site.name == "made"
    assert len(site.lanes) == 3
    centres = np.array([lane.centre for lane in site.lanes])
    assert np.diff(centres) == pytest.approx([-3.5, -3.5], abs=0.05)
    # the reference runs on one of the lanes, the inner of which is shorter by 3.5 m * pi/2 than the next
    assert site.length == pytest.approx(557.08 + [0, 5.5, 11.0][int(np.abs(centres).argmin())], abs=6)
    assert report.rows_off_road == 0
    wander = recording.tracks.group_by(c.VEHICLE).agg(pl.col(c.Y).std())[c.Y].max()
    assert wander < 0.1


def bend(y: float, speed: float = 20.0) -> Track:
    """Returns a vehicle on a road that turns left by 90 degrees about (200, 100), y to the left of its middle."""
    radius = 100.0 - y
    s = np.arange(0.0, 400.0 + radius * np.pi / 2, speed * 0.1)
    turned = np.clip((s - 200.0) / radius, 0.0, np.pi / 2)
    beyond = np.maximum(s - 200.0 - radius * np.pi / 2, 0.0)
    px = np.minimum(s, 200.0) + radius * np.sin(turned)
    return Track(px, y + radius * (1 - np.cos(turned)) + beyond)


def test_a_ramp_that_joins_at_ten_degrees_is_of_the_road_and_no_row_of_it_is_lost():
    plane = plane_of([*main_road(), *(straight(joining, speed=18 + i, first_frame=9 * i) for i in range(3))])
    recordings, report = read(plane)
    (recording,) = recordings
    assert report.rows == plane.rows.height
    assert report.rows_off_road == 0
    assert [lane.centre - recording.site.lanes[0].centre for lane in recording.site.lanes] == pytest.approx(
        [0.0, -3.5, -7.0], abs=0.1
    )
    upstream = recording.tracks.filter(pl.col(c.X) < 50, pl.col(c.VEHICLE) > 20)
    assert set(upstream[c.LANE]) == {0}  # beside all lanes, as long as the ramp is on its own


def main_road() -> list[Track]:
    """Returns twenty vehicles on two lanes at y = 0 and -3.5."""
    return [straight(-3.5 * (i % 2), speed=20 + 0.5 * i, first_frame=11 * i) for i in range(20)]


def joining(x: np.ndarray) -> np.ndarray:
    """Returns the y of a ramp at 10 degrees that runs beside the road, at y = -7, from x = 200 m on."""
    return np.where(x < 200, -7.0 - np.tan(np.radians(10.0)) * (200 - x), -7.0)


def test_lanes_of_the_source_are_joined_by_their_place_and_keep_their_names():
    """Lanes 'b1' and 'b2' follow each other at y = -3.5, 'a' is at 0; the ramp 'r' is 20 m off."""
    tracks = [straight(0.0, lane="a"), straight(0.1, lane="a"), straight(-20.0, lane="r", end=200.0)]
    for y in (-3.5, -3.6):
        size = len(straight(y).px)
        tracks.append(straight(y, lane=["b1"] * (size // 2) + ["b2"] * (size - size // 2)))
    recordings, report = read(plane_of(tracks))
    lanes = recordings[0].site.lanes
    assert [lane.sources for lane in lanes] == [("a",), ("b1", "b2"), ("r",)]
    assert [lane.number for lane in lanes] == [1, 2, 3]
    assert [lane.centre - lanes[0].centre for lane in lanes] == pytest.approx([0.0, -3.6, -20.05], abs=0.1)
    assert report.rows_off_road == report.rows_without_lane == 0


def test_slices_of_a_lane_that_tapers_do_not_lead_from_one_lane_to_the_next():
    """Lanelets t0 to t4 of an acceleration lane are 1.5 m apart, and 6 m from the first to the last."""
    tracks = [straight(0.0, lane="a"), *(straight(-8.5 + 1.5 * i, lane=f"t{i}") for i in range(5))]
    lanes = read(plane_of(tracks))[0][0].site.lanes
    # From the left: a at 0, t4 at -2.5; t3 at -4.0 is 1.5 m from t4; t2 at -5.5 is 2.25 m from their mean, -3.25.
    assert [lane.sources for lane in lanes] == [("a",), ("t3", "t4"), ("t1", "t2"), ("t0",)]


def test_one_vehicle_only_is_a_road_with_a_lane():
    """It drives 398 m at 20 m/s to the north."""
    recordings, report = read(plane_of([straight(0.0, angle=np.pi / 2)]))
    (recording,) = recordings
    site = recording.site
    assert site.reference == ((0.0, 0.0), (0.0, 398.0))
    assert site.lanes == (Lane(1, "main", 0.0),)
    assert site.length == 398.0
    assert site.speed_limit == pytest.approx(20.0)
    assert "not known" in site.notes[0].text
    assert report.rows_off_road == 0


def standing(x: float, y: float) -> Track:
    """Returns a vehicle that stands, seen with 5 cm of noise."""
    wobble = 0.05 * np.random.default_rng(int(x)).normal(size=(2, 100))
    return Track(x + wobble[0], y + wobble[1])


def test_a_vehicle_that_stands_is_on_the_road_it_stands_on():
    """West of the other carriageway: y = 7.5 is its outer lane, y = -3.5 the outer lane of the eastbound one."""
    cos, sin = np.cos(ANGLE), np.sin(ANGLE)
    turned = [(cos * 50 - sin * y, sin * 50 + cos * y) for y in (7.5, -3.5)]
    plane = plane_of([*two_ways(), *(standing(*place) for place in turned)])
    east, west = read(plane)[0]
    assert 23 in set(west.tracks[c.VEHICLE])
    assert 24 in set(east.tracks[c.VEHICLE])


def test_a_queue_that_does_not_move_at_all_is_a_road():
    recordings, report = read(plane_of([standing(8.0 * i, 0.0) for i in range(20)]))
    (recording,) = recordings
    assert report.rows == 2000
    assert recording.site.length == pytest.approx(152, abs=2)
    assert recording.site.speed_limit == pytest.approx(50 / 3.6, abs=0.1)


def test_a_vehicle_seen_once_is_a_road():
    recordings, _ = read(plane_of([Track(np.array([3.0]), np.array([4.0]))]))
    assert recordings[0].tracks.height == 1


def test_the_speed_limit_of_the_source_is_kept():
    (site,) = sites(plane_of([straight(0.0)], speed_limit=33.3))
    assert (site.speed_limit, site.notes) == (33.3, ())


def test_a_reference_of_the_source_is_kept_and_lanes_are_drafted_beside_it():
    plane = plane_of(main_road(), roads=(Road("south", ((0.0, 2.0), (400.0, 2.0))),))
    plane = replace(plane, rows=plane.rows.with_columns(pl.lit("south").cast(pl.Categorical()).alias(ROAD)))
    (site,) = sites(plane)
    assert site.name == "made-south"
    assert site.reference == ((0.0, 2.0), (400.0, 2.0))
    assert [lane.centre for lane in site.lanes] == pytest.approx([-2.0, -5.5], abs=0.01)


def test_a_road_known_by_name_only_gets_its_line_from_its_own_tracks():
    tracks = two_ways()
    plane = plane_of(tracks, roads=(Road("a"), Road("b")))
    names = pl.when(pl.col(c.VEHICLE) <= 12).then(pl.lit("b")).otherwise(pl.lit("a")).cast(pl.Categorical())
    a, b = sites(replace(plane, rows=plane.rows.with_columns(names.alias(ROAD))))
    assert (a.name, b.name) == ("made-a", "made-b")
    assert a.reference[0][0] > a.reference[-1][0]  # to the west
    assert b.reference[0][0] < b.reference[-1][0]


def test_the_lane_keeper_is_the_reference_not_who_changes_lanes():
    changing = [straight(lambda x, i=i: -3.5 * np.clip((x - 40 * i) / 60, 0, 1), speed=20 + i) for i in range(1, 7)]
    keeping = [straight(-3.5 * (i % 2), speed=25.0 + i) for i in range(7)]
    (site,) = sites(plane_of([*changing, *keeping]))
    assert len(site.reference) == 2
    assert abs(site.reference[0][1] - site.reference[1][1]) < 0.01


def test_vehicles_that_merge_do_not_draw_the_reference_line_even_where_they_are_the_more():
    """Twelve come from a ramp at y = -8 and merge between x = 130 and 185 m; four keep the lane at y = 0."""
    merging = [
        straight(lambda x, i=i: np.interp(x, [0, 110, 130 + 5 * i, 170 + 5 * i], [-8, -3.6, -3.6, 0]), speed=20 + i)
        for i in range(12)
    ]
    (site,) = sites(plane_of([*merging, *(straight(0.0, speed=22.0 + i) for i in range(4))]))
    assert site.reference[0][1] == pytest.approx(0.0, abs=0.05)
    assert site.reference[-1][1] == pytest.approx(0.0, abs=0.05)
    assert [lane.centre for lane in site.lanes] == pytest.approx([0.0, -3.6], abs=0.1)


def test_a_draft_does_not_depend_on_the_order_of_rows():
    plane = plane_of(two_ways())
    shuffled = replace(plane, rows=plane.rows.sample(fraction=1.0, shuffle=True, seed=1))
    assert sites(shuffled) == sites(plane)


@pytest.mark.parametrize("degrees", [0, 77, 141, 250])
def test_a_turned_and_shifted_plane_gives_the_same_road(degrees):
    angle = np.radians(degrees)
    plane = plane_of([bend(-3.5 * (i % 3), speed=20 + i) for i in range(6)])
    turned = plane.rows.with_columns(
        (pl.col(PX) * math.cos(angle) - pl.col(PY) * math.sin(angle) + 5000).alias(PX),
        (pl.col(PX) * math.sin(angle) + pl.col(PY) * math.cos(angle) - 7000).alias(PY),
    )
    (site,), (other,) = sites(plane), sites(replace(plane, rows=turned))
    assert other.lanes == site.lanes
    assert other.length == site.length
    line, again = (reference_line(np.array(one.reference)) for one in (site, other))
    ours = along_road(line, plane.rows[PX].to_numpy(), plane.rows[PY].to_numpy())
    theirs = along_road(again, turned[PX].to_numpy(), turned[PY].to_numpy())
    np.testing.assert_allclose(theirs, ours, atol=0.01)


def test_rows_of_all_roads_are_told_apart():
    drafts = draft_roads(plane_of(two_ways()))
    assert (np.sum([draft.is_here for draft in drafts], axis=0) == 1).all()


def test_a_plane_without_rows_has_no_road():
    plane = plane_of([straight(0.0)])
    assert sites(replace(plane, rows=plane.rows.head(0))) == ()


def test_carriageways_that_number_their_lanes_alike_are_told_apart_by_the_direction_of_travel():
    east = [straight(-3.6 * lane, lane=str(lane)) for lane in (1, 2)]
    west = [straight(3.6 * lane, start=400.0, end=0.0, lane=str(lane)) for lane in (1, 2)]
    plane = plane_of([*east, *west])
    site = next(draft.site for draft in draft_roads(plane) if draft.site.name.endswith("east"))
    (recording,), report = on_roads(plane, site, ReadReport((), (), rows_read=plane.rows.height))
    assert sorted(recording.tracks[c.VEHICLE].unique()) == [1, 2]
    assert recording.tracks[c.Y].abs().max() < 8.0
    assert report.rows_off_road == recording.tracks.height  # as many rows drive the other way


def test_a_lane_too_seldom_driven_for_the_sample_is_drafted_and_its_rows_are_kept():
    """Three rows of vehicle 2, 0.3 s, carry the name of a lanelet that nobody else is on."""
    lanes = ["a"] * 200
    lanes[101:104] = ["seldom"] * 3
    plane = plane_of([straight(0.0, lane="a"), straight(-3.6, lane="b"), straight(0.0, lane=lanes)])
    (recording,), _ = on_roads(plane, None, ReadReport((), (), rows_read=plane.rows.height))
    assert recording.tracks.height == plane.rows.height
    assert [lane.sources for lane in recording.site.lanes] == [("a", "seldom"), ("b",)]
    again, _ = on_roads(plane, recording.site, ReadReport((), (), rows_read=plane.rows.height))
    assert again[0].tracks.equals(recording.tracks)


def test_a_site_to_which_no_row_belongs_is_an_error_that_says_so():
    plane = plane_of([straight(0.0, lane="a")])
    (draft,) = draft_roads(plane)
    site = replace(draft.site, lanes=(Lane(1, "main", 0.0, ("another",)),))
    with pytest.raises(FormatError, match=r"none of its 200 rows lies on the road of site made"):
        read(plane, site)
