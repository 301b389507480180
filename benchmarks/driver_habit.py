"""Prints how far drivers err behind their true leaders, with and without the habit of keeping the gap of now.

Run: python benchmarks/driver_habit.py (needs the recordings in RAMPCAST_DATA)

One driver for all of a data set's training part, on its test part: mean error [m] at 1, 3, 5, 10 and 15 s.
"""

import numpy as np

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.data_sets import DATA_SETS
from rampcast.benchmark.run import default_folder
from rampcast.benchmark.splits import split
from rampcast.models.drivers import behind_leader, fit_drivers, with_habit
from rampcast.models.pooled_driver import fit_pooled_driver
from rampcast.simulate.shipped import shipped_sample

SETS = ("i80_pairs_three_windows", "i80_car_following_pairs", "i75_platoon", "simulated")
STEPS = np.array([4, 14, 24, 49, 74])


def main() -> None:
    """Prints a Markdown table."""
    print("| data set | habit | 1 s | 3 s | 5 s | 10 s | 15 s |\n|---|---:|---:|---:|---:|---:|---:|")
    for name in SETS:
        data_set = DATA_SETS[name]
        train, test = split(data_set.read(data_set.find(default_folder()) or list(shipped_sample()))).parts[0]
        train, test = (_led(cases) for cases in (train, test))
        plain = fit_pooled_driver(train.platoons, train.truth, leader_truth=train.leader_truth)
        prior = fit_drivers(train.platoons, train.truth, train.leader_truth)
        for driver, habit in ((plain, 0.0), (prior.centre, prior.habit)):
            print(
                f"| `{name}` | {habit:.2f} | "
                + " | ".join(f"{error:.2f}" for error in _errors(driver, habit, test))
                + " |"
            )


def _led(cases: Cases) -> Cases:
    return cases.select(cases.longitudinal & (cases.platoons.depth > 0))


def _errors(driver: np.ndarray, habit: float, cases: Cases) -> np.ndarray:
    driven = behind_leader(with_habit(driver[None], habit), cases.platoons, cases.leader_truth)[:, 0]
    known = np.logical_and.accumulate(np.isfinite(cases.leader_truth), axis=1)
    return np.nanmean(np.where(known, np.abs(driven - cases.truth), np.nan)[:, STEPS], axis=0)


if __name__ == "__main__":
    main()
