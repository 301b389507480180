"""Which lane of a road is its on-ramp: one at the edge that vehicles leave and hardly anybody enters."""

from dataclasses import dataclass
from typing import Final

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.ramp import FROM, TO, lane_changes

SURE, MAYBE = 0.6, 0.25  # of the vehicles of a lane that begin in it and leave it to its neighbour
LEAST: Final = 4  # vehicles that do


@dataclass(frozen=True)
class Edge:
    """A lane at an edge of a road: its vehicles, those that began in it and left it, and those that entered it."""

    lane: int
    is_right: bool
    vehicles: int
    left: int
    entered: int

    @property
    def share(self) -> float:
        """Returns which share of its vehicles merge out of it, less those that change into it."""
        return max(self.left - self.entered, 0) / max(self.vehicles, 1)

    def __str__(self) -> str:
        side = "rightmost" if self.is_right else "leftmost"
        return (
            f"lane {self.lane} ({side}): {self.left} of its {self.vehicles} vehicles leave it, {self.entered} enter it"
        )


def edges_of(recording: Recording) -> list[Edge]:
    """Returns the outermost lanes of a road, that which is likelier to be its ramp first."""
    lanes = sorted(recording.site.lanes, key=lambda lane: lane.centre)
    if len(lanes) < 2:
        return []
    changes = lane_changes(recording.tracks)
    driven = recording.tracks.filter(pl.col(c.LANE) > 0).group_by(c.RECORDING, c.VEHICLE, maintain_order=True)
    firsts = driven.agg(pl.col(c.LANE).first())
    edges = []
    for lane, is_right in ((lanes[0].number, True), (lanes[-1].number, False)):
        vehicles = recording.tracks.filter(pl.col(c.LANE) == lane).select(c.RECORDING, c.VEHICLE).n_unique()
        began = firsts.filter(pl.col(c.LANE) == lane).select(c.RECORDING, c.VEHICLE)
        out = changes.filter(pl.col(FROM) == lane).join(began, on=(c.RECORDING, c.VEHICLE), how="semi")
        left = out.select(c.RECORDING, c.VEHICLE).n_unique()
        entered = changes.filter(pl.col(TO) == lane).join(began, on=(c.RECORDING, c.VEHICLE), how="anti")
        edges.append(Edge(lane, is_right, vehicles, left, entered.select(c.RECORDING, c.VEHICLE).n_unique()))
    return sorted(edges, key=lambda edge: (-round(edge.share, 2), not edge.is_right))


def is_ramp(edge: Edge) -> bool | None:
    """Returns whether a lane is the ramp; None where it may be."""
    if edge.left < LEAST or edge.share < MAYBE:
        return False
    return True if edge.share >= SURE else None
