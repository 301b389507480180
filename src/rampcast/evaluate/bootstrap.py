"""Intervals of means by a bootstrap that draws whole groups: cases of one vehicle, or of one time, are alike."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Shaped

DRAWS = 1000
CONFIDENCE = 0.95
LEAST_GROUPS = 5  # draws of fewer say nothing of how far a mean scatters


@dataclass(frozen=True)
class Resampling:
    """One way to draw.

    Attributes:
        group: number of the group of each case.
        draws: how often each group comes in each draw of as many groups with replacement.
    """

    group: Int[np.ndarray, "case"]
    draws: Int[np.ndarray, "draw group"]

    def means(self, values: Float[np.ndarray, "case *kinds"]) -> Float[np.ndarray, "draw *kinds"]:
        """Returns the mean of each draw over what is known; NaN where nothing is."""
        flat = values.reshape(len(values), -1)
        known = np.isfinite(flat)
        of_group = np.eye(self.draws.shape[1])[self.group].T
        sums, counts = self.draws @ (of_group @ np.where(known, flat, 0.0)), self.draws @ (of_group @ known)
        means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
        return means.reshape(len(self.draws), *values.shape[1:])

    def ratios(
        self, values: Float[np.ndarray, "case *kinds"], others: Float[np.ndarray, "case *kinds"]
    ) -> Float[np.ndarray, "draw *kinds"]:
        """Returns the ratio of two means in each draw, over the cases in which both are known; NaN where it is none."""
        above, below = (self.means(one) for one in both_known(values, others))
        return np.where(below > 0, above / np.where(below > 0, below, 1.0), np.nan)


def both_known(
    values: Float[np.ndarray, "case *kinds"], others: Float[np.ndarray, "case *kinds"]
) -> tuple[Float[np.ndarray, "case *kinds"], Float[np.ndarray, "case *kinds"]]:
    """Returns both, NaN where one of them is."""
    known = np.isfinite(values) & np.isfinite(others)
    return np.where(known, values, np.nan), np.where(known, others, np.nan)


def resampling(group: Shaped[np.ndarray, "case"], *, seed: int = 1) -> Resampling:
    """Returns `DRAWS` draws of whole groups, which are given by name or number."""
    names, number = np.unique(group, return_inverse=True)
    share = np.full(len(names), 1 / len(names))
    return Resampling(number, np.random.default_rng(seed).multinomial(len(names), share, size=DRAWS))


def ways_to_draw(*groups: Shaped[np.ndarray, "case"]) -> list[Resampling]:
    """Returns draws by each of these groups, the first in any case, others only if there are `LEAST_GROUPS` of them."""
    some = [group for k, group in enumerate(groups) if k == 0 or len(np.unique(group)) >= LEAST_GROUPS]
    return [resampling(group) for group in some]


def widest(drawn: Sequence[Float[np.ndarray, "draw *kinds"]]) -> Float[np.ndarray, "2 *kinds"]:
    """Returns the ends of what holds 95 % of the draws, of that way to draw for which it is widest; NaN of none.

    Args:
        drawn: statistics of the draws, an array for each way.
    """
    found = np.array([interval(one) for one in drawn])  # way, end, kinds
    width = np.where(np.isfinite(found[:, 1] - found[:, 0]), found[:, 1] - found[:, 0], -1.0)
    return np.take_along_axis(found, width.argmax(axis=0)[None, None], axis=0)[0]


def interval(drawn: Float[np.ndarray, "draw *kinds"]) -> Float[np.ndarray, "2 *kinds"]:
    """Returns the ends of what holds 95 % of the draws that are known."""
    ends = np.full((2, *drawn.shape[1:]), np.nan)
    some = np.isfinite(drawn).any(axis=0)
    if some.any():
        ends[:, some] = np.nanquantile(drawn[:, some], ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2), axis=0)
    return ends
