"""What rules ask of a forecast, by futures that are made up."""

import numpy as np
import pytest

from rampcast.control.ahead import density_change, gap_chance, makes_room, slows_ahead
from rampcast.control.futures import Shuffled, constant_speeds, forecast_of
from tests.control.made_up import RAMP, SITE, forecast, past


def test_constant_speeds_drive_on_and_merge_in_the_middle_of_the_lane():
    found = forecast((290.0, RAMP, 10.0), (100.0, 1, 20.0))
    assert found.samples[:, 0, -1] == pytest.approx([440.0, 400.0])
    assert found.lane[0, 0, 0] == RAMP
    assert found.lane[0, 0, -1] == SITE.target_lane
    assert found.lane[1, 0, -1] == 1
    assert found.merge_time[0, 0] == pytest.approx(11.1)  # 110 m to the middle of the lane, in the step after


def test_who_comes_into_the_merge_raises_its_density_and_who_merges_too():
    coming = forecast((200.0, 1, 20.0), (290.0, RAMP, 12.0))
    # both are there after 10 s: two vehicles on 300 m of two lanes
    assert density_change(coming, ahead=10.0) == pytest.approx(2.0 / 0.6)
    assert density_change(forecast((599.0, 1, 20.0)), ahead=10.0) == pytest.approx(-1.0 / 0.6)
    assert density_change(forecast(), ahead=10.0) == 0.0


def test_a_gap_is_none_where_somebody_drives_and_one_where_nobody_does():
    asked = {"place": 360.0, "arrival": 10.0, "lead": 0.8, "lag": 0.8}
    assert gap_chance(forecast((160.0, 2, 20.0)), **asked) == 0.0  # at the place just then
    assert gap_chance(forecast((160.0, 1, 20.0)), **asked) == 1.0  # in the other lane
    assert gap_chance(forecast((60.0, 2, 20.0)), **asked) == 1.0  # 5 s behind it
    assert gap_chance(forecast(), **asked) == 1.0


def test_a_chance_is_the_share_of_the_futures():
    one = forecast((160.0, 2, 20.0))
    x = np.concatenate([one.samples, one.samples + 100.0, one.samples - 100.0, one.samples], axis=1)
    several = forecast_of(past((160.0, 2, 20.0)), x, np.repeat(one.lane, 4, axis=1))
    assert gap_chance(several, place=360.0, arrival=10.0, lead=0.8, lag=0.8) == 0.5


def test_who_will_be_behind_a_merge_is_found():
    found = forecast((350.0, RAMP, 20.0), (340.0, 2, 20.0), (250.0, 2, 20.0), (340.0, 1, 20.0))
    assert makes_room(found, within=8.0, chance=0.5) == [2]
    assert makes_room(forecast(), within=8.0, chance=0.5) == []


def test_the_speed_to_come_beside_the_ramp_is_that_of_who_will_be_there():
    assert slows_ahead(forecast((250.0, 1, 15.0), (10.0, 1, 30.0)), ahead=10.0) == pytest.approx((15.0 + 30.0) / 2)
    assert np.isnan(slows_ahead(forecast((250.0, 1, 30.0)), ahead=10.0))


def test_a_shuffled_forecast_is_of_the_same_vehicles_and_another_future():
    slow, fast = past((100.0, 2, 5.0), (290.0, RAMP, 5.0), time=0.0), past((120.0, 2, 25.0), time=100.0)
    shuffled = Shuffled(constant_speeds, np.random.default_rng(1))
    shuffled(slow)
    found = shuffled(fast)
    assert found.vehicle.tolist() == [1]
    assert found.start == pytest.approx([120.0])
    assert found.samples[0, 0, -1] == pytest.approx(120.0 + 75.0)  # as the slow one drove


def test_what_is_not_of_the_last_4_s_is_forgotten():
    found = past((100.0, 2, 5.0), time=0.0)
    found.add(3.9, found.newest)
    assert len(found.rows().time) == 2
    found.add(4.5, found.newest)
    assert found.rows().time.tolist() == [3.9, 4.5]
