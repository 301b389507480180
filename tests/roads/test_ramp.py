"""The ramp of a site: what is given is kept, what is not is proposed from tracks made by hand."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import SiteError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.ramp import RampValues, lane_changes, lanes_driven, mirrored, road_named, with_ramp, without_ramp
from rampcast.sites import Lane, Site

LANES = (Lane(1, "main", 0.0), Lane(2, "main", -3.5), Lane(3, "main", -7.0))
SITE = Site(name="made", title="Made", simulated=False, length=400.0, speed_limit=30.0, lanes=LANES)


def recording(merges=tuple(range(100, 200, 5)), *, ramp_to: float = 200.0) -> Recording:
    """Returns two vehicles on each of lanes 1 and 2, and one on lane 3 for each merge, into lane 2 at that x.

    The ramp comes from y = -17 at x = 0 and is at -7 from x = 100 m on. Rows lie 1 m apart: at x = 100.5 and so on.
    """
    parts, vehicle = [], 0
    x = np.arange(0.5, 400.0, 1.0)
    for lane in (1, 1, 2, 2):
        vehicle += 1
        parts.append(track(vehicle, x, np.full(len(x), -3.5 * (lane - 1)), np.full(len(x), lane)))
    for place in merges:
        vehicle += 1
        lane = np.where(x < place, 3, 2)
        y = np.where(lane == 3, -7.0 - 0.1 * np.maximum(100 - x, 0), -3.5)
        parts.append(track(vehicle, x, y, lane))
    vehicle += 1
    here = x[x < ramp_to]
    parts.append(track(vehicle, here, np.full(len(here), -7.0), np.full(len(here), 3)))
    return Recording(tracks=pl.concat(parts), site=SITE, time_step=0.1, source="made")


def track(vehicle: int, x, y, lane) -> pl.DataFrame:
    values = {c.RECORDING: "made-1", c.VEHICLE: vehicle, c.LENGTH: 4.5, c.WIDTH: 1.8, c.KIND: "car"}
    table = pl.DataFrame({c.FRAME: np.arange(len(x)), c.X: x, c.Y: y, c.LANE: lane})
    table = table.with_columns(pl.lit(value).alias(name) for name, value in values.items())
    return table.select(pl.col(name).cast(kind) for name, kind in c.SCHEMA.items())


def test_what_is_given_is_kept_and_needs_no_note():
    values = RampValues((3,), 2, 90.0, 210.0, (100.0, 200.0))
    site = with_ramp(SITE, recording(), values)
    assert (site.ramp_lanes, site.target_lane, site.gore, site.ramp_end) == ((3,), 2, 90.0, 210.0)
    assert (site.merge_zone, site.notes) == ((100.0, 200.0), ())


def test_what_is_not_given_is_proposed_with_a_note_each():
    """20 merges, the first row in lane 2 being at 100.5, 105.5, ... 195.5; the ramp is driven to 199.5."""
    site = with_ramp(SITE, recording(), RampValues((3,)))
    assert site.target_lane == 2
    assert site.gore == 101.0  # the quantile 0.01 of the places: 100.5 + 0.19 * 5 = 101.45, rounded down
    assert site.ramp_end == 200.0
    assert site.merge_zone == (105.0, 191.0)  # 100.5 + 0.95 * 5 = 105.25 and 195.5 - 0.95 * 5 = 190.75
    assert [note.text.split()[0] for note in site.notes] == ["target_lane", "gore", "ramp_end", "merge_zone"]
    assert "20 of 20 changes" in site.notes[0].text


def test_the_lane_line_is_half_way_between_both_lanes():
    """At x = 10 the ramp is at -16 but for one of its 21 vehicles, the target lane at -3.5; later it is at -7."""
    site = with_ramp(SITE, recording(), RampValues((3,)))
    line = site.lane_line_y(np.array([10.0, 150.0]))
    assert line == pytest.approx([-9.75, -5.25], abs=0.05)


def test_vehicles_on_their_way_over_the_line_do_not_pull_it():
    """All merge in 4 s, from -7.0 to -3.5: those of lane 2 within 2 s of the change are to the right of its middle."""
    whole = recording(merges=tuple(range(100, 340)))
    slowly = pl.col(c.X) - pl.col(c.X).filter(pl.col(c.LANE) == 2).min().over(c.VEHICLE)  # 10 m/s: 1 m in 0.1 s
    changes = pl.col(c.VEHICLE).is_between(5, 244) & slowly.is_between(-20.0, 20.0)
    moving = pl.when(changes).then(-5.25 + slowly * 1.75 / 20.0).otherwise(pl.col(c.Y))
    tracks = whole.tracks.with_columns(moving.clip(lower_bound=-7.0).alias(c.Y))
    site = with_ramp(SITE, replace(whole, tracks=tracks), RampValues((3,)))
    assert site.lane_line_y(np.array([120.0, 200.0, 300.0])) == pytest.approx(-5.25, abs=0.05)


def test_changes_between_the_lanes_of_a_ramp_are_no_merges():
    """Every vehicle of lane 3 passes over lane 2, which is a ramp too, for 20 m before it comes into lane 1."""
    whole = recording()
    since = pl.col(c.X) - pl.col(c.X).filter(pl.col(c.LANE) == 2).min().over(c.VEHICLE)
    merged = (pl.col(c.VEHICLE) > 4) & (since >= 20.0)
    tracks = whole.tracks.with_columns(pl.when(merged).then(1).otherwise(pl.col(c.LANE)).cast(pl.Int16).alias(c.LANE))
    site = with_ramp(SITE, replace(whole, tracks=tracks), RampValues((2, 3)))
    assert site.ramp_lanes == (2, 3)
    assert site.target_lane == 1
    assert "20 of 20 changes" in site.notes[0].text
    assert site.merge_zone == (125.0, 211.0)  # 20 m further than lane 2 is reached


def test_a_straight_ramp_gets_a_straight_lane_line():
    tracks = recording().tracks.with_columns(pl.col(c.Y).clip(lower_bound=-7.0))
    site = with_ramp(SITE, replace(recording(), tracks=tracks), RampValues((3,)))
    assert site.lane_line == ((0.0, -5.25), (400.0, -5.25))


def test_a_ramp_lane_that_vehicles_drive_to_the_end_of_the_section_goes_on():
    site = with_ramp(SITE, recording(ramp_to=400.0), RampValues((3,)))
    assert (site.ramp_end, site.ramp_goes_on, site.merge_zone) == (np.inf, True, (105.0, 191.0))
    assert site.notes[2].text.startswith("ramp_end is left out: the lane goes on, as 1 of the 21 vehicles of the ramp")


def test_a_lane_goes_on_if_it_is_driven_as_far_as_the_lane_beside_it_is_seen():
    """The section is said to be 500 m long; all lanes are seen for 400."""
    site = with_ramp(replace(SITE, length=500.0), recording(ramp_to=395.0), RampValues((3,)))
    assert site.ramp_goes_on
    assert not with_ramp(replace(SITE, length=500.0), recording(ramp_to=370.0), RampValues((3,))).ramp_goes_on


def test_a_lane_that_goes_on_and_that_nobody_leaves_has_no_merge_zone():
    site = with_ramp(SITE, recording(merges=(), ramp_to=400.0), RampValues((3,)))
    assert np.isinf(site.ramp_end)
    assert np.isnan(site.merge_zone).all()
    assert site.notes[3].text == "merge_zone is left out: no merge was seen."


def test_a_single_vehicle_of_many_that_is_seen_beyond_the_end_does_not_make_the_lane_go_on():
    """120 merge, in 100 to 199.5; the label of one may be wrong."""
    many = tuple(100 + 5 * (n % 20) for n in range(120))
    site = with_ramp(SITE, recording(merges=many, ramp_to=400.0), RampValues((3,)))
    assert site.ramp_end == 196.0  # 99 % of the merges lie before it
    assert "hardly a vehicle" in site.notes[2].text


def test_an_end_beyond_the_section_and_one_that_is_nowhere_can_be_given():
    for end in (900.0, np.inf):
        site = with_ramp(SITE, recording(), RampValues((3,), ramp_end=end))
        assert (site.ramp_end, site.ramp_goes_on) == (end, True)
        assert "ramp_end" not in [note.text.split()[0] for note in site.notes]
        assert RampValues(gore=95.0).or_of(site).ramp_end == end


def test_a_ramp_that_nobody_leaves_has_proposals_from_where_it_is_driven():
    site = with_ramp(SITE, recording(merges=()), RampValues((3,)))
    assert (site.target_lane, site.gore, site.ramp_end, site.merge_zone) == (2, 0.0, 200.0, (0.0, 200.0))
    assert "nearest" in site.notes[0].text


def test_a_ramp_on_the_left_merges_to_the_right():
    """Lanes from the left: 1 is the ramp; its vehicles move to 2."""
    site = with_ramp(mirrored(recording()).site, mirrored(recording()), RampValues((1,)))
    assert (site.target_lane, site.mirrored) == (2, True)
    assert site.lane_line_y(np.array([150.0])) == pytest.approx([5.25])


def test_mirroring_twice_changes_nothing():
    once = mirrored(recording())
    assert [lane.centre for lane in once.site.lanes] == [7.0, 3.5, 0.0]
    assert once.tracks[c.LANE].to_list() == [4 - lane for lane in recording().tracks[c.LANE]]
    again = mirrored(once)
    assert again.tracks.equals(recording().tracks)
    assert again.site.lanes == SITE.lanes


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (RampValues((9,)), r"has no lane 9; its lanes are \[1, 2, 3\]"),
        (RampValues((3,), target_lane=8), "has no lane 8"),
        (RampValues((3,), target_lane=3), "another lane as their target"),
        (RampValues(()), "expected ramp lanes"),
        (RampValues((1, 2, 3)), "no lane beside those of the ramp"),
        (RampValues((3,), gore=300.0, ramp_end=200.0), "expected gore < ramp_end"),
        (RampValues((3,), gore=500.0, ramp_end=900.0), "gore < length"),
        (RampValues((3,), merge_zone=(150.0, 900.0)), "merge_zone: expected two x between the gore"),
    ],
)
def test_values_that_do_not_go_together_are_refused(values, message):
    with pytest.raises(SiteError, match=message):
        with_ramp(SITE, recording(), values)


def test_values_of_a_site_with_a_ramp_are_kept_unless_another_ramp_is_asked_for():
    site = with_ramp(SITE, recording(), RampValues((3,)))
    kept = RampValues(gore=95.0).or_of(site)
    assert kept == RampValues((3,), 2, 95.0, 200.0, (105.0, 191.0))
    assert RampValues((2,)).or_of(site) == RampValues((2,))
    assert RampValues().or_of(SITE) == RampValues()


def test_a_note_on_a_proposal_goes_when_another_value_is_given():
    site = with_ramp(SITE, recording(), RampValues((3,)))
    again = with_ramp(site, recording(), RampValues(gore=95.0).or_of(site))
    assert [note.text.split()[0] for note in again.notes] == ["target_lane", "ramp_end", "merge_zone"]


def test_a_site_loses_its_ramp_with_all_that_tells_of_it():
    site = without_ramp(with_ramp(SITE, recording(), RampValues((3,))))
    assert not site.has_ramp
    assert (site.target_lane, site.lane_line, site.notes) == (0, (), ())
    assert np.isnan([site.gore, *site.merge_zone]).all()
    assert np.isinf(site.ramp_end)


def test_changes_are_those_within_a_track_and_rows_without_a_lane_are_passed_over():
    """Vehicle 5 merges at 100; three rows around it are given no lane."""
    tracks = recording(merges=(100,)).tracks
    none = (pl.col(c.VEHICLE) == 5) & pl.col(c.X).is_between(98, 101)
    tracks = tracks.with_columns(pl.when(none).then(0).otherwise(c.LANE).cast(pl.Int16).alias(c.LANE))
    assert lane_changes(tracks).rows() == [("made-1", 5, 101.5, 3, 2)]


def test_the_table_of_lanes_counts_what_drives_on_them():
    left, middle, ramp = lanes_driven(recording()).iter_rows(named=True)
    assert (left["lane"], left["vehicles"], left["rows"], left["left"], left["right"]) == (1, 2, 800, 0, 0)
    assert middle["vehicles"] == 22
    assert (ramp["vehicles"], ramp["left"], ramp["right"]) == (21, 20, 0)
    assert ramp["left_from"] == pytest.approx(105.5, abs=5)


def test_a_road_is_found_by_its_name_or_the_end_of_it():
    east, west = (replace(recording(), site=replace(SITE, name=f"made-{way}")) for way in ("east", "west"))
    assert road_named([east, west], "west") is west
    assert road_named([east, west], "made-east") is east
    assert road_named([east], None) is east
    with pytest.raises(SiteError, match=r"found 2; name it with --road: made-east \(\d[\d,]+ rows\), made-west"):
        road_named([east, west], None)
    with pytest.raises(SiteError, match="found 0 named north"):
        road_named([east, west], "north")
