"""The Kaplan-Meier estimate of how long something lasts, when some were not seen to the end."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

SAME_TIME = 1e-6  # [s]; times of recordings are multiples of 0.1 s, give or take rounding
LEAST_AT_RISK = 5  # of fewer an estimate is not carried on


@dataclass(frozen=True)
class Survival:
    """A survival curve: 1 at first, and constant between its events.

    Attributes:
        time: of each event, increasing [s].
        share: that lasts longer.
        at_risk: how many were still seen just before each event.
    """

    time: Float[np.ndarray, "event"]
    share: Float[np.ndarray, "event"]
    at_risk: Float[np.ndarray, "event"]

    def at(self, time: Float[np.ndarray, "*many"]) -> Float[np.ndarray, "*many"]:
        """Returns the share that lasts longer than each time [s]."""
        return np.append(1.0, self.share)[np.searchsorted(self.time, time + SAME_TIME, side="right")]

    def before(self, time: Float[np.ndarray, "*many"]) -> Float[np.ndarray, "*many"]:
        """Returns the share that lasts until each time [s] or longer."""
        return np.append(1.0, self.share)[np.searchsorted(self.time, time - SAME_TIME, side="left")]

    def within(
        self, waited: Float[np.ndarray, "case"], time: Float[np.ndarray, "step"]
    ) -> Float[np.ndarray, "case step"]:
        """Returns the probability to end within each time for those that have lasted a while [s].

        Those that have lasted longer than until the last but one event at which `LEAST_AT_RISK` were still seen are
        taken to have lasted until then: of longer ones nothing is known.
        """
        known = self.time[self.at_risk >= LEAST_AT_RISK]
        latest = known[-2] if len(known) > 1 else 0.0
        waited = np.minimum(waited, latest)[:, None]
        lasted = self.at(waited)
        still = self.at(waited + time) / np.where(lasted > 0.0, lasted, 1.0)
        return np.where(lasted > 0.0, 1.0 - still, 1.0)


def kaplan_meier(
    time: Float[np.ndarray, "case"],
    ended: Bool[np.ndarray, "case"],
    *,
    entered: Float[np.ndarray, "case"] | None = None,
) -> Survival:
    """Returns the survival curve S(t) = prod (1 - d / n) over the event times up to t.

    d end at an event time; n are at risk: watched before it, and seen until then at least. Source: Kaplan and Meier
    1958, eq. 2b.

    Args:
        time: until the end, or until the case was seen last [s].
        ended: whether the end was seen.
        entered: from when on each case was watched [s]; default: from the beginning.
    """
    time = np.round(time / SAME_TIME) * SAME_TIME
    entered = np.full(len(time), -np.inf) if entered is None else entered
    at, ends = np.unique(time[ended], return_counts=True)
    still = len(time) - np.searchsorted(np.sort(time), at - SAME_TIME)
    late = len(time) - np.searchsorted(np.sort(entered), at - SAME_TIME)
    at_risk = (still - late).astype(np.float64)
    return Survival(at, np.cumprod(1.0 - ends / np.maximum(at_risk, 1.0)), at_risk)
