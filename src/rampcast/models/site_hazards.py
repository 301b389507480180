"""Hazards of merging over sites: what a site's merges say of its hazard, and that of a site nobody has recorded.

The parameters that differ between sites are the logit of the hazard where all features are at their usual values, and
the weights of the features, each over its usual scale; the weights share one spread, as one for each of 19 cannot be
told from a few sites. Of a site that is not known the whole hazard may be off by a factor, the same for all of its
vehicles: in each sample of a roll-out it is another.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.optimize import minimize
from scipy.special import expit

from rampcast.models.between_sites import Estimate, Evidence, Population, fit_population
from rampcast.models.merging import FEATURES, MergeHazard, Periods, usual_features

NAMES = ("logit", *(f"weight {number}" for number in range(1, FEATURES + 1)))
ASSUMED_SPREAD = 0.5  # between sites, where one alone tells
TIED = np.minimum(np.arange(FEATURES + 1), 1)  # the weights have one spread
NEARBY = (
    1.0  # inverse variance about all sites' hazard in which a site's own is looked for: merges of few are separable
)
MOST_SCENES = 500  # vehicles at moments of a site; more say the same


@dataclass(frozen=True)
class HazardPopulation:
    """Hazards of sites.

    Attributes:
        parameters: see `NAMES`.
        middle, scale: of the features.
    """

    parameters: Population
    middle: Float[np.ndarray, "feature"]
    scale: Float[np.ndarray, "feature"]

    def evidence(self, periods: Periods, vehicle: Shaped[np.ndarray, "scene"]) -> Evidence:
        """Returns what the merges at a further site say; see `hazard_evidence`."""
        return hazard_evidence(periods, vehicle, self.parameters.mean, self.middle, self.scale)

    def hazard(self, estimate: Estimate, zone: tuple[float, float]) -> MergeHazard:
        """Returns the hazard of those parameters.

        Args:
            estimate: of `NAMES`.
            zone: see `merging.merge_zone`.
        """
        weights = estimate.mean[1:] / self.scale
        constant = float(estimate.mean[0] - weights @ self.middle)
        return MergeHazard(weights, constant, *zone, unknown=float(estimate.deviation[0]))


def hazard_evidence(
    periods: Periods,
    vehicle: Shaped[np.ndarray, "scene"],
    about: Float[np.ndarray, "param"],
    middle: Float[np.ndarray, "feature"],
    scale: Float[np.ndarray, "feature"],
) -> Evidence:
    """Returns what the merges of a site say of its hazard: their likelihood, as a parabola about its top.

    A vehicle counts as one, at however many moments it is.

    Args:
        periods: of the site's vehicles.
        vehicle: which each scene is of.
        about: near which the top is looked for, and where few merges would put it far away.
        middle, scale: of the features.
    """
    design = np.column_stack([np.ones(len(periods.merged)), (periods.features - middle) / scale])
    scenes = np.unique(periods.scene)
    weight = len(set(vehicle[scenes].tolist())) / max(len(scenes), 1) / periods.samples

    def unlikelihood(parameters: np.ndarray) -> tuple[Any, Any]:
        logit, off = design @ parameters, parameters - about
        value = weight * (np.logaddexp(0.0, logit) - periods.merged * logit).sum() + NEARBY * off @ off / 2.0
        return value, weight * (expit(logit) - periods.merged) @ design + NEARBY * off

    def curvature(parameters: np.ndarray) -> Float[np.ndarray, "param param"]:
        p = expit(design @ parameters)
        return weight * (design * (p * (1.0 - p))[:, None]).T @ design

    top = minimize(
        unlikelihood, about, jac=True, hess=lambda at: curvature(at) + NEARBY * np.eye(len(at)), method="trust-exact"
    ).x
    precision = curvature(top)
    # the likelihood alone still rises there, towards where the merges are likeliest
    return Evidence(precision, precision @ top + NEARBY * (top - about))


def fit_hazards(
    periods: Periods, site: Shaped[np.ndarray, "scene"], vehicle: Shaped[np.ndarray, "scene"], pooled: MergeHazard
) -> HazardPopulation:
    """Returns how the hazards of at least two sites differ.

    Args:
        periods: of all sites.
        site, vehicle: which each scene is of.
        pooled: the hazard of all together.
    """
    middle, scale = usual_features(periods)
    about = np.append(pooled.constant + pooled.weights @ middle, pooled.weights * scale)
    names = np.unique(site[np.unique(periods.scene)]).tolist()
    evidence = {
        name: hazard_evidence(_of(periods, np.flatnonzero(site == name)), vehicle, about, middle, scale)
        for name in names
    }
    spread = np.full(len(NAMES), ASSUMED_SPREAD)
    return HazardPopulation(
        fit_population(evidence, names=NAMES, assumed=about, spread=spread, tied=TIED), middle, scale
    )


def _of(periods: Periods, scenes: Int[np.ndarray, "chosen"]) -> Periods:
    """Returns the periods of some scenes, evenly spread."""
    some: Bool[np.ndarray, "period"] = np.isin(periods.scene, scenes[:: -(-len(scenes) // MOST_SCENES)])
    return Periods(periods.features[some], periods.merged[some], periods.scene[some], periods.samples)
