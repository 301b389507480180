"""The tags of the classes that a forecaster is made of: the names by which model folders know them.

A tag stays when its class is moved or renamed. A new class needs a line here; a test names those that lack one.
"""

from rampcast.forecast.calibrated import Calibrated, CalibratedSpec, RolledRows
from rampcast.forecast.forecaster import Forecaster, ForecasterSpec
from rampcast.forecast.held_out import HeldOut
from rampcast.forecast.learning import Base
from rampcast.forecast.over_sites import SiteScore
from rampcast.forecast.populations import Populations
from rampcast.forecast.roll_out import Manners, RollOut
from rampcast.models.between_sites import Population
from rampcast.models.correction import Correction, CorrectionSpec, KnotCorrection
from rampcast.models.disturbance import Disturbance
from rampcast.models.drivers import DriverPrior
from rampcast.models.merge_forest import MergeForest
from rampcast.models.merging import MergeHazard
from rampcast.models.plain_data import OwnForm, Tags
from rampcast.models.platoon_head import Head
from rampcast.models.ranked_line import RankedLine
from rampcast.models.site_hazards import HazardPopulation
from rampcast.models.trees import BoostedTrees, Trees
from rampcast.sites import Site
from rampcast.sites.site import site_from_dict, site_to_dict

SITE = OwnForm(Site, site_to_dict, site_from_dict)
TAGS: Tags = {
    "rampcast": Forecaster,
    "training": ForecasterSpec,
    "site": SITE,
    "calibrated": Calibrated,
    "samples": CalibratedSpec,
    "base": Base,
    "held_out": HeldOut,
    "sites": Populations,
    "parameters_of_sites": Population,
    "hazards_of_sites": HazardPopulation,
    "roll_out": RollOut,
    "manners": Manners,
    "drivers": DriverPrior,
    "disturbance": Disturbance,
    "head": Head,
    "hazard": MergeHazard,
    "merge_curves": MergeForest,
    "correction": Correction,
    "correction_training": CorrectionSpec,
    "knot": KnotCorrection,
    "ranked_line": RankedLine,
    "boosted_trees": BoostedTrees,
    "trees": Trees,
}
STAGES: Tags = {
    **TAGS,
    "rolled": RolledRows,
    "site_score": SiteScore,
}  # what a training keeps on the way, beside parts of the model
