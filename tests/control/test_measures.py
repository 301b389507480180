"""The measures of a run, by rows and trips that are made up."""

import numpy as np
import pytest

from rampcast.control.measures import gini, hard_brakings, joined, merges, safety_measures, trip_measures
from rampcast.recording import columns as c
from rampcast.simulate.corridor import Corridor

SITE = Corridor().site


def rows(*tracks):
    """Returns rows of vehicles of (x at 0 s, speed, lane before 2 s, lane after), each half second for 10 s."""
    frames = []
    for time in np.arange(0.0, 10.0, 0.5):
        x = np.array([start + speed * time for start, speed, _, _ in tracks])
        lane = np.array([before if time < 2.0 else after for _, _, before, after in tracks])
        count = len(tracks)
        frames.append((time, {
            c.VEHICLE: np.arange(count), c.X: x, c.LANE: lane, c.LENGTH: np.full(count, 5.0),
            c.V: np.array([speed for _, speed, _, _ in tracks]), c.A: np.zeros(count),
        }))  # fmt: skip
    return joined(frames)


def test_equal_delays_have_a_gini_of_0_and_one_who_has_all_of_nearly_1():
    assert gini(np.full(10, 3.0)) == pytest.approx(0.0)
    assert gini(np.array([0.0] * 9 + [5.0])) == pytest.approx(0.9)
    assert gini(np.array([1.0, 2.0, 3.0])) == pytest.approx(2 / 9)
    assert gini(np.zeros(3)) == 0.0


def test_a_merge_is_found_with_who_is_ahead_and_behind():
    found = rows((310.0, 10.0, 3, 2), (350.0, 10.0, 2, 2), (280.0, 10.0, 2, 2), (330.0, 10.0, 1, 1))
    merged = merges(found, SITE)
    vehicle = found[c.VEHICLE]
    assert vehicle[merged["row"]].tolist() == [0]
    assert vehicle[merged["ahead"]].tolist() == [1]
    assert vehicle[merged["behind"]].tolist() == [2]


def test_a_follower_who_closes_in_has_a_conflict_and_one_far_behind_has_none():
    near = safety_measures(rows((310.0, 10.0, 3, 2), (280.0, 20.0, 2, 2)), SITE)  # gap 5 m at the merge, 10 m/s closing
    assert (near["merges"], near["ttc"], near["drac"], near["pet"], near["conflicts"]) == (1.0, 1.0, 1.0, 1.0, 1.0)
    far = safety_measures(rows((310.0, 10.0, 3, 2), (210.0, 10.0, 2, 2)), SITE)
    assert (far["ttc"], far["drac"], far["pet"], far["conflicts"]) == (0.0, 0.0, 0.0, 0.0)


def test_the_encroachment_is_timed_at_the_place_of_the_merge():
    # the merge is at 330 m at 2.0 s; its rear leaves there at 2.5 s; the follower's front comes there 2.4 s after that
    close = safety_measures(rows((310.0, 10.0, 3, 2), (281.0, 10.0, 2, 2)), SITE)
    assert close["pet"] == 0.0
    closer = safety_measures(rows((310.0, 10.0, 3, 2), (287.0, 10.0, 2, 2)), SITE)  # 1.8 s
    assert closer["pet"] == 1.0
    assert closer["conflicts"] == 0.0  # nobody closes in


def test_a_hard_braking_is_counted_once_however_long_it_lasts():
    found = rows((0.0, 10.0, 1, 1), (50.0, 10.0, 1, 1))
    found[c.A] = np.where((found[c.VEHICLE] == 1) & (found["time"] >= 3.0) & (found["time"] < 5.0), -5.0, 0.0)
    assert hard_brakings(found) == pytest.approx(500.0)


def test_trips_tell_delays_by_route_and_what_was_burnt(tmp_path):
    path = tmp_path / "trips.xml"
    path.write_text(
        '<tripinfos><tripinfo id="0" departDelay="5.0" timeLoss="10.0"><emissions CO2_abs="2000000" fuel_abs="742000"/>'
        '</tripinfo><tripinfo id="1" departDelay="0.0" timeLoss="45.0"/></tripinfos>'
    )
    found = trip_measures(path, ["ramp_0"], {"0": "main", "1": "ramp_0"})
    assert found["main_delay"] == 15.0
    assert found["ramp_delay"] == 45.0
    assert found["fuel"] == pytest.approx(1.0)
    assert found["co2"] == pytest.approx(2.0)
    assert found["gini"] == pytest.approx(0.25)
