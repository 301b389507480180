"""Rules of metering, by numbers worked out by hand and by what must hold whatever the numbers."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rampcast.control.metering import (
    SLOWEST_RATE,
    RampState,
    alinea,
    fixed,
    hero,
    k_adaptive,
    pi_alinea,
    pred_alinea,
    queue_override,
)
from rampcast.simulate.plant import FASTEST_RATE

STATE = RampState(
    rate=600.0, occupancy=20.0, occupancy_before=18.0, density=25.0, queue=10.0, room=40.0, arrivals=500.0, period=30.0
)
STATES = st.builds(
    RampState,
    rate=st.floats(SLOWEST_RATE, FASTEST_RATE),
    occupancy=st.floats(0.0, 100.0),
    occupancy_before=st.floats(0.0, 100.0),
    density=st.floats(0.0, 140.0),
    queue=st.floats(0.0, 60.0),
    room=st.just(40.0),
    arrivals=st.floats(0.0, 1500.0),
    period=st.just(30.0),
    density_ahead=st.floats(-60.0, 60.0),
)
RULES = (alinea, pi_alinea, k_adaptive, pred_alinea)


def test_alinea_gives_70_vehicles_an_hour_less_for_each_percent_too_many():
    assert alinea(STATE, target=18.0) == pytest.approx(600.0 - 2 * 70.0)
    assert alinea(STATE, target=20.0) == 600.0


def test_pi_alinea_reacts_to_the_change_too():
    assert pi_alinea(STATE, target=18.0, proportional=50.0) == pytest.approx(600.0 - 50.0 * 2 - 70.0 * 2)


def test_k_adaptive_keeps_the_rate_at_the_density_wished_for_and_takes_all_it_may_at_the_jam():
    assert k_adaptive(STATE, target=25.0) == 600.0
    assert k_adaptive(replace(STATE, density=0.0), target=25.0, strength=0.3) == pytest.approx(780.0)
    assert k_adaptive(replace(STATE, density=110.0), target=25.0, strength=0.3) == pytest.approx(420.0)


def test_a_forecast_of_more_density_lowers_the_rate_and_none_is_alinea():
    assert pred_alinea(STATE, target=18.0) == alinea(STATE, target=18.0)
    more = replace(STATE, density_ahead=2.0)
    assert pred_alinea(more, target=18.0) == pytest.approx(600.0 - 70.0 * (2.0 + 0.94))
    assert pred_alinea(more, target=18.0, weight=0.0) == alinea(STATE, target=18.0)


def test_a_full_ramp_is_let_go_and_a_short_queue_changes_nothing():
    assert queue_override(300.0, STATE) == 300.0
    # 34 of 40 places: 2 above 80 %; to be rid of them within 30 s takes 240 vehicles/h more than arrive
    assert queue_override(300.0, replace(STATE, queue=34.0)) == pytest.approx(740.0)


def test_ramps_upstream_hold_back_for_a_master_with_a_queue():
    calm = replace(STATE, occupancy=5.0, queue=2.0, arrivals=300.0)
    crowded = replace(STATE, occupancy=30.0, queue=30.0)
    alone = [alinea(one, target=18.0) for one in (calm, calm, crowded)]
    rates = hero([calm, calm, crowded], target=18.0)
    filled = 34.0 / 120.0
    assert rates[2] == alone[2]
    assert rates[0] == rates[1] == max(SLOWEST_RATE, min(alone[0], 300.0 + 3600.0 * (2.0 - filled * 40.0) / 30.0))
    assert rates[0] < alone[0]
    assert hero([calm, calm, calm], target=18.0) == [alinea(calm, target=18.0)] * 3
    assert hero([crowded, calm, calm], target=18.0)[1:] == [alinea(calm, target=18.0)] * 2


@given(STATES, st.floats(1.0, 60.0))
def test_every_rate_can_be_shown_by_a_light(state, target):
    rates = [rule(state, target=target) for rule in RULES] + [fixed(state, rate=10.0 * target)]
    rates += [queue_override(rate, state) for rate in rates] + hero([state, state], target=target)
    assert all(SLOWEST_RATE <= rate <= FASTEST_RATE for rate in rates)


@given(STATES, st.floats(0.0, 20.0))
def test_more_occupancy_or_density_never_gives_a_higher_rate(state, more):
    fuller = replace(state, occupancy=state.occupancy + more, density=state.density + more)
    for rule in RULES:
        assert rule(fuller, target=20.0) <= rule(state, target=20.0) + 1e-9


@given(STATES, st.floats(SLOWEST_RATE, FASTEST_RATE))
def test_the_override_never_holds_back(state, rate):
    assert queue_override(rate, state) >= rate
