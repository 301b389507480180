"""Online recalibration: the coverage of the last minutes of a site widens or narrows its bands.

Adaptive conformal inference: where a band of 90 % held fewer truths lately, or more, the level at which the next one
is taken is moved until it holds 90 %, whatever the traffic does. With the conformity score of a truth (how far it lay
from the median, in half-widths of the band on its side) a band is scaled by the factor q:

    q = quantile of the scores of the last minutes, at level 1 - alpha
    alpha <- alpha + gamma (target - share of a forecast's scores above the q of its bands)

each horizon by itself. Source: Gibbs and Candes (2021), "Adaptive conformal inference under distribution shift",
NeurIPS 34, section 2.

State is passed and returned: `issued` takes note of a forecast, `seen` of where vehicles are, `apply` scales samples.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Float, Int, Shaped

from rampcast.horizon import STEP, STEPS_PER_SECOND

HORIZONS: Final = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 10.0, 15.0])  # [s] at which bands are scored
STEPS: Final = np.rint(HORIZONS * STEPS_PER_SECOND).astype(np.int64) - 1  # places of these in 0.2, 0.4 ... 15 s
LEVELS: Final = (0.05, 0.5, 0.95)  # quantiles that `issued` takes: the band's ends, and the median between them
TARGET: Final = 0.1  # share of the truths outside a band of 90 %
GAMMA: Final = 0.005  # Gibbs and Candes, section 2.2; a step of theirs is a forecast that was noted, one a second
MEMORY: Final = 300.0  # [s] "the last minutes": at 60 vehicles 18,000 scores, of 20 independent stretches of 15 s
SPACING: Final = 1.0  # [s] between forecasts that are noted: those in between tell nearly the same
FEWEST: Final = 50  # scores of a horizon below which its bands are left alone; 5 outside a band of 90 %
LEAST_ALPHA, MOST_ALPHA = 0.002, 0.5  # level of the scores' quantile: never the median, hardly the largest of 500
NARROWEST, WIDEST = 0.4, 3.0  # factor; what is farther off needs another model, not another width
THINNEST: Final = 0.1  # [m] half-width of a band in scores: positions are known no better
LONGEST_STEP: Final = 1.0  # [s] between two frames, for a truth between them to be known


@dataclass(frozen=True, eq=False)
class Issued:
    """Bands of a forecast that wait for their truths.

    Attributes:
        t0: when it was made [s].
        vehicle: ids.
        bands: quantiles of the position at `HORIZONS`, at `LEVELS` [m], before they were scaled.
        factor: by which they were scaled then.
    """

    t0: float
    vehicle: Shaped[np.ndarray, "vehicle"]
    bands: Float[np.ndarray, "vehicle horizon 3"]
    factor: Float[np.ndarray, "horizon"]


@dataclass(frozen=True, eq=False)
class Places:
    """Where vehicles were seen last: time [s], ids, fronts [m]."""

    time: float
    vehicle: Shaped[np.ndarray, "vehicle"]
    x: Float[np.ndarray, "vehicle"]


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of the last minutes.

    Attributes:
        time: when the truth was seen [s]; never falls.
        horizon: place in `HORIZONS`.
        score: distance from the median, in half-widths of the band as forecast.
        factor: by which that band was scaled when it was issued.
    """

    time: Float[np.ndarray, "score"]
    horizon: Int[np.ndarray, "score"]
    score: Float[np.ndarray, "score"]
    factor: Float[np.ndarray, "score"]

    def since(self, time: float) -> "Scores":
        """Returns the scores of truths that were seen later."""
        late = slice(np.searchsorted(self.time, time, side="right"), None)
        return Scores(self.time[late], self.horizon[late], self.score[late], self.factor[late])


def _none() -> Scores:
    nothing = np.empty(0)
    return Scores(nothing, nothing.astype(np.int64), nothing, nothing)


