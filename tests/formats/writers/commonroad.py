"""Writes a recording as CommonRoad scenarios: centres, radians, and the lanes as one lanelet each."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.reference import in_plane, reference_line
from rampcast.sites import Site
from tests.formats.writers.common import lane_edges, planar

FIRST_LANELET = 100
POINTS_APART = 0.5  # [m] along the bounds; on the test's bend they leave their arc by 0.1 mm
ON_THE_LINE = 2e-5  # [m] to the left, so that a vehicle right on a line belongs to the lane on its right
BEYOND = 60.0  # [m] before and after the site


def write_commonroad(recording: Recording, folder: Path) -> list[Path]:
    """Returns the files written, one a window."""
    paths = []
    for number, name in enumerate(recording.names, start=1):
        tracks = planar(recording.window(name))
        obstacles = [_obstacle(track) for track in tracks.partition_by(c.VEHICLE)]
        path = folder / f"scenario-{number}.xml"
        path.write_text(
            "<?xml version='1.0' encoding='UTF-8'?>\n"
            f'<commonRoad timeStepSize="{recording.time_step}" commonRoadVersion="2020a" author="" affiliation="" '
            f'source="made for a test" benchmarkID="ZAM_Test-1_{number}_T-1" date="2020-01-01">\n'
            + "".join([*_lanelets(recording.site), *obstacles])
            + "</commonRoad>\n"
        )
        paths.append(path)
    return paths


def site_of(site: Site) -> Site:
    """Returns the site whose lanes are named by their lanelets."""
    order = sorted(site.lanes, key=lambda lane: -lane.centre)
    return replace(
        site,
        lanes=tuple(replace(lane, sources=(str(FIRST_LANELET + index),)) for index, lane in enumerate(order)),
    )


def _lanelets(site: Site) -> list[str]:
    edges = [edge + ON_THE_LINE for edge in lane_edges(site)]
    return [
        f'  <lanelet id="{FIRST_LANELET + index}">\n    <leftBound>{_bound(site, left)}</leftBound>\n'
        f"    <rightBound>{_bound(site, right)}</rightBound>\n  </lanelet>\n"
        for index, (left, right) in enumerate(pairwise(edges))
    ]


def _bound(site: Site, y: float) -> str:
    x = np.arange(-BEYOND, site.length + BEYOND, POINTS_APART)
    px, py = x, np.full(len(x), y)
    if site.reference:
        px, py = in_plane(reference_line(np.array(site.reference)), x, py)
    return "".join(f"<point><x>{a:.6f}</x><y>{b:.6f}</y></point>" for a, b in zip(px, py, strict=True))


def _obstacle(track: pl.DataFrame) -> str:
    first = track.row(0, named=True)
    half = pl.col(c.LENGTH).cast(pl.Float64) / 2
    states = track.select(
        pl.format(
            "<position><point><x>{}</x><y>{}</y></point></position><orientation><exact>{}</exact></orientation>"
            "<time><exact>{}</exact></time><velocity><exact>{}</exact></velocity>",
            (pl.col("px") - pl.col("heading").cos() * half).round(5),
            (pl.col("py") - pl.col("heading").sin() * half).round(5),
            pl.col("heading").round(6),
            c.FRAME,
            pl.col("speed").round(4),
        )
    ).to_series()
    return (
        f'  <dynamicObstacle id="{first[c.VEHICLE]}">\n    <type>{first[c.KIND]}</type>\n    <shape><rectangle>'
        f"<length>{first[c.LENGTH]}</length><width>{first[c.WIDTH]}</width></rectangle></shape>\n"
        f"    <initialState>{states[0]}</initialState>\n    <trajectory>\n"
        + "".join(f"      <state>{state}</state>\n" for state in states[1:])
        + "    </trajectory>\n  </dynamicObstacle>\n"
    )
