"""How speed, acceleration and jerk are distributed over the rows, before and after smoothing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.doctor.checks.motion import LARGEST_JERK
from rampcast.doctor.subject import Subject
from rampcast.physics.minimums import RECORDED_LIMIT
from rampcast.recording import columns as c
from rampcast.recording.cutting import FASTEST
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION

QUANTILES = (0.001, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999)
STAGES = ("before smoothing", "after smoothing")
UNITS = {"speed": "m/s", "acceleration": "m/s²", "jerk": "m/s³"}
LABELS = {"speed": "speed v [m/s]", "acceleration": "acceleration a [m/s²]", "jerk": "jerk [m/s³]"}
LIMITS = {
    "speed": (FASTEST,),
    "acceleration": (RECORDED_LIMIT, IMPOSSIBLE_ACCELERATION),
    "jerk": (LARGEST_JERK,),
}
# From, to and bars of the pictures; what lies beyond is counted in the outermost bars.
BARS = {"speed": (-5.0, 45.0, 50), "acceleration": (-12.0, 12.0, 96), "jerk": (-40.0, 40.0, 80)}


@dataclass(frozen=True)
class Distribution:
    """How a quantity is distributed over the rows, before or after smoothing.

    Attributes:
        quantity, unit, stage: as "acceleration", "m/s²", "before smoothing".
        samples: rows where it is known.
        quantiles: value at each share.
        beyond: share of rows whose absolute value is above each limit.
        histogram: columns left, right [unit] and share.
    """

    quantity: str
    unit: str
    stage: str
    samples: int
    quantiles: Mapping[float, float]
    beyond: Mapping[float, float]
    histogram: pl.DataFrame = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Returns the distribution as plain values, for json."""
        return {name: getattr(self, name) for name in ("quantity", "unit", "stage", "samples")} | {
            "quantiles": {str(share): value for share, value in self.quantiles.items()},
            "share_beyond": {str(limit): share for limit, share in self.beyond.items()},
        }


def distributions(subject: Subject) -> tuple[Distribution, ...]:
    """Returns the distributions that can be told: all six of a raw recording that can be smoothed."""
    before = {} if subject.recording.is_smoothed else dict(_before(subject))
    after = {} if subject.cleaned is None else dict(_after(subject))
    stages = zip(STAGES, (before, after), strict=True)
    return tuple(_distribution(what, stage, values) for stage, found in stages for what, values in found.items())


def _before(subject: Subject) -> Iterator[tuple[str, Float[np.ndarray, "row"]]]:
    yield "speed", subject.speed
    yield "acceleration", subject.raw_acceleration
    third = np.diff(subject.raw_acceleration, prepend=np.nan) / subject.time_step  # NaN after holes
    yield "jerk", np.where(subject.step == 1, third, np.nan)


def _after(subject: Subject) -> Iterator[tuple[str, Float[np.ndarray, "row"]]]:
    assert subject.cleaned is not None
    yield "speed", subject.cleaned.tracks[c.V].to_numpy()
    yield "acceleration", subject.cleaned.tracks[c.A].to_numpy()
    yield "jerk", subject.jerk


def _distribution(what: str, stage: str, values: Float[np.ndarray, "row"]) -> Distribution:
    known = np.sort(values[np.isfinite(values)])
    low, high, bars = BARS[what]
    edges = np.linspace(low, high, bars + 1)
    counts = np.diff(np.searchsorted(known, [-np.inf, *edges[1:-1], np.inf]))
    total = max(len(known), 1)
    histogram = pl.DataFrame({"left": edges[:-1], "right": edges[1:], "share": counts / total})
    places = [round(share * (len(known) - 1)) for share in QUANTILES]
    quantiles = {share: float(known[at]) for share, at in zip(QUANTILES, places, strict=True)} if len(known) else {}
    beyond = {limit: _outside(known, limit) / total for limit in LIMITS[what]}
    return Distribution(what, UNITS[what], stage, len(known), quantiles, beyond, histogram)


def _outside(ordered: Float[np.ndarray, "known"], limit: float) -> int:
    below = np.searchsorted(ordered, -limit, side="left")
    above = len(ordered) - np.searchsorted(ordered, limit, side="right")
    return int(below + above)
