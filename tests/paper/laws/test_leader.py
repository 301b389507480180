"""The actual leader in both readings: who is ahead, virtual vehicles, the ramp's end, gaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.paper.laws.leader import Vehicle, actual_leader, gap_to, nearest_ahead
from rampcast.paper.laws.mode import Mode

pytestmark = pytest.mark.usefixtures("double_precision")

X, RAMP_END = 100.0, 230.0
BOTH_MODES = pytest.mark.parametrize("mode", list(Mode))


def vehicle(x: float, v: float = 8.0, length: float = 5.0, *, present: bool = True) -> Vehicle:
    return Vehicle(np.array(x), np.array(v), np.array(length), np.array(present))


def standing(x: float) -> Vehicle:
    """Returns a virtual vehicle."""
    return vehicle(x, 0.0, 0.0, present=False)


BEHIND = (vehicle(90.0), vehicle(80.0))
NOBODY_AHEAD = (standing(500.0), standing(500.0), *BEHIND)


def lead(leader: Vehicle, target: tuple[Vehicle, ...], mode: Mode, x: float = X) -> Vehicle:
    return actual_leader(np.array(x), ramp=(leader,), target=target, ramp_end=RAMP_END, mode=mode)


@BOTH_MODES
def test_the_nearest_of_the_vehicles_ahead_is_chosen_whatever_its_slot(mode):
    target = (vehicle(140.0), vehicle(160.0), vehicle(104.0, 9.0, 7.0), vehicle(99.0))
    p = nearest_ahead(np.array(X), target, mode=mode)
    assert (float(p.x), float(p.v), float(p.length), bool(p.present)) == (104.0, 9.0, 7.0, True)


@BOTH_MODES
def test_a_vehicle_abreast_counts_as_ahead(mode):
    p = nearest_ahead(np.array(X), (vehicle(120.0), vehicle(X, 3.0)), mode=mode)
    assert (float(p.x), float(p.v)) == (X, 3.0)


@BOTH_MODES
def test_nobody_is_ahead_of_the_first_vehicle(mode):
    assert not nearest_ahead(np.array(X), BEHIND, mode=mode).present


@BOTH_MODES
def test_a_leader_that_is_not_there_is_followed_on_no_lane_not_even_one_that_goes_on(mode):
    target = (vehicle(120.0, 7.0), *BEHIND, vehicle(X - 1))
    found = actual_leader(np.array(X), ramp=(standing(503.0),), target=target, ramp_end=np.inf, mode=mode)
    assert (float(found.x), float(found.v)) == (120.0, 7.0)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(st.floats(-100, 300), st.booleans()), min_size=4, max_size=4), st.sampled_from(Mode))
def test_the_choice_is_that_of_a_search_through_a_list(others, mode):
    found = nearest_ahead(np.array(X), tuple(vehicle(x, present=there) for x, there in others), mode=mode)
    ahead = [x for x, there in others if x >= X and (there or mode is Mode.PAPER)]
    assert bool(found.present) == bool(ahead)
    if ahead:
        assert float(found.x) == min(ahead)


@BOTH_MODES
def test_behind_the_ramps_end_the_actual_leader_is_half_way_between_both(mode):
    # positions (120 + 150) / 2, speeds (6 + 10) / 2, lengths (4 + 12) / 2
    m = lead(vehicle(120.0, 6.0, 4.0), (vehicle(150.0, 10.0, 12.0), vehicle(170.0), *BEHIND), mode)
    assert (float(m.x), float(m.v), float(m.length), bool(m.present)) == (135.0, 8.0, 8.0, True)


@BOTH_MODES
@pytest.mark.parametrize("x", [RAMP_END, 260.0])
def test_an_immediate_leader_at_or_past_the_ramps_end_is_not_followed(mode, x):
    m = lead(vehicle(x, 6.0), (vehicle(150.0, 10.0, 12.0), *BEHIND), mode)
    assert (float(m.x), float(m.v), float(m.length)) == (150.0, 10.0, 12.0)


@BOTH_MODES
def test_the_virtual_leader_at_the_ramps_end_is_not_followed(mode):
    m = lead(standing(RAMP_END), (vehicle(150.0, 10.0), *BEHIND), mode)
    assert (float(m.x), float(m.v)) == (150.0, 10.0)


@BOTH_MODES
def test_without_anybody_ahead_a_vehicle_drives_freely(mode):
    m = lead(standing(RAMP_END), BEHIND, mode)
    assert not m.present
    assert float(gap_to(np.array(X), m, mode=mode)) == np.inf


def test_paper_mode_follows_the_standing_vehicle_at_500_metres_and_corrected_mode_ignores_it():
    paper, corrected = (lead(standing(RAMP_END), NOBODY_AHEAD, mode) for mode in Mode)
    assert (float(paper.x), float(paper.v), bool(paper.present)) == (500.0, 0.0, True)
    assert float(gap_to(np.array(X), paper, mode=Mode.PAPER)) == 400.0
    assert not corrected.present


def test_paper_mode_meets_a_standing_vehicle_half_way_and_corrected_mode_follows_the_immediate_leader_alone():
    own = vehicle(120.0, 6.0, 4.0)
    paper, corrected = (lead(own, NOBODY_AHEAD, mode) for mode in Mode)
    assert (float(paper.x), float(paper.v)) == (310.0, 3.0)  # half-way to (500 m, 0 m/s)
    assert (float(corrected.x), float(corrected.v), float(corrected.length)) == (120.0, 6.0, 4.0)


def test_with_nobody_at_all_in_the_target_lane_only_corrected_mode_follows_the_immediate_leader():
    paper, corrected = (lead(vehicle(120.0), BEHIND, mode) for mode in Mode)
    assert not paper.present
    assert corrected.present


def test_what_a_virtual_vehicle_holds_does_not_matter_in_corrected_mode():
    one = lead(standing(RAMP_END), (standing(110.0), vehicle(150.0), *BEHIND), Mode.CORRECTED)
    other = lead(standing(105.0), (standing(-500.0), vehicle(150.0), *BEHIND), Mode.CORRECTED)
    assert [float(value) for value in one] == [float(value) for value in other]


@BOTH_MODES
def test_the_immediate_leader_is_found_anew(mode):
    """The leader of t = 0 was passed, to x = 90, and the follower of t = 0 is ahead now, at 120: half-way to 140."""
    target = (vehicle(140.0, 6.0), *BEHIND)
    found = actual_leader(
        np.array(X), ramp=(vehicle(90.0, 2.0), vehicle(120.0, 4.0)), target=target, ramp_end=RAMP_END, mode=mode
    )
    assert (float(found.x), float(found.v)) == (130.0, 5.0)
    assert float(lead(vehicle(90.0, 2.0), target, mode).x) == 140.0  # with nobody ahead on the ramp


def test_the_gap_is_front_to_front_in_paper_mode_and_net_in_corrected_mode():
    m = vehicle(112.0, length=5.0)
    assert float(gap_to(np.array(X), m, mode=Mode.PAPER)) == 12.0
    assert float(gap_to(np.array(X), m, mode=Mode.CORRECTED)) == 7.0


@BOTH_MODES
def test_many_scenes_and_steps_are_led_at_once(mode):
    rng = np.random.default_rng(0)

    def some(low: float, high: float) -> Vehicle:
        shape = (3, 20)
        return Vehicle(
            rng.uniform(low, high, shape), rng.uniform(0, 9, shape), np.full(shape, 5.0), rng.random(shape) < 0.7
        )

    x, own, target = rng.uniform(90, 110, (3, 20)), some(100, 260), tuple(some(80, 130) for _ in range(4))
    together = actual_leader(x, ramp=(own,), target=target, ramp_end=RAMP_END, mode=mode)
    pick = (1, 7)
    alone = lead(
        Vehicle(*(values[pick] for values in own)),
        tuple(Vehicle(*(values[pick] for values in each)) for each in target),
        mode,
        x=x[pick],
    )
    assert [float(values[pick]) for values in together] == [float(value) for value in alone]
