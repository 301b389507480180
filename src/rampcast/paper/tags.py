"""The tags of the classes that the paper's framework is made of; see `rampcast.forecast.tags`."""

from rampcast.forecast.tags import SITE
from rampcast.models.plain_data import Tags
from rampcast.models.trees import Forests, Trees
from rampcast.paper.framework import PaperForecaster, PaperSpec
from rampcast.paper.lane_change.forests import Cumulative, ForestSpec, LaneChangeForests
from rampcast.paper.lane_change.sets import Reading, Sampling
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import Cell, LstmSpec, NeighbourLstm, Network

TAGS: Tags = {
    "paper": PaperForecaster,
    "training": PaperSpec,
    "site": SITE,
    "mode": Mode,
    "neighbours": NeighbourLstm,
    "neighbours_training": LstmSpec,
    "network": Network,
    "cell": Cell,
    "lane_changes": LaneChangeForests,
    "lane_changes_training": ForestSpec,
    "reading": Reading,
    "sampling": Sampling,
    "cumulative": Cumulative,
    "forests": Forests,
    "trees": Trees,
}
