"""Rules of ramp metering: what is seen of a ramp in, a rate out. Plain functions, without a memory of their own.

Rates are in vehicles/h, occupancies in %, densities in vehicles/km and lane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rampcast.simulate.plant import FASTEST_RATE

SLOWEST_RATE: Final = 240.0  # [vehicles/h] a green each 15 s: FHWA, Ramp Metering Handbook 2006
FULL: Final = 0.8  # share of the room on a ramp from which its queue is let go
# Occupancy [%] of a density [vehicles/km and lane]: a point sensor is under a car of 4.7 m, the mean of those drawn
OCCUPANCY_OF_DENSITY: Final = 0.47


@dataclass(frozen=True)
class RampState:
    """What is known of a ramp when its rate is set anew.

    Attributes:
        rate: in effect until now [vehicles/h].
        occupancy: downstream of the merge, mean of the last period [%].
        occupancy_before: in the period before that [%].
        density: of the main lanes from the gore to the sensor downstream, mean of the last period [vehicles/km, lane].
        queue: vehicles before the stop line.
        room: for so many of them.
        arrivals: at the queue in the last period [vehicles/h].
        period: from one rate to the next [s].
        density_ahead: change of that density that is forecast; 0 where nobody forecasts.
    """

    rate: float
    occupancy: float
    occupancy_before: float
    density: float
    queue: float
    room: float
    arrivals: float
    period: float
    density_ahead: float = 0.0


def bounded(rate: float) -> float:
    """Returns a rate that a light can show."""
    return min(max(rate, SLOWEST_RATE), FASTEST_RATE)


def fixed(state: RampState, *, rate: float) -> float:
    """Returns the same rate at all times."""
    return bounded(rate)


def alinea(state: RampState, *, target: float, gain: float = 70.0) -> float:
    """Returns r(k) = r(k-1) + K_R [o* - o(k-1)].

    Source: Papageorgiou, Hadj-Salem and Blosseville 1991, "ALINEA: a local feedback control law for on-ramp metering",
    TRR 1320, eq. 1; K_R = 70 vehicles/h and % there.

    Args:
        state: of the ramp.
        target: o*, occupancy wished downstream [%].
        gain: K_R [vehicles/h for each %].
    """
    return bounded(state.rate + gain * (target - state.occupancy))


def pi_alinea(state: RampState, *, target: float, gain: float = 70.0, proportional: float = 150.0) -> float:
    """Returns r(k) = r(k-1) - K_P [o(k-1) - o(k-2)] + K_R [o* - o(k-1)].

    Source: Wang, Kosmatopoulos, Papageorgiou and Papamichail 2014, "Local ramp metering in the presence of a distant
    downstream bottleneck", IEEE T-ITS 15(5); by occupancy where they take densities.

    Args:
        state: of the ramp.
        target: o* [%].
        gain: K_R [vehicles/h for each %].
        proportional: K_P [vehicles/h for each %].
    """
    change = state.occupancy - state.occupancy_before
    return bounded(state.rate - proportional * change + gain * (target - state.occupancy))


def k_adaptive(state: RampState, *, target: float, jam: float = 110.0, strength: float = 0.3) -> float:
    """Returns r (1 + a) where a falls with the density of the segment: 0 at the one wished for, -strength at the jam.

    Source: the idea of Minnesota's density-based adaptive metering, Kwon and Park 2012, "Development of freeway
    operational strategies with IRIS-in-loop simulation", MnDOT 2012-04; the straight lines and numbers are ours.

    Args:
        state: of the ramp.
        target: density wished for [vehicles/km, lane].
        jam: density of standing vehicles [vehicles/km, lane].
        strength: largest change of the rate in one period, as a share of it.
    """
    if state.density <= target:
        change = strength * (target - state.density) / target
    else:
        change = -strength * (min(state.density, jam) - target) / (jam - target)
    return bounded(state.rate * (1.0 + change))


def pred_alinea(state: RampState, *, target: float, gain: float = 70.0, weight: float = 1.0) -> float:
    """Returns ALINEA's rate for the occupancy that is to come: o(k-1) + w c dK.

    dK is the forecast change of the density between gore and sensor, c turns densities into occupancies. Ours.

    Args:
        state: of the ramp.
        target: o* [%].
        gain: K_R [vehicles/h for each %].
        weight: w, of the forecast; 0 is ALINEA.
    """
    to_come = state.occupancy + weight * OCCUPANCY_OF_DENSITY * state.density_ahead
    return bounded(state.rate + gain * (target - to_come))


def queue_override(rate: float, state: RampState) -> float:
    """Returns the rate, or the one that keeps the queue at 80 % of its room if that is higher: -[w_max - w] / T + d.

    Source: Smaragdis and Papageorgiou 2003, "Series of new local ramp metering strategies", TRR 1856, eq. 8.
    """
    keeps = state.arrivals + 3600.0 * (state.queue - FULL * state.room) / state.period
    return bounded(max(rate, keeps))


def hero(states: Sequence[RampState], *, target: float, gain: float = 70.0, starts: float = 0.3) -> list[float]:
    """Returns rates of ramps along a road, in driving order: those upstream help the one before a bottleneck.

    Each ramp runs ALINEA. While the queue of one fills more than `starts` of its room and its rate is held down, it is
    the master, and the ramps upstream of it hold queues that fill as great a share of their rooms as all of these fill
    of all rooms: r <= -[w_min - w] / T + d.

    Source: Papamichail and Papageorgiou 2008, "Traffic-responsive linked ramp-metering control", IEEE T-ITS 9(1); of
    several masters the one farthest downstream leads, and none is kept by hysteresis.

    Args:
        states: of the ramps.
        target: o* of each [%].
        gain: K_R [vehicles/h for each %].
        starts: share of the room from which a master is helped.
    """
    rates = [alinea(state, target=target, gain=gain) for state in states]
    masters = [k for k, one in enumerate(states) if k > 0 and one.queue > starts * one.room and rates[k] < FASTEST_RATE]
    if not masters:
        return rates
    master = max(masters)
    filled = sum(one.queue for one in states[: master + 1]) / sum(one.room for one in states[: master + 1])
    for k, one in enumerate(states[:master]):
        holds = one.arrivals + 3600.0 * (one.queue - filled * one.room) / one.period
        rates[k] = bounded(min(rates[k], holds))
    return rates
