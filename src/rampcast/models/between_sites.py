"""How sites differ: each has parameters of its own, which scatter about a mean, and its vehicles tell more or less.

Two levels, both normal. What a site's vehicles say of its parameters is `Evidence`: a likelihood that may be flat in
some directions, as a desired speed is where nobody drives freely. The sites' parameters are independent draws about a
mean, with a standard deviation for each: the spread between sites. Mean and spread are estimated from all sites
together by restricted maximum likelihood. A site that was seen is then somewhere between what it says itself and the
mean, by how much it says; one that nobody has seen is a draw.

Source: Laird and Ware 1982, "Random-effects models for longitudinal data", section 4, for the steps of the EM
algorithm; Gelman and Hill 2007, chapter 12, for partial pooling.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

MOST_STEPS, CONVERGED = 2000, 1e-4  # of the algorithm; change of every variance, relative to itself, in its last step
LEAST_SPREAD = 1e-3  # in the units of the parameters, which are near 1: sites are no more alike
VAGUE = 1.0  # standard deviation of what is assumed of a mean that no site tells; others forget it


@dataclass(frozen=True)
class Evidence:
    """What the vehicles of a site say of its parameters, as a normal likelihood.

    Attributes:
        precision: inverse of the covariance of their own estimate; zero where they say nothing.
        information: the precision times that estimate.
    """

    precision: Float[np.ndarray, "param param"]
    information: Float[np.ndarray, "param"]


@dataclass(frozen=True)
class Estimate:
    """Parameters of one site, as far as they are known.

    Attributes:
        mean, deviation: of what they may be.
        shrinkage: part of what is not known without the site's vehicles that they leave open: 1 if they say nothing and
            it is all taken from other sites, 0 if nothing is.
    """

    mean: Float[np.ndarray, "param"]
    deviation: Float[np.ndarray, "param"]
    shrinkage: Float[np.ndarray, "param"]


@dataclass(frozen=True)
class Population:
    """Sites that were seen, and those that may be.

    Attributes:
        names: of the parameters.
        mean: over all sites that there are, as far as those seen tell.
        doubt: covariance of the mean.
        spread: standard deviations between sites.
        sites: names of those seen.
        values, shrinkage: of each; see `Estimate`.
    """

    names: tuple[str, ...]
    mean: Float[np.ndarray, "param"]
    doubt: Float[np.ndarray, "param param"]
    spread: Float[np.ndarray, "param"]
    sites: tuple[str, ...] = ()
    values: Float[np.ndarray, "site param"] = field(default_factory=lambda: np.zeros((0, 0)))
    shrinkage: Float[np.ndarray, "site param"] = field(default_factory=lambda: np.zeros((0, 0)))

    def site(self, evidence: Evidence | None = None) -> Estimate:
        """Returns the parameters of a further site, from what its vehicles say of them; None if nobody has seen any."""
        before = np.diag(self.spread**2) + self.doubt
        if evidence is None:
            return Estimate(self.mean, np.sqrt(np.diag(before)), np.ones(len(self.mean)))
        weight = np.linalg.inv(before)
        after = np.linalg.inv(evidence.precision + weight)
        mean = after @ (evidence.information + weight @ self.mean)
        left, open_before = np.diag(after), np.diag(before)
        return Estimate(mean, np.sqrt(left), left / open_before)


def fit_population(
    evidence: Mapping[str, Evidence],
    *,
    names: tuple[str, ...],
    assumed: Float[np.ndarray, "param"],
    spread: Float[np.ndarray, "param"],
    tied: Int[np.ndarray, "param"] | None = None,
) -> Population:
    """Returns how sites differ.

    Args:
        evidence: of each site, by its name; of at least two.
        names: of the parameters.
        assumed: a mean of each, where no site tells.
        spread: between sites, likewise.
        tied: number of the group of each parameter; those of a group have one spread. None: each its own.
    """
    precision = np.stack([one.precision for one in evidence.values()])
    information = np.stack([one.information for one in evidence.values()])
    group = np.arange(len(names)) if tied is None else tied
    variance = spread**2
    for _ in range(MOST_STEPS):
        level = _level(precision, information, variance, assumed)
        found = np.maximum(level.square.mean(axis=0), LEAST_SPREAD**2)
        found = (np.bincount(group, weights=found) / np.bincount(group))[group]
        done = (np.abs(found - variance) <= CONVERGED * found).all()
        variance = found
        if done:
            break
    level = _level(precision, information, variance, assumed)
    return Population(
        names, level.mean, level.doubt, np.sqrt(variance), tuple(evidence), level.values, level.left / variance
    )


@dataclass(frozen=True)
class _Level:
    """What follows from given variances between sites: mean, its covariance; of sites values and variances left.

    `square` is the expected square of each site's distance from the mean.
    """

    mean: Float[np.ndarray, "param"]
    doubt: Float[np.ndarray, "param param"]
    values: Float[np.ndarray, "site param"]
    left: Float[np.ndarray, "site param"]
    square: Float[np.ndarray, "site param"]


def _level(
    precision: Float[np.ndarray, "site param param"],
    information: Float[np.ndarray, "site param"],
    variance: Float[np.ndarray, "param"],
    assumed: Float[np.ndarray, "param"],
) -> _Level:
    after = np.linalg.inv(precision + np.diag(1.0 / variance))  # of a site's parameters, given the mean
    pull = after @ precision  # how far the mean moves a site from itself
    told = precision - precision @ pull  # inverse covariance of a site's own estimate, about the mean
    told_of = information - np.einsum("spq,sq->sp", precision @ after, information)
    vague = np.eye(len(variance)) / VAGUE**2
    doubt = np.linalg.inv(told.sum(axis=0) + vague)
    mean = doubt @ (told_of.sum(axis=0) + vague @ assumed)
    beyond = np.einsum("spq,sq->sp", after, information - precision @ mean)
    left = np.einsum("spp->sp", after)
    square = beyond**2 + left + np.einsum("spq,qr,spr->sp", pull, doubt, pull)
    return _Level(mean, doubt, mean + beyond, left, square)
