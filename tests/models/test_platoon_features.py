"""What the correction is told of a platoon at t = 0."""

from dataclasses import replace

import numpy as np

from rampcast.models.platoon_features import features
from tests.models.platoons_made_up import drive


def test_the_traffic_around_is_told_by_how_much_faster_it_is_and_where_nothing_is_known_nothing_is_told():
    platoons = drive(4, seed=1).platoons
    unknown = features(platoons)
    speeds = np.array([[3.0, np.nan, 9.0, 1.0, 2.0, 4.0, 5.0], [8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0]])
    told = features(replace(platoons, traffic=np.broadcast_to(speeds, (4, *speeds.shape))))
    count = speeds.size
    assert np.isnan(unknown[:, -count:]).all()
    np.testing.assert_array_equal(told[:, :-count], unknown[:, :-count])
    np.testing.assert_allclose(told[:, -count:], speeds.ravel() - platoons.v[:, :1, -1])
