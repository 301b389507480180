"""Speed of merge scenes: sampled roll-outs in which vehicles merge, beside the same laws in a plain loop.

Run: python benchmarks/bench_merges.py
Reach on two cores: 1,000 scenes x 100 samples in less than 3 s; all 20 on-ramp vehicles of a site with 60 vehicles in
view x 200 samples within 100 ms.
"""

import math

import numpy as np
from rampcast.forecast.merge_roll_out import MergeRollOut, sample_merges
from rampcast.forecast.platoon_roll_out import RollOut

from measure import how_many, once, print_ratio, seconds
from rampcast.horizon import FUTURE, STEP
from rampcast.models.disturbance import Disturbance
from rampcast.models.drivers import DriverPrior
from rampcast.models.merging import FEATURES, MergeHazard
from rampcast.models.platoon_head import Head
from rampcast.traffic.merge_scenes import BEHIND, TARGET_PLACES, MergeScenes
from rampcast.traffic.platoons import CAR, HISTORY, PLACES, Platoons, no_traffic

SCENES, SAMPLES, DRIVERS = how_many(1_000, tiny=4), how_many(100, tiny=5), 64
# The vehicles and samples of the frame that is to be forecast within 100 ms.
ON_RAMP, AT_ONCE = how_many(20, tiny=4), how_many(200, tiny=5)
PLAIN_SCENES, PLAIN_SAMPLES = 1, 4  # the plain loop is too slow for more
CENTRE = (2.0, 1.2, 1.0, 2.0, 20.0, 4.0)
LENGTH, LIMIT, TO_END, LOGIT = 4.5, 30.0, 150.0, -4.0


def main() -> None:
    """Prints both absolute times, and how many times faster the compiled program is than the plain loop."""
    model = roll_out()
    for leaders in (1, 8):
        took = seconds(lambda some=scenes(SCENES, leaders): sample_merges(model, some, samples=SAMPLES, seed=1))
        print(f"{SCENES:,} scenes with {leaders} ahead on the ramp x {SAMPLES} samples: {took:.2f} s")
    frame = scenes(ON_RAMP, 8)
    took = seconds(lambda: sample_merges(model, frame, samples=AT_ONCE, seed=1), repeats=21)
    print(f"{ON_RAMP} vehicles of one frame x {AT_ONCE} samples: {1000 * took:.0f} ms")
    few = scenes(PLAIN_SCENES, 8)
    plain = once(lambda: plain_loop(few)) / (PLAIN_SCENES * PLAIN_SAMPLES)
    many = scenes(SCENES, 8)
    ours = seconds(lambda: sample_merges(model, many, samples=SAMPLES, seed=1)) / (SCENES * SAMPLES)
    print(f"one future of one scene: {1e3 * ours:.3f} ms, in a plain loop {1e3 * plain:.0f} ms")
    print_ratio("futures a second over those of a plain loop", plain / ours)


def roll_out() -> MergeRollOut:
    """Returns a roll-out of made-up drivers, with the same hazard everywhere."""
    offsets = 0.2 * np.random.default_rng(0).standard_normal((DRIVERS, 5))
    centre = np.array(CENTRE)
    drivers = np.column_stack([centre[:5] * np.exp(offsets), np.full(DRIVERS, centre[5])])
    hazard = MergeHazard(np.zeros(FEATURES), LOGIT)
    return MergeRollOut(RollOut(DriverPrior(centre, 0.2, 1.0, drivers), Disturbance(), Head(), LIMIT), hazard)


def scenes(count: int, leaders: int) -> MergeScenes:
    """Returns scenes at about 10 m/s, 20 m apart, with all places of the target lane taken."""
    rng = np.random.default_rng(1)
    unknown = np.full(count, np.nan)
    own = lane(rng, 20.0 * np.arange(PLACES), np.arange(PLACES) <= leaders, count)
    target = lane(rng, 20.0 * (np.arange(TARGET_PLACES) - BEHIND) + 10.0, np.ones(TARGET_PLACES, dtype=bool), count)
    return MergeScenes(own, target, np.full(count, TO_END), unknown, unknown)


def lane(rng: np.random.Generator, place: np.ndarray, there: np.ndarray, count: int) -> Platoons:
    """Returns the vehicles of one lane of each scene."""
    shape = (count, len(place), HISTORY)
    speed = rng.uniform(7.0, 13.0, (count, len(place), 1))
    x = place[:, None] + rng.uniform(0.0, 4.0, speed.shape) + speed * np.arange(1 - HISTORY, 1) * STEP
    valid = np.broadcast_to(there[:, None], shape)
    x, v, a = (np.where(valid, values, np.nan) for values in (x, np.broadcast_to(speed, shape), np.zeros(shape)))
    length = np.where(valid[:, :, -1], LENGTH, np.nan)
    return Platoons(x, v, a, valid.copy(), length, np.full(length.shape, CAR), no_traffic(count))


def plain_loop(some: MergeScenes) -> None:
    """Drives the same scenes by the same laws: a loop over scenes, samples, steps and vehicles."""
    rng = np.random.default_rng(1)
    for scene in range(len(some)):
        for _ in range(PLAIN_SAMPLES):
            own, target = ([list(pair) for pair in states(part, scene)] for part in (some.own, some.target))
            waiting, threshold, gathered = list(own[:4]), rng.exponential(size=4), [0.0] * 4
            for _ in range(FUTURE):
                for number, vehicle in enumerate(waiting):
                    if vehicle in own and room(vehicle, target):
                        gathered[number] += math.log1p(math.exp(LOGIT))
                        if gathered[number] >= threshold[number]:
                            own.remove(vehicle)
                            target.append(vehicle)
                for group, end in ((own, TO_END), (target, math.inf)):
                    moved = [step(vehicle, ahead_of(vehicle, group), end, rng.normal()) for vehicle in group]
                    for vehicle, state in zip(group, moved, strict=True):
                        vehicle[:] = state


def states(part: Platoons, scene: int) -> list[tuple[float, float]]:
    """Returns place and speed of each vehicle of a lane."""
    return [(float(part.x[scene, k, -1]), float(part.v[scene, k, -1])) for k in np.flatnonzero(part.present[scene])]


def ahead_of(vehicle: list[float], group: list[list[float]]) -> list[float] | None:
    """Returns the nearest vehicle ahead."""
    return min((one for one in group if one[0] > vehicle[0]), key=lambda one: one[0], default=None)


def room(vehicle: list[float], target: list[list[float]]) -> bool:
    """Returns whether nobody of the target lane is abreast."""
    return all(abs(one[0] - vehicle[0]) > LENGTH for one in target)


def step(vehicle: list[float], leader: list[float] | None, end: float, kick: float) -> list[float]:
    """Returns place and speed 0.2 s later."""
    x, v = vehicle
    if leader is None:
        faster, farthest = v + 0.1 * kick, end
    else:
        s0, headway, most, comfortable, desired, exponent = CENTRE
        wish = s0 + headway * v + v * (v - leader[1]) / (2 * math.sqrt(most * comfortable))
        gap = max(leader[0] - LENGTH - x, 1.0)
        a = most * (1 - (max(v, 0.1) / desired) ** exponent - (wish / gap) ** 2)
        faster, farthest = v + STEP * (min(max(a, -comfortable), most) + 0.3 * kick), min(leader[0] - LENGTH, end)
    place = max(min(x + STEP * min(max(faster, 0.0), LIMIT), farthest), x)
    return [place, (place - x) / STEP]


if __name__ == "__main__":
    main()
