"""How sites differ in drivers and merges: what a forecaster of several sites keeps, and what it says of each site."""

from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Float, Shaped

from rampcast.models.between_sites import Population, fit_population
from rampcast.models.drivers import PARAMETERS, assumed_centre, driver_evidence
from rampcast.models.merging import MergeHazard, Periods
from rampcast.models.pooled_driver import LEAST_CASES
from rampcast.models.site_hazards import HazardPopulation, fit_hazards
from rampcast.traffic.platoons import Platoons

ASSUMED_SPREAD = 0.3  # between sites, of logarithms and habit, where no site tells: as wide as drivers of one ever are
MOST_OF_SITE = 400  # vehicles at moments by which the drivers of a site are estimated


@dataclass(frozen=True)
class Populations:
    """How sites differ; None of what fewer than two sites showed.

    Attributes:
        main, ramp: drivers of main lanes and of ramps; see `drivers.PARAMETERS`.
        hazard: of merges.
    """

    main: Population | None = None
    ramp: Population | None = None
    hazard: HazardPopulation | None = None


def driver_population(
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    leader_truth: Float[np.ndarray, "platoon step"],
    *,
    site: Shaped[np.ndarray, "platoon"],
    vehicle: Shaped[np.ndarray, "platoon"],
) -> Population | None:
    """Returns how drivers differ between sites; None if too few vehicles follow at all sites but one.

    Args:
        platoons, truth, leader_truth: of the training vehicles; see `drivers.fit_drivers`.
        site, vehicle: which each is of.
    """
    evidence = {}
    for name in np.unique(site).tolist():
        rows = np.flatnonzero((site == name) & (platoons.depth > 0))
        if len(rows) >= LEAST_CASES:
            rows = rows[:: -(-len(rows) // MOST_OF_SITE)]
            some = platoons.select(rows)
            found = driver_evidence(some, truth[rows], leader_truth[rows], vehicle[rows])
            if found.precision.any():  # else nobody was seen for long enough
                evidence[name] = found
    if len(evidence) < 2:
        return None
    spread = np.full(len(PARAMETERS), ASSUMED_SPREAD)
    return fit_population(evidence, names=PARAMETERS, assumed=assumed_centre(), spread=spread)


def hazard_population(
    periods: Periods, pooled: MergeHazard, *, site: Shaped[np.ndarray, "scene"], vehicle: Shaped[np.ndarray, "scene"]
) -> HazardPopulation | None:
    """Returns how hazards differ between sites; None if vehicles merge at fewer than two.

    Args:
        periods: of the training vehicles.
        pooled: the hazard of all together.
        site, vehicle: which each scene is of.
    """
    told = np.unique(site[periods.scene[periods.merged]])
    if len(told) < 2:
        return None
    some = np.isin(site[periods.scene], told)
    known = Periods(periods.features[some], periods.merged[some], periods.scene[some], periods.samples)
    return fit_hazards(known, site, vehicle, pooled)


def populations_table(populations: Populations) -> pl.DataFrame:
    """Returns how sites differ as a table: a row for each parameter and site.

    Its columns are what (drivers of main lanes, of ramps, or merges), parameter, mean (over sites), doubt (standard
    deviation of the mean), spread (standard deviation between sites), site, value and shrinkage, which is 1 where the
    site's vehicles say nothing and its value is that of the others.
    """
    parts = {
        "drivers of main lanes": populations.main,
        "drivers of ramps": populations.ramp,
        "merges": None if populations.hazard is None else populations.hazard.parameters,
    }
    schema = {
        "what": pl.String, "parameter": pl.String, "mean": pl.Float64, "doubt": pl.Float64, "spread": pl.Float64,
        "site": pl.String, "value": pl.Float64, "shrinkage": pl.Float64,
    }  # fmt: skip
    rows = [
        (what, name, one.mean[p], np.sqrt(one.doubt[p, p]), one.spread[p], site, one.values[s, p], one.shrinkage[s, p])
        for what, one in parts.items()
        if one is not None
        for p, name in enumerate(one.names)
        for s, site in enumerate(one.sites)
    ]
    return pl.DataFrame(rows, schema=schema, orient="row")
