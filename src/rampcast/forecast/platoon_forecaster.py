"""The forecaster of vehicles and the traffic ahead of them: sampled roll-outs of platoons, corrected, calibrated."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Shaped
from scipy.ndimage import uniform_filter1d

from rampcast.forecast.platoon_roll_out import RollOut, Samples, fit_roll_out, sample_platoons
from rampcast.horizon import FUTURE, STEP
from rampcast.models.correction import KNOTS, LEVELS, Correction, CorrectionSpec, Rolled, fit_correction, over_time
from rampcast.models.drivers import posteriors
from rampcast.models.folds import time_folds
from rampcast.models.merge_features import platoon_table, regimes
from rampcast.models.pooled_driver import roll_chain
from rampcast.traffic.platoons import HISTORY, PLACES, Platoons

SPREAD = (0.1, 0.9)  # quantiles of the samples whose distance is their spread
CHUNK = 512  # platoons at a time: a few arrays of 100 samples of them are 100 MB
CORRECTION = CorrectionSpec()
ANCHORS = np.array([4, 24, 49, 74, 94])  # of `LEVELS`: 5, 25, 50, 75 and 95 %
SMOOTHING = 5  # steps over which moves are averaged: what a hundred samples' quantiles jump by is no acceleration
SAME = 0.02  # [m] by which samples are drawn apart that lie in one place, as those of a standing vehicle do
MIDDLE = len(LEVELS) // 2  # of the levels: the median


@dataclass(frozen=True)
class PlatoonForecasterSpec:
    """What may be chosen.

    Attributes:
        samples: futures of each platoon.
        folds: of the cross-fit of the correction.
        correction: sizes of its trees; None leaves the roll-outs as they are.
    """

    samples: int = 100
    folds: int = 8
    correction: CorrectionSpec | None = CORRECTION


FORECASTER = PlatoonForecasterSpec()


@dataclass(frozen=True)
class PlatoonForecast:
    """What will become of the central vehicle of each platoon, at 0.2, 0.4 ... 15 s.

    Attributes:
        samples: displacements [m]; none reverses, or overlaps the leader's sample.
        leader_samples: front of the leader in the same samples, counted from the central vehicle's place at t = 0 [m];
            NaN where there is none.
        mean: displacement [m].
        quantiles: at `correction.LEVELS` [m].
    """

    samples: Float[np.ndarray, "platoon sample step"]
    leader_samples: Float[np.ndarray, "platoon sample step"]
    mean: Float[np.ndarray, "platoon step"]
    quantiles: Float[np.ndarray, "platoon step level"]

    @property
    def median(self) -> Float[np.ndarray, "platoon step"]:
        """Returns the displacement that is as likely exceeded as not [m]."""
        return self.quantiles[:, :, MIDDLE]

    def quantiles_at(self, *levels: float) -> Float[np.ndarray, "platoon step asked"]:
        """Returns the displacements at those of `LEVELS` that are nearest to the levels asked for [m]."""
        return self.quantiles[:, :, [int(np.abs(LEVELS - level).argmin()) for level in levels]]


@dataclass(frozen=True)
class PlatoonForecaster:
    """A fitted forecaster.

    Attributes:
        spec: what was chosen.
        roll_out: drivers, disturbances and heads.
        correction: of the roll-outs; None without.
        seed: of the samples.
    """

    spec: PlatoonForecasterSpec
    roll_out: RollOut
    correction: Correction | None
    seed: int

    def predict(self, platoons: Platoons) -> PlatoonForecast:
        """Returns the forecast of each platoon, whatever the others are.

        Args:
            platoons: at least one.
        """
        rows = np.arange(len(platoons))
        parts = [self._predict(platoons.select(rows[first : first + CHUNK])) for first in rows[::CHUNK]]
        joined = {
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(PlatoonForecast)
        }
        return PlatoonForecast(**joined)

    def _predict(self, platoons: Platoons) -> PlatoonForecast:
        samples = _sampled(self, platoons)
        if self.correction is None:
            quantiles = np.moveaxis(np.quantile(samples.x, LEVELS, axis=1), 0, -1)
            return PlatoonForecast(samples.x, samples.leader_x, samples.x.mean(axis=1), quantiles)
        rolled = _rolled(self, platoons, samples)
        quantiles = over_time(self.correction.quantiles(rolled), np.median(samples.x, axis=1))
        limit = np.maximum(self.roll_out.limit, np.where(platoons.valid[:, 0], platoons.v[:, 0], 0.0).max(axis=1))
        x = mapped(samples.x, quantiles, limit)
        return PlatoonForecast(x, samples.leader_x + (x - samples.x), x.mean(axis=1), quantiles)


def fit_platoon_forecaster(
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    leader_truth: Float[np.ndarray, "platoon step"],
    *,
    group: Shaped[np.ndarray, "platoon"],
    t0: Float[np.ndarray, "platoon"],
    seed: int = 1,
    spec: PlatoonForecasterSpec = FORECASTER,
) -> PlatoonForecaster:
    """Returns the forecaster that the training vehicles teach.

    Args:
        platoons: of the training vehicles.
        truth: their displacements [m]; NaN where not seen.
        leader_truth: front of their leaders, counted from the same places [m]; NaN where not seen.
        group: name of the vehicle, which begins with the number of its window; see `time_folds`.
        t0: the moment in its window's clock [s]; NaN without a clock.
        seed: of samples and trees.
        spec: what may be chosen.
    """
    roll_out = fit_roll_out(platoons, truth, leader_truth)
    plain = PlatoonForecaster(spec, roll_out, None, seed)
    if spec.correction is None:
        return plain
    rolled = _rolled(plain, platoons, _sampled(plain, platoons))
    begin, end = t0 - (HISTORY - 1) * STEP, t0 + FUTURE * STEP
    folds = time_folds(group, begin, end, count=min(spec.folds, len(set(group.tolist()))))
    correction = fit_correction(rolled, truth[:, KNOTS], group=group, folds=folds, seed=seed, spec=spec.correction)
    return PlatoonForecaster(spec, roll_out, correction, seed)


def _sampled(model: PlatoonForecaster, platoons: Platoons) -> Samples:
    weights = posteriors(model.roll_out.prior, platoons)
    return sample_platoons(model.roll_out, platoons, samples=model.spec.samples, seed=model.seed, weights=weights)


def _rolled(model: PlatoonForecaster, platoons: Platoons, samples: Samples) -> Rolled:
    at_knots = samples.x[:, :, KNOTS]
    low, high = np.quantile(at_knots, SPREAD, axis=1)
    chain = roll_chain(model.roll_out.prior.centre, platoons, leaders=PLACES - 1)
    return Rolled(
        features=platoon_table(platoons),
        chains=chain[:, KNOTS, None],
        median=np.median(at_knots, axis=1).astype(float),
        spread=(high - low).astype(float),
        regime=regimes(platoons),
    )


def mapped(
    samples: Float[np.ndarray, "platoon sample step"],
    quantiles: Float[np.ndarray, "platoon step level"],
    limit: Float[np.ndarray, "platoon"],
) -> Float[np.ndarray, "platoon sample step"]:
    """Returns the samples moved so that their quantiles are the given ones, as far as speeds stay from 0 to the limit.

    Between a few quantiles all move alike, beyond the outermost they are shifted, and moves are averaged over 1 s: so a
    sample's speed stays about as smooth as it was.
    """
    apart = samples + SAME * (np.arange(samples.shape[1], dtype=np.float32)[:, None] + 0.5) / samples.shape[1]
    ordered = np.sort(apart, axis=1)
    count = samples.shape[1]
    place = LEVELS[ANCHORS] * count - 0.5
    left = np.clip(place.astype(int), 0, count - 2)
    share = np.clip(place - left, 0.0, 1.0)[:, None].astype(np.float32)
    own = ordered[:, left] * (1.0 - share) + ordered[:, left + 1] * share
    wanted = quantiles[:, :, ANCHORS].swapaxes(1, 2).astype(np.float32)
    moved = wanted[:, :1] + np.minimum(apart - own[:, :1], 0.0) + np.maximum(apart - own[:, -1:], 0.0)
    for low in range(len(ANCHORS) - 1):
        width = np.maximum(own[:, low + 1] - own[:, low], SAME / count)[:, None]
        part = np.clip((apart - own[:, low, None]) / width, 0.0, 1.0)
        moved += part * (wanted[:, low + 1] - wanted[:, low])[:, None]
    moved = samples + uniform_filter1d(moved - samples, SMOOTHING, axis=2, mode="nearest")
    farthest = (limit[:, None] * STEP).astype(np.float32)
    before = np.zeros_like(moved[:, :, 0])
    for step in range(moved.shape[2]):
        moved[:, :, step] = before = np.clip(moved[:, :, step], before, before + farthest)
    return moved
