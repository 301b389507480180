"""What every law of the table must hold to."""

import math

import numpy as np
import pytest

from rampcast.forecasters import label, positions
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode

pytestmark = pytest.mark.usefixtures("double_precision")

EVERY_LAW = pytest.mark.parametrize("law", list(LAWS.values()), ids=list(LAWS))


def test_laws_are_known_by_name_and_the_papers_gipps_is_told_from_gipps_own():
    assert {name: label(name) for name in LAWS} == {
        "idm": "IDM",
        "gipps_paper": "Gipps (paper)",
        "ghr": "GHR",
        "gipps": "Gipps (1981)",
    }
    assert all(law.name == name for name, law in LAWS.items())
    assert set(LAWS) <= set(positions())


@EVERY_LAW
def test_the_record_the_ranges_and_the_published_values_name_the_same_parameters_in_the_same_order(law):
    names = [bound.name for bound in law.bounds]
    assert list(law.parameters._fields) == names
    assert [spread.name for spread in law.published if spread.name != "mse"] == names
    assert [bound.name for bound in law.ranges(Mode.CORRECTED)] == names
    assert len(law.fallback) == len(names)


@EVERY_LAW
@pytest.mark.parametrize("mode", list(Mode))
def test_the_fallback_and_the_published_medians_lie_within_the_ranges(law, mode):
    for bound, value, spread in zip(law.ranges(mode), law.fallback, law.published, strict=False):
        assert bound.low < bound.high
        assert bound.low <= value <= bound.high
        assert bound.low <= spread.median <= bound.high


@EVERY_LAW
def test_in_paper_mode_the_ranges_are_those_in_print(law):
    assert law.ranges(Mode.PAPER) == law.bounds


def test_net_of_a_car_of_four_and_a_half_metres_the_standing_gap_of_the_idm_begins_lower():
    law = LAWS["idm"]
    printed, net = law.ranges(Mode.PAPER), law.ranges(Mode.CORRECTED)
    assert (net[0].low, net[0].high) == (printed[0].low - 4.5, printed[0].high - 4.5)
    assert net[1:] == printed[1:]


@EVERY_LAW
def test_every_corner_of_the_ranges_gives_a_finite_acceleration_in_every_state(law):
    """Standing vehicles, equal speeds, overlaps and an empty road included."""
    corners = np.array(np.meshgrid(*((bound.low, bound.high) for bound in law.ranges(Mode.CORRECTED)))).reshape(
        len(law.bounds), -1, 1
    )
    states = np.array(np.meshgrid([0.0, 1e-9, 7.0, 30.0], [0.0, 7.0, 30.0], [-9.0, 0.0, 7.0, 400.0, math.inf]))
    speed, leader_speed, gap = states.reshape(3, -1)
    found = law.acceleration(law.parameters(*corners), speed=speed, leader_speed=leader_speed, gap=gap)
    assert found.shape == (corners.shape[1], len(speed))
    assert np.isfinite(found).all()


@EVERY_LAW
def test_a_driver_of_the_fallback_brakes_in_an_emergency_unless_the_law_gives_it_no_will(law):
    found = float(law.acceleration(law.parameters(*law.fallback), speed=15.0, leader_speed=2.0, gap=8.0))
    assert found < 0.0 or law.fallback[0] == found == 0.0


@EVERY_LAW
def test_the_limits_of_a_roll_out_lie_on_both_sides_of_zero(law):
    """Erratum 3: as printed the lower limit is +B, and nobody could brake."""
    for end in ("low", "high"):
        drivers = law.parameters(*(np.array([getattr(bound, end)]) for bound in law.bounds))
        lowest, highest = law.limits(drivers)
        assert float(lowest[0]) < 0.0 < float(highest[0])
