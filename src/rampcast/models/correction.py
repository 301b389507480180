"""What roll-outs get wrong, learned: a corrected median, and a quantile function that holds what it promises.

At a few horizons boosted trees and a linear model learn how far vehicles went beyond the median of their roll-outs, and
other trees how large the rest is. Trees find what depends on what, but of few minutes they learn the minutes; a line is
poorer and steadier, and their mean is often better than either. What is taken, and how far, is what helped on vehicles,
and in minutes, that it was not trained on. The quantiles of what is left there, over its expected size, make the bands:
split conformal prediction with normalised residuals, by traffic regime where that has enough vehicles.

Source: Papadopoulos, Gammerman and Vovk 2008 for normalised residuals; Vovk 2012 for cross-conformal prediction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.stats import norm
from sklearn.base import clone
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_limits

from rampcast.models.folds import Fold
from rampcast.models.merge_features import Regime
from rampcast.models.ranked_line import RankedLine, fit_ranked_line
from rampcast.models.trees import BoostedTrees, boosted_trees, softness

Model = BoostedTrees | RankedLine
Fit = Callable[[Float[np.ndarray, "row column"], Float[np.ndarray, "row"]], Model]

KNOTS = np.array([4, 9, 14, 24, 39, 49, 59, 74])  # steps of 0.2 s: 1, 2, 3, 5, 8, 10, 12, 15 s
LEVELS = np.linspace(0.01, 0.99, 99)
BLENDS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of each simpler roll-out that are tried
NEARLY = 1.03  # of the least error
WORTH = 0.95  # of the mean's error: what one model alone must reach, or it does so in these minutes only
LEAST_SCORES = 20  # a 5 % quantile of fewer residuals is not known
LEAST_SPREAD = 0.05  # [m]; places are known no better
LEAST_RATIO = 1e-6  # of an error to its size, so that its logarithm is a number where all errors are none
LEAST_SIZE = 0.05  # of the roll-outs' spread
NORMAL_SPREAD = 2.563  # standard deviations from the 10 % to the 90 % quantile of a normal distribution


@dataclass(frozen=True)
class CorrectionSpec:
    """Sizes of the trees, and what is enough to learn from.

    Attributes:
        trees: of each model of the median; a model of the size takes half as many.
        learning_rate, leaves, least_in_leaf: of the trees.
        strengths: parts of the correction that are tried on vehicles not trained on.
        least_cases: with fewer, nothing is corrected.
        least_for_trees: with fewer, only the line is learned: trees of so few learn the vehicles.
        least_groups: vehicles that a regime needs to have quantiles of its own.
    """

    trees: int = 120
    learning_rate: float = 0.06
    leaves: int = 5
    least_in_leaf: int = 30
    strengths: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75, 1.0)
    least_cases: int = 100
    least_for_trees: int = 600
    least_groups: int = 20


@dataclass(frozen=True)
class Rolled:
    """Roll-outs of some platoons, as the correction sees them.

    Attributes:
        features: at t = 0.
        chains: displacements that simpler roll-outs give at the knots [m].
        median, spread: of the samples at the knots [m].
        regime: see `merge_features.Regime`.
    """

    features: Float[np.ndarray, "row feature"]
    chains: Float[np.ndarray, "row knot chain"]
    median: Float[np.ndarray, "row knot"]
    spread: Float[np.ndarray, "row knot"]
    regime: Int[np.ndarray, "row"]

    def table(self, knot: int) -> Float[np.ndarray, "row column"]:
        """Returns the columns for the models of a knot."""
        own = (self.chains[:, knot] - self.median[:, knot, None], self.median[:, [knot]], self.spread[:, [knot]])
        return np.column_stack([self.features, *own])

    def blended(self, knot: int, blend: Float[np.ndarray, "chain"]) -> Float[np.ndarray, "row"]:
        """Returns the median of the roll-outs at a knot with as much of each simpler roll-out in it [m]."""
        return self.median[:, knot] + (self.chains[:, knot] - self.median[:, knot, None]) @ blend


@dataclass(frozen=True)
class KnotCorrection:
    """The correction at one knot; without models the roll-outs stay as they are.

    Attributes:
        blend: how much of each of the simpler roll-outs is in the median that is corrected.
        kept: columns that were known in training.
        medians: whose mean is what roll-outs miss.
        sizes: of the rest, over the roll-outs' spread.
        strength: part of the models' median that counts.
        sized: whether the models' size counts, else the roll-outs' spread.
        scores: quantiles of residual over size for each regime, and for all together in the last row.
    """

    blend: Float[np.ndarray, "chain"]
    kept: Bool[np.ndarray, "column"]
    medians: tuple[Model, ...]
    sizes: tuple[Model, ...]
    strength: float
    sized: bool
    scores: Float[np.ndarray, "regime level"]


@dataclass(frozen=True)
class Correction:
    """A fitted correction, one part for each knot."""

    knots: tuple[KnotCorrection, ...]

    def quantiles(self, rolled: Rolled) -> Float[np.ndarray, "row knot level"]:
        """Returns the quantiles of the displacement at the knots [m], rising with the level."""
        parts = [_quantiles(knot, rolled, number) for number, knot in enumerate(self.knots)]
        return np.stack(parts, axis=1)


def fit_correction(
    rolled: Rolled,
    truth: Float[np.ndarray, "row knot"],
    *,
    group: Shaped[np.ndarray, "row"],
    folds: Sequence[Fold],
    seed: int = 1,
    spec: CorrectionSpec,
) -> Correction:
    """Returns the correction that the training vehicles ask for.

    Args:
        rolled: their roll-outs.
        truth: their displacements at the knots [m]; NaN where not seen.
        group: which vehicle each is.
        folds: to learn from each residual what the trees had not seen; together they test every row.
        seed: of the trees.
        spec: sizes of the trees.
    """
    _, number = np.unique(group, return_inverse=True)

    with threadpool_limits(1, user_api="openmp"):  # trees of so few rows gain nothing from more
        knots = [_fit_knot(rolled, truth[:, knot], knot, number, folds, seed, spec) for knot in range(len(KNOTS))]
    return Correction(tuple(knots))


def over_time(
    at_knots: Float[np.ndarray, "row knot level"], median: Float[np.ndarray, "row step"]
) -> Float[np.ndarray, "row step level"]:
    """Returns quantiles at every step: between knots, what they add to the roll-outs' median is interpolated.

    They never fall with the level or with time, and are never negative: no vehicle reverses.

    Args:
        at_knots: quantiles at `KNOTS` [m].
        median: of the roll-outs [m].
    """
    beyond = at_knots - median[:, KNOTS, None]
    beyond = np.concatenate([np.zeros_like(beyond[:, :1]), beyond], axis=1)
    place = np.concatenate([[-1], KNOTS])
    step = np.arange(median.shape[1])
    left = np.searchsorted(place, step, side="left") - 1
    share = ((step - place[left]) / (place[left + 1] - place[left]))[None, :, None]
    found = median[:, :, None] + beyond[:, left] * (1.0 - share) + beyond[:, left + 1] * share
    return np.maximum.accumulate(np.maximum(found, 0.0), axis=1)


def _fit_knot(
    rolled: Rolled,
    truth: Float[np.ndarray, "row"],
    knot: int,
    group: Int[np.ndarray, "row"],
    folds: Sequence[Fold],
    seed: int,
    spec: CorrectionSpec,
) -> KnotCorrection:
    table, seen = rolled.table(knot), np.isfinite(truth)
    kept = np.isfinite(table[seen]).any(axis=0)  # trees cannot be fitted to a column of nothing
    table, spread = table[:, kept], _floored(rolled.spread[:, knot])
    blend = _blend(rolled, truth, seen, knot) if seen.sum() >= LEAST_SCORES else np.zeros(rolled.chains.shape[2])
    beyond = truth - rolled.blended(knot, blend)
    if seen.sum() < spec.least_cases:
        return KnotCorrection(
            blend, kept, (), (), 0.0, False, _scores(beyond / spread, seen, rolled.regime, group, spec)
        )
    enough = seen.sum() >= spec.least_for_trees
    of_size = _trees(seed, spec, spec.trees // 2) if enough else fit_ranked_line
    tried = (_trees(seed, spec, spec.trees), fit_ranked_line) if enough else (fit_ranked_line,)
    unseen, of_median = _steadiest(tried, table, beyond, seen, folds, spec)
    strength = _strength(beyond[seen], unseen[seen], spec.strengths)
    left = beyond - strength * unseen
    size = _out_of_fold(table, np.abs(left) / spread, seen, folds, of_size, spec)
    size = spread * np.maximum(size, LEAST_SIZE)
    sized = _unlikelihood(left, size, seen) < _unlikelihood(left, spread, seen)
    medians = tuple(fit(table[seen], beyond[seen]) for fit in of_median) if strength else ()
    sizes = (of_size(table[seen], (np.abs(left) / spread)[seen]),) if sized else ()
    scores = _scores(left / (size if sized else spread), seen, rolled.regime, group, spec)
    return KnotCorrection(blend, kept, medians, sizes, strength, bool(sized), scores)


def _blend(
    rolled: Rolled, truth: Float[np.ndarray, "row"], seen: Bool[np.ndarray, "row"], knot: int
) -> Float[np.ndarray, "chain"]:
    """Returns how much of each simpler roll-out makes the median err least."""
    shares = np.array([one for one in product(BLENDS, repeat=rolled.chains.shape[2]) if sum(one) <= 1.0])
    errors = [np.abs(truth[seen] - rolled.blended(knot, share)[seen]).mean() for share in shares]
    return shares[int(np.argmin(errors))]


def _steadiest(
    tried: Sequence[Fit],
    table: Float[np.ndarray, "row column"],
    beyond: Float[np.ndarray, "row"],
    seen: Bool[np.ndarray, "row"],
    folds: Sequence[Fold],
    spec: CorrectionSpec,
) -> tuple[Float[np.ndarray, "row"], tuple[Fit, ...]]:
    """Returns what all models together, or one that errs far less, give for rows they were not trained on."""
    alone = [(_out_of_fold(table, beyond, seen, folds, fit, spec), (fit,)) for fit in tried]
    together = np.mean([one for one, _ in alone], axis=0), tuple(tried)
    errors = [float(np.abs(beyond - one)[seen].mean()) for one, _ in (together, *alone)]
    best = int(np.argmin(errors[1:]))
    return alone[best] if errors[1 + best] < WORTH * errors[0] else together


def _strength(beyond: Float[np.ndarray, "row"], unseen: Float[np.ndarray, "row"], strengths: Sequence[float]) -> float:
    """Returns the largest part of the correction that is nearly as good as the best on vehicles not trained on.

    Nearly, as the trees of a fold are trained on half the data or less where its time is left out, and the final ones
    on all.
    """
    errors = [float(np.abs(beyond - part * unseen).mean()) for part in strengths]
    return max(part for part, error in zip(strengths, errors, strict=True) if error <= NEARLY * min(errors))


def _trees(seed: int, spec: CorrectionSpec, count: int) -> Fit:
    """Returns the fit of trees; each split may look at 40 % of the columns, which are much alike."""
    trees = HistGradientBoostingRegressor(
        loss="absolute_error",
        max_iter=count,
        learning_rate=spec.learning_rate,
        max_leaf_nodes=spec.leaves,
        min_samples_leaf=spec.least_in_leaf,
        l2_regularization=1.0,
        max_features=0.4,
        early_stopping=False,
        random_state=seed,
    )
    return lambda table, wanted: boosted_trees(clone(trees).fit(table, wanted), width=softness(table))


def _out_of_fold(
    table: Float[np.ndarray, "row column"],
    wanted: Float[np.ndarray, "row"],
    seen: Bool[np.ndarray, "row"],
    folds: Sequence[Fold],
    fit: Fit,
    spec: CorrectionSpec,
) -> Float[np.ndarray, "row"]:
    """Returns what a model that was not trained on a row gives for it; 0 where too few are left to train on."""
    found = np.zeros(len(table))
    for train, test in folds:
        rows = train[seen[train]]
        some = np.isfinite(table[rows]).any(axis=0)
        if len(rows) >= 2 * spec.least_in_leaf and len(test):
            found[test] = fit(table[rows][:, some], wanted[rows]).predict(table[test][:, some])
    return found


def _scores(
    left: Float[np.ndarray, "row"],
    seen: Bool[np.ndarray, "row"],
    regime: Int[np.ndarray, "row"],
    group: Int[np.ndarray, "row"],
    spec: CorrectionSpec,
) -> Float[np.ndarray, "regime level"]:
    """Returns the quantiles of residual over size at `LEVELS`, of each regime and then of all together."""
    parts = [*(seen & (regime == one) for one in Regime), seen]
    together = _quantile_function(left[parts[-1]])
    enough = [len(np.unique(group[part])) >= spec.least_groups for part in parts]
    return np.stack(
        [_quantile_function(left[part]) if ok else together for part, ok in zip(parts, enough, strict=True)]
    )


def _quantile_function(left: Float[np.ndarray, "row"]) -> Float[np.ndarray, "level"]:
    """Returns the quantiles at `LEVELS`; of too few, those of a normal distribution as wide as the roll-outs."""
    if len(left) < LEAST_SCORES:
        return norm.ppf(LEVELS) / NORMAL_SPREAD
    # either side alike: in other minutes traffic errs to the other side. weibull is p (n + 1), the rank that split
    # conformal prediction takes
    size = np.quantile(np.abs(left), np.abs(2.0 * LEVELS - 1.0), method="weibull")
    return np.where(np.isclose(LEVELS, 0.5), 0.0, np.sign(LEVELS - 0.5) * size)


def _unlikelihood(
    left: Float[np.ndarray, "row"], size: Float[np.ndarray, "row"], seen: Bool[np.ndarray, "row"]
) -> float:
    """Returns minus the log-likelihood of residuals as a Laplace distribution of those relative sizes."""
    ratio = np.abs(left[seen]) / size[seen]
    return float(np.log(size[seen]).mean() + np.log(max(ratio.mean(), LEAST_RATIO)))


def _floored(spread: Float[np.ndarray, "row"]) -> Float[np.ndarray, "row"]:
    return np.maximum(spread, LEAST_SPREAD)


def _quantiles(knot: KnotCorrection, rolled: Rolled, number: int) -> Float[np.ndarray, "row level"]:
    table = rolled.table(number)[:, knot.kept]
    median, size = rolled.blended(number, knot.blend), _floored(rolled.spread[:, number])
    if knot.medians:
        median = median + knot.strength * (sum(model.predict(table) for model in knot.medians) / len(knot.medians))
    for model in knot.sizes:
        size = size * np.maximum(model.predict(table), LEAST_SIZE)
    return median[:, None] + size[:, None] * knot.scores[rolled.regime]
