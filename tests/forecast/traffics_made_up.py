"""Made-up traffic of any kind, and a made-up model of how it goes on."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from rampcast.forecast.roll_out import Manners, RollOut
from rampcast.models.disturbance import Disturbance
from rampcast.models.drivers import DriverPrior
from rampcast.models.merging import FEATURES, MergeHazard
from rampcast.models.platoon_head import Head
from rampcast.sites import Site, load_site
from rampcast.sites.site import NO_LANE
from rampcast.traffic.moments import Traffic
from rampcast.traffic.stream import Stream

SITE = load_site("i80")
MAIN, RAMP = (4, 5, 6), 7
GOES_ON = replace(SITE, ramp_end=np.inf)
CENTRE = np.array([2.0, 1.2, 1.0, 2.0, 25.0, 4.0])


def model(*, hazard: float = -3.0, manners: Manners | None = None, seed: int = 0) -> RollOut:
    """Returns a roll-out of made-up drivers; those of the ramp are in more of a hurry."""
    rng = np.random.default_rng(seed)
    weights = rng.normal(0.0, 0.1, FEATURES)
    main, ramp = (_prior(rng, CENTRE * scale) for scale in (1.0, np.array([0.9, 0.8, 1.2, 1.2, 1.0, 1.0])))
    return RollOut(
        main=main,
        ramp=ramp,
        disturbance=Disturbance(),
        head=Head(20.0, 0.3, 0.5),
        hazard=MergeHazard(weights, hazard),
        manners=manners or Manners(0.5, 0.3, 0.03),
        limit=30.0,
    )


def _prior(rng: np.random.Generator, centre: np.ndarray) -> DriverPrior:
    drivers = centre * np.exp(np.column_stack([0.2 * rng.standard_normal((16, 5)), np.zeros(16)]))
    return DriverPrior(centre, 0.6, 0.2, 1.0, drivers)


def traffic_of(
    x: np.ndarray, v: np.ndarray, lane: np.ndarray, *, seen: np.ndarray, vehicle: np.ndarray, site: Site = SITE
) -> Traffic:
    """Returns traffic at constant speeds, each vehicle seen for so many tenths of a second up to t0."""
    stream = Stream(site, doubtful="accept")  # some are in each other
    centre = np.array([site.lane_centre(one) if one != NO_LANE else np.nan for one in lane.tolist()])
    length = 3.0 + np.arange(len(x)) % 4 * 3.0
    found = stream.push(-4.1, {"vehicle": vehicle[:0], "x": [], "y": []})
    for back in range(40, -1, -1):
        there = seen >= back
        frame = {"vehicle": vehicle, "x": x - 0.1 * back * v, "y": centre, "lane": lane, "length": length}
        found = stream.push(-0.1 * back, {name: values[there] for name, values in frame.items()})
    return found


@st.composite
def traffics(draw: st.DrawFn) -> Traffic:
    """Returns a strategy: any lanes, queues, overlaps, unknown lanes, places beyond the ramp's end, short histories."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.sampled_from((0, 1, 2, 6, 14)))
    crowded = draw(st.sampled_from((0.2, 1.0)))
    x = 40.0 + crowded * rng.uniform(0.0, 260.0, count)
    v = draw(st.sampled_from((0.0, 1.0))) * rng.uniform(0.0, 25.0, count)
    lane = rng.choice([*MAIN, RAMP, RAMP, NO_LANE], count)
    seen = rng.choice([4, 7, 20, 40], count)
    names = rng.choice(1000, count, replace=False)
    vehicle = names if draw(st.booleans()) else np.array([f"car {one}" for one in names], dtype=np.str_)
    return traffic_of(x, v, lane, seen=seen, vehicle=vehicle, site=draw(st.sampled_from((SITE, GOES_ON))))


def assert_possible(x: np.ndarray, lane: np.ndarray, *, start: np.ndarray, length: np.ndarray, end: np.ndarray) -> None:
    """Asserts that nobody reverses, overlaps the leader, or is beyond the end of its lane.

    Args:
        x, lane: fronts [m] and lanes, by vehicle, sample and step.
        start, length: front at t0 and length of each [m].
        end: of each lane [m], by the numbers in `lane`.
    """
    assert np.isfinite(x).all()
    step = np.diff(x, axis=2, prepend=np.broadcast_to(start[:, None, None], (*x.shape[:2], 1)).astype(x.dtype))
    assert step.min(initial=0.0) >= -1e-3
    assert (x <= end[lane] + 1e-3).all()
    order = np.lexsort((x, lane), axis=0)
    place, own, long = (np.take_along_axis(np.broadcast_to(values, x.shape), order, axis=0)
                        for values in (x, lane, length[:, None, None]))  # fmt: skip
    same = np.diff(own, axis=0) == 0
    gap = place[1:] - long[1:] - place[:-1]
    assert gap[same].min(initial=0.0) >= -1e-3
