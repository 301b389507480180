"""Made-up scenes for tests: random but plausible, with every kind of gap that real scenes have."""

import numpy as np
from jaxtyping import Bool, Float

from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.lane_change.features import FEATURE_NAMES
from rampcast.paper.lane_change.sets import Anchors, Reading
from rampcast.paper.scenes.scenes import CENTRAL, SLOTS, Scenes
from rampcast.sites import Lane, Site
from rampcast.traffic.anchors import A, E, U, V, X, Y

TEST_SITE = Site(
    name="test",
    title="a made-up on-ramp",
    simulated=True,
    length=500.0,
    speed_limit=29.0,
    gore=110.0,
    ramp_end=230.0,
    merge_zone=(110.0, 230.0),
    target_lane=6,
    lane_line=((0.0, -22.0), (500.0, -22.0)),
    lanes=(Lane(number=6, role="main", centre=-20.1), Lane(number=7, role="ramp", centre=-23.8)),
)

STANDING_X = np.array([0.0, 230.0, -500.0, 500.0, 500.0, -500.0, -500.0])  # of virtual vehicles; the central is none
LANE_Y = np.array([-23.8, -23.8, -23.8, -20.1, -20.1, -20.1, -20.1])
# x_n - x_i: from, to. Slots in the order of SLOTS.
OFFSET = np.array([[0, 0], [8, 40], [-40, -8], [1, 20], [22, 60], [-20, -1], [-60, -22]], dtype=float)


def random_scenes(rng: np.random.Generator, n: int, *, anchors_per_vehicle: int = 4) -> Scenes:
    """Returns n scenes of ceil(n / anchors_per_vehicle) vehicles, split over two windows.

    Vehicles move with constant acceleration. About a fifth of the neighbours is virtual; some histories and futures are
    cut; about a third of the vehicles is never seen to change lane. Who is nearer the lane line changes lane earlier.
    """
    number = np.arange(n) // anchors_per_vehicle
    virtual = rng.random((n, len(SLOTS))) < 0.2
    virtual[:, CENTRAL] = False
    now = _states_now(rng, n)
    change, seen_for = _change_times(rng, now[:, CENTRAL, Y])
    past_valid = _seen(rng, n, PAST)[:, :, ::-1] & ~virtual[..., None]
    past_valid[:, CENTRAL] = True
    future_valid = _seen(rng, n, FUTURE) & ~virtual[..., None]
    past = _move(now, np.arange(1 - PAST, 1) * STEP)
    past[virtual] = _standing()[np.nonzero(virtual)[1], None, :]
    future = np.where(future_valid[..., None], _move(now, np.arange(1, FUTURE + 1) * STEP), np.nan)
    future[virtual] = _standing()[np.nonzero(virtual)[1], None, :]
    length = np.where(virtual, 0.0, rng.uniform(4.0, 12.0, (n, len(SLOTS))))
    return Scenes(
        site=TEST_SITE,
        recording=np.where(number % 2 == 0, "test-1", "test-2"),
        vehicle=np.where(virtual, 0, number[:, None] // 2 * 10 + np.arange(1, len(SLOTS) + 1)),
        t0=np.arange(n) % anchors_per_vehicle * STEP + 4.0,
        lane=np.full(n, 7),
        virtual=virtual,
        length=length,
        past=past,
        past_valid=past_valid,
        role_past=past.copy(),
        role_virtual=np.repeat(virtual[..., None], PAST, axis=2),
        role_length=np.repeat(length[..., None], PAST, axis=2),
        future=future,
        future_valid=future_valid,
        change_label=change,
        change_crossing=np.where(rng.random(n) < 0.1, -STEP, change - STEP),
        seen_for=seen_for,
    )


def random_anchors(
    rng: np.random.Generator, n: int, *, anchors_per_vehicle: int = 40, reading: Reading = Reading.LABEL
) -> Anchors:
    """Returns n anchors, 0.2 s apart within a vehicle, whose first two features tell when the lane change comes.

    A fifth of the vehicles is never seen to change lane.
    """
    vehicle, number = np.divmod(np.arange(n), anchors_per_vehicle)
    last = (anchors_per_vehicle + rng.integers(0, 60, n))[vehicle * anchors_per_vehicle]
    never = (rng.random(n) < 0.2)[vehicle * anchors_per_vehicle]
    left = (last - number) * STEP
    features = rng.normal(size=(n, len(FEATURE_NAMES)))
    features[:, 0] += left / 2.0
    features[:, 1] += left / 4.0
    return Anchors(
        features=features,
        change_time=np.where(never, np.nan, left),
        seen_for=np.where(never, left, left + 5.0),
        vehicle=vehicle,
        reading=reading,
    )


def _states_now(rng: np.random.Generator, n: int) -> Float[np.ndarray, "scene slot feature"]:
    now = np.zeros((n, len(SLOTS), 6))
    now[..., X] = rng.uniform(80.0, 170.0, (n, 1)) + rng.uniform(OFFSET[:, 0], OFFSET[:, 1], (n, len(SLOTS)))
    now[..., Y] = LANE_Y + rng.normal(0.0, 0.4, (n, len(SLOTS)))
    now[..., V] = rng.uniform(4.0, 14.0, (n, len(SLOTS)))
    now[..., U] = rng.normal(0.0, 0.2, (n, len(SLOTS)))
    now[..., A] = rng.normal(0.0, 0.1, (n, len(SLOTS)))
    now[..., E] = rng.normal(0.0, 0.05, (n, len(SLOTS)))
    return now


def _change_times(
    rng: np.random.Generator, y: Float[np.ndarray, "scene"]
) -> tuple[Float[np.ndarray, "scene"], Float[np.ndarray, "scene"]]:
    time = np.clip(-6.0 * (y + 23.0) + rng.normal(0.0, 2.0, len(y)), 0.4, 20.0)
    time = np.round(time / STEP) * STEP
    never = rng.random(len(y)) < 0.3
    seen_for = np.round(np.where(never, rng.uniform(0.0, 20.0, len(y)), time + 3.0) / STEP) * STEP
    return np.where(never, np.nan, time), seen_for


def _seen(rng: np.random.Generator, n: int, steps: int) -> Bool[np.ndarray, "scene slot step"]:
    """Returns whether each slot is seen: from the first step to a random one, or to the last."""
    count = np.where(rng.random((n, len(SLOTS))) < 0.7, steps, rng.integers(1, steps + 1, (n, len(SLOTS))))
    return np.arange(steps) < count[..., None]


def _move(
    now: Float[np.ndarray, "scene slot feature"], time: Float[np.ndarray, "step"]
) -> Float[np.ndarray, "scene slot step feature"]:
    states = np.repeat(now[:, :, None, :], len(time), axis=2)
    states[..., X] += states[..., V] * time + states[..., A] * time**2 / 2
    states[..., Y] += states[..., U] * time + states[..., E] * time**2 / 2
    states[..., V] += states[..., A] * time
    states[..., U] += states[..., E] * time
    return states


def _standing() -> Float[np.ndarray, "slot feature"]:
    states = np.zeros((len(SLOTS), 6))
    states[:, X], states[:, Y] = STANDING_X, LANE_Y
    return states
