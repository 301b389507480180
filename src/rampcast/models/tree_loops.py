"""The compiled loops of what is learned from tables: walks down trees, and ranks among quantiles."""

from typing import Any, no_type_check

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
@no_type_check
def leaves(table: Any, feature: Any, threshold: Any, missing_left: Any, left: Any, root: Any, out: Any) -> None:
    """Fills out with the leaf of each tree in which each row ends; see `trees.Trees`."""
    for row in range(table.shape[0]):
        for tree in range(len(root)):
            node = root[tree]
            while left[node] != node:
                value = table[row, feature[node]]
                right = not missing_left[node] if np.isnan(value) else value > threshold[node]
                node = left[node] + (1 if right else 0)
            out[row, tree] = node


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
            first = np.searchsorted(known, value, side="left")
            if first < above:  # of the quantiles that the value is
                low = levels[first]
            out[row, column] = (low + high) / 2.0
