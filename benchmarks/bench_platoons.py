"""Speed of the platoon forecaster: posteriors of drivers, and sampled roll-outs.

Run: python benchmarks/bench_platoons.py
Reach on two cores: posteriors of 5,000 vehicles a second; 1,000 platoons x 100 samples in less than 3 s.
"""

import numpy as np
from rampcast.forecast.platoon_roll_out import RollOut, sample_platoons

from measure import how_many, once, print_ratio, seconds
from rampcast.horizon import STEP
from rampcast.models.disturbance import Disturbance
from rampcast.models.drivers import DriverPrior, posterior
from rampcast.models.platoon_head import Head
from rampcast.traffic.platoons import CAR, HISTORY, PLACES, Platoons, no_traffic

VEHICLES, PLATOONS, SAMPLES, DRIVERS = how_many(10_000, tiny=20), how_many(1_000, tiny=4), how_many(100, tiny=5), 64
PLAIN = how_many(100, tiny=2)  # vehicles asked for one by one
CENTRE = np.array([2.0, 1.2, 1.0, 2.0, 20.0, 4.0])


def main() -> None:
    """Prints vehicles per second, and the time of 1,000 platoons at several depths."""
    offsets = 0.2 * np.random.default_rng(0).standard_normal((DRIVERS, 5))
    drivers = np.column_stack([CENTRE[:5] * np.exp(offsets), np.full(DRIVERS, CENTRE[5])])
    prior = DriverPrior(CENTRE, 0.2, 1.0, drivers)
    vehicles = queues(VEHICLES, leaders=1)
    took = seconds(lambda: posterior(prior, vehicles))
    print(f"posteriors of {DRIVERS} drivers: {VEHICLES / took:,.0f} vehicles/s")
    singles = [vehicles.select(np.array([row])) for row in range(PLAIN)]
    posterior(prior, singles[0])
    one_by_one = once(lambda: [posterior(prior, single) for single in singles]) / PLAIN
    print_ratio("posteriors a second over those one by one", one_by_one / (took / VEHICLES))
    model = RollOut(prior, Disturbance(), Head(), 30.0)
    for leaders in (1, 4, 8):
        platoons = queues(PLATOONS, leaders=leaders)
        took = seconds(lambda some=platoons: sample_platoons(model, some, samples=SAMPLES, seed=1))
        print(f"{PLATOONS:,} platoons with {leaders} leaders x {SAMPLES} samples: {took:.2f} s")


def queues(count: int, *, leaders: int) -> Platoons:
    """Returns platoons at about 10 m/s, 20 m apart."""
    rng = np.random.default_rng(1)
    back = np.arange(1 - HISTORY, 1) * STEP
    speed = rng.uniform(7.0, 13.0, (count, PLACES, 1))
    x = 20.0 * np.arange(PLACES)[:, None] + rng.uniform(0.0, 4.0, (count, PLACES, 1)) + speed * back
    valid = np.broadcast_to((np.arange(PLACES) <= leaders)[:, None], x.shape)
    x, v, a = (np.where(valid, values, np.nan) for values in (x, np.broadcast_to(speed, x.shape), np.zeros(x.shape)))
    length = np.where(valid[:, :, -1], 4.5, np.nan)
    return Platoons(x, v, a, valid, length, np.full(length.shape, CAR), no_traffic(len(x)))


if __name__ == "__main__":
    main()
