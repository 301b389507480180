"""Distances have the sign that their docstrings give."""

import pytest

from rampcast.physics.gap import front_gap, net_gap

pytestmark = pytest.mark.usefixtures("double_precision")


def test_the_front_gap_is_positive_while_the_leader_is_ahead():
    assert float(front_gap(100.0, 112.0)) == 12.0
    assert float(front_gap(112.0, 100.0)) == -12.0


def test_the_net_gap_ends_at_the_leaders_rear_bumper():
    assert float(net_gap(100.0, 112.0, 5.0)) == 7.0
    assert float(net_gap(100.0, 104.0, 5.0)) == -1.0  # they overlap