@dataclass(frozen=True, eq=False)
class Recalibration:
    """How the bands of one site are to be scaled now. A new one leaves them as they are.

    Attributes:
        alpha: adapted share outside the band, by horizon.
        scores: of the last minutes.
        pending: forecasts whose truths are not all seen, oldest first.
        last: where vehicles were seen last; None before the first time.
    """

    alpha: Float[np.ndarray, "horizon"] = field(default_factory=lambda: np.full(len(HORIZONS), TARGET))
    scores: Scores = field(default_factory=_none)
    pending: tuple[Issued, ...] = ()
    last: Places | None = None

    @cached_property
    def factors(self) -> Float[np.ndarray, "horizon"]:
        """Returns by what bands are scaled at each of `HORIZONS`: above 1 they are widened."""
        found = np.ones(len(HORIZONS))
        for number in range(len(HORIZONS)):
            own = self.scores.score[self.scores.horizon == number]
            if len(own) >= FEWEST:
                found[number] = np.quantile(own, 1.0 - self.alpha[number])
        return np.clip(found, NARROWEST, WIDEST)

    def waits_for(self, t0: float) -> bool:
        """Returns whether a forecast of that moment [s] would be taken note of."""
        return not self.pending or t0 >= self.pending[-1].t0 + SPACING - STEP / 2

    def issued(
        self, t0: float, vehicle: Shaped[np.ndarray, "vehicle"], bands: Float[np.ndarray, "vehicle horizon 3"]
    ) -> "Recalibration":
        """Returns the state that waits for the truths of a forecast too; one soon after another is passed over.

        Args:
            t0: when it was made [s].
            vehicle: ids.
            bands: quantiles of the position at `HORIZONS`, at `LEVELS` [m], before `apply`.
        """
        if not self.waits_for(t0):
            return self
        return replace(self, pending=(*self.pending, Issued(t0, vehicle, bands, self.factors)))

    def seen(
        self, time: float, vehicle: Shaped[np.ndarray, "vehicle"], x: Float[np.ndarray, "vehicle"]
    ) -> "Recalibration":
        """Returns the state that knows where vehicles are, and how good the forecasts were that were due by now.

        A truth due between two frames lies between the places of its vehicle in both, in proportion.

        Args:
            time: of the frame [s], later than those before.
            vehicle: ids.
            x: fronts [m].
        """
        now = Places(time, vehicle, x)
        if self.last is None or time <= self.last.time:
            return replace(self, last=now if self.last is None else self.last)
        waiting = tuple(one for one in self.pending if one.t0 + HORIZONS[-1] > time)
        is_hole = time - self.last.time > LONGEST_STEP
        new = _joined([_scores(one, self.last, now) for one in self.pending if not is_hole])
        if not len(new.score):
            return replace(self, pending=waiting, last=now)
        scores = _joined([self.scores.since(time - MEMORY), new])
        return Recalibration(_adapted(self.alpha, new), scores, waiting, now)

    def apply(self, samples: Float[np.ndarray, "vehicle sample step"]) -> Float[np.ndarray, "vehicle sample step"]:
        """Returns samples moved away from their median, or towards it, so that their bands are scaled as they should.

        The order of the samples stays. Between two of `HORIZONS` the factor is linear; before the first it is constant.

        Args:
            samples: positions at 0.2, 0.4 ... s, or displacements [m].
        """
        time = np.arange(1, samples.shape[2] + 1) * STEP
        median = np.median(samples, axis=1, keepdims=True)
        return median + np.interp(time, HORIZONS, self.factors) * (samples - median)

    def report(self) -> pl.DataFrame:
        """Returns a row for each horizon, of the last minutes.

        Columns: horizon [s]; n, truths; coverage, share of them in the bands as they were issued; coverage_unscaled, in
        those that were forecast; factor, by which bands are scaled now; alpha.
        """
        scores = pl.DataFrame({name: getattr(self.scores, name) for name in ("horizon", "score", "factor")})
        counted = scores.group_by("horizon").agg(
            n=pl.len(),
            coverage=(pl.col("score") <= pl.col("factor")).mean(),
            coverage_unscaled=(pl.col("score") <= 1.0).mean(),
        )
        rows = pl.DataFrame({"horizon": np.arange(len(HORIZONS)), "factor": self.factors, "alpha": self.alpha})
        return rows.join(counted, on="horizon", how="left", maintain_order="left").select(
            pl.Series("horizon", HORIZONS), pl.col("n").fill_null(0), "coverage", "coverage_unscaled", "factor", "alpha"
        )


def _scores(issued: Issued, before: Places, now: Places) -> Scores:
    """Returns the scores of the truths of a forecast that were due after one frame and by the next."""
    due = issued.t0 + HORIZONS
    numbers = np.flatnonzero((due > before.time) & (due <= now.time))
    if not len(numbers):
        return _none()
    share = (due[numbers] - before.time) / (now.time - before.time)
    at = [_places_of(issued.vehicle, places) for places in (before, now)]
    truth = at[0][:, None] + share * (at[1] - at[0])[:, None]
    low, median, high = np.moveaxis(issued.bands[:, numbers], 2, 0)
    width = np.where(truth >= median, high - median, median - low)
    score = np.abs(truth - median) / np.maximum(width, THINNEST)
    known = np.isfinite(score)
    horizon = np.broadcast_to(numbers, score.shape)[known]
    return Scores(np.full(len(horizon), now.time), horizon, score[known], issued.factor[horizon])


def _places_of(vehicle: Shaped[np.ndarray, "vehicle"], places: Places) -> Float[np.ndarray, "vehicle"]:
    """Returns the fronts of those vehicles [m]; NaN of one that is not there."""
    if not len(places.vehicle):
        return np.full(len(vehicle), np.nan)
    order = np.argsort(places.vehicle, kind="stable")
    row = order[np.minimum(np.searchsorted(places.vehicle, vehicle, sorter=order), len(order) - 1)]
    return np.where(places.vehicle[row] == vehicle, places.x[row], np.nan)


def _adapted(alpha: Float[np.ndarray, "horizon"], new: Scores) -> Float[np.ndarray, "horizon"]:
    """Returns alpha after new scores; of a horizon without any it stays."""
    count = np.bincount(new.horizon, minlength=len(HORIZONS))
    missed = np.bincount(new.horizon, weights=new.score > new.factor, minlength=len(HORIZONS))
    share = np.where(count > 0, missed / np.maximum(count, 1), TARGET)
    return np.clip(alpha + GAMMA * (TARGET - share), LEAST_ALPHA, MOST_ALPHA)


def _joined(parts: list[Scores]) -> Scores:
    if not parts:
        return _none()
    names = ("time", "horizon", "score", "factor")
    return Scores(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
