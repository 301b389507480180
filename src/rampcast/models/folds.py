"""Folds for a cross-validation among vehicles that met on the same road: by vehicle, and by time."""

import numpy as np
from jaxtyping import Float, Int, Shaped

Fold = tuple[Int[np.ndarray, "_"], Int[np.ndarray, "_"]]  # positions of the training and of the test cases


def time_folds(
    group: Shaped[np.ndarray, "case"], begin: Float[np.ndarray, "case"], end: Float[np.ndarray, "case"], *, count: int
) -> list[Fold]:
    """Returns positions of training and test cases.

    The groups, in the order of their names' first numbers (windows) and of time, are cut into blocks; each block tests
    once. A case trains if it is of another group, and does not overlap in time with the block where it is of the same
    window. Without a clock (NaN) nothing is known to overlap.

    Args:
        group: name of the vehicle of each case, which begins with the number of its window.
        begin: first moment that the case uses, in its window's clock [s]; NaN without a clock.
        end: last moment [s]; NaN without a clock.
        count: of the blocks.
    """
    _, number = np.unique(group, return_inverse=True)
    window = np.array([int(name.split("-")[0]) for name in group.tolist()], dtype=np.int64)
    groups = number.max() + 1
    first = np.full(groups, np.inf)
    np.fmin.at(first, number, begin)
    of_group = np.zeros(groups, dtype=np.int64)
    of_group[number] = window
    parts = []
    for block in np.array_split(np.lexsort((first, of_group)), count):
        tests = np.isin(number, block)
        trains = ~tests
        for mine in (tests & (window == one) for one in np.unique(window[tests])):
            # comparisons with NaN are false: without a clock nothing overlaps
            overlap = (begin < np.fmax.reduce(end[mine])) & (end > np.fmin.reduce(begin[mine]))
            trains &= ~((window == window[mine][0]) & overlap)
        parts.append((np.flatnonzero(trains), np.flatnonzero(tests)))
    return parts
