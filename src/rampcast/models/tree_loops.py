"""The compiled loops of what is learned from tables: walks down trees, and ranks among quantiles."""

from typing import Any, no_type_check

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
@no_type_check
def sums(
    table: Any, feature: Any, threshold: Any, missing_left: Any, left: Any, root: Any, value: Any, width: Any,
    most: Any, out: Any,
) -> None:  # fmt: skip
    """Adds to out what all trees predict for each row; see `trees.Trees`.

    Args:
        most: branches of a tree that may wait at once: its levels, and one.
        out: zeros, by row and output.
    """
    waiting, weights = np.empty(most, np.int64), np.empty(most)
    for row in range(table.shape[0]):
        for tree in range(len(root)):
            waiting[0], weights[0], count = root[tree], 1.0, 1
            while count > 0:
                count -= 1
                node, weight = waiting[count], weights[count]
                while left[node] != node:
                    cell, wide = table[row, feature[node]], width[feature[node]]
                    beyond = cell - threshold[node]
                    if np.isnan(cell):
                        node = left[node] + (0 if missing_left[node] else 1)
                    elif beyond <= -wide:
                        node = left[node]
                    elif beyond >= wide:
                        node = left[node] + 1
                    else:
                        right = 0.5 + 0.5 * beyond / wide
                        waiting[count], weights[count] = left[node] + 1, weight * right
                        count += 1
                        node, weight = left[node], weight * (1.0 - right)
                for n in range(value.shape[1]):
                    out[row, n] += weight * value[node, n]


@numba.njit(cache=True, nogil=True)
@no_type_check
def ranks(table: Any, quantiles: Any, levels: Any, out: Any) -> None:
    """Fills out with the rank of each value among the quantiles of its column; NaN stays.

    Where a value is several quantiles at once it is in the middle of their ranks.

    Args:
        table: values by row and column.
        quantiles: of each column, by level.
        levels: of the quantiles, rising, and the same from either end.
        out: ranks from the first to the last level.
    """
    last = len(levels) - 1
    for column in range(table.shape[1]):
        known = quantiles[:, column].copy()
        for row in range(table.shape[0]):
            value = table[row, column]
            if np.isnan(value):
                out[row, column] = value
                continue
            above = np.searchsorted(known, value, side="right")  # of the first quantile beyond the value
            low = high = levels[0] if above == 0 else levels[last]
            if 0 < above <= last:
                share = (value - known[above - 1]) / (known[above] - known[above - 1])
                low = high = levels[above - 1] + share * (levels[above] - levels[above - 1])
            if above > 0 and known[above - 1] == value:  # and maybe several before it
                low = levels[np.searchsorted(known, value, side="left")]
            out[row, column] = (low + high) / 2.0
