"""CommonRoad scenarios (xml 2018b and 2020a): seconds of traffic on lanelets, many cut from real recordings.

Positions are where the origin of an obstacle's shape is, which is the centre of a rectangle.
Source: the documentation of CommonRoad's xml; see docs/formats/commonroad.md.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head
from rampcast.formats.files.xml_text import find_root
from rampcast.formats.format import Format, Needs, Recordings
from rampcast.formats.readers.commonroad.xml import ROOT, Scenario, read_scenario, read_time_step
from rampcast.formats.steps.clock import check_one_step
from rampcast.formats.steps.headings import check_headings, heading_elsewhere
from rampcast.formats.steps.lanelets import lanelet_at
from rampcast.formats.steps.places import different_names, one_place
from rampcast.formats.steps.vehicles import whole_ids
from rampcast.recording import columns as c
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows, ReadReport, join_reports
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, ROAD, SOURCE_LANE, Plane
from rampcast.roads.project import on_roads
from rampcast.sites import Site

BENCHMARK = re.compile(r"(?:C-)?(([A-Z]{3})_\w+?-\d+)_.+")  # country, place and number of the map, then what drives
NOWHERE_LAND = "ZAM"  # Zamunda, the country of made-up scenarios
HEADINGS = {"id": "id", c.FRAME: c.FRAME, "x": "x", "y": "y", "heading": "orientation"}
WITHOUT_THEM = "Mend the file, or leave such obstacles out with --skip-bad-rows (bad_rows=BadRows.SKIP)"
STATE = ("id", c.KIND, "box", c.FRAME, "x", "y", "orientation", c.RECORDED_V, c.RECORDED_A)


def misses_commonroad(head: Head) -> str | None:
    """Returns the first thing a file lacks to be a CommonRoad scenario; None if nothing."""
    root = find_root(head.text)
    return None if root is not None and root.name == ROOT else f"no xml that begins with <{ROOT}>"


def read_commonroad(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in scenarios of one map, each a part named by its benchmarkID, and what reading found."""
    scenarios = [_with_headings(read_scenario(head.path, bad_rows), bad_rows) for head in heads]
    paths = [head.path for head in heads]
    names = [one.attributes.get("benchmarkID") or path.stem for one, path in zip(scenarios, paths, strict=True)]
    different_names(paths, names)
    one_place(paths, [match[1] if (match := BENCHMARK.fullmatch(name)) else "" for name in names])
    steps = [read_time_step(scenario) for scenario in scenarios]
    check_one_step(paths, steps)
    found = [_in_plane(scenario, name) for scenario, name in zip(scenarios, names, strict=True)]
    benchmark = BENCHMARK.fullmatch(names[0])
    is_simulated = any("simulated" in scenario.tags for scenario in scenarios)
    plane = Plane(
        name=benchmark[1] if benchmark else "commonroad",
        title=f"CommonRoad, {benchmark[1] if benchmark else names[0]}",
        source="commonroad",
        rows=pl.concat([rows for rows, _ in found]),
        time_step=steps[0],
        simulated=is_simulated or (benchmark is not None and benchmark[2] == NOWHERE_LAND),
    )
    return on_roads(plane, site, join_reports([report for _, report in found]))


def _with_headings(scenario: Scenario, bad_rows: BadRows) -> Scenario:
    """Returns a scenario whose obstacles head where they move; those that do not are left out if asked for.

    Raises:
        FormatError: some do not and are not to be left out, or half of them do not: the headings are of another kind.
    """
    if not scenario.states:
        return scenario
    columns = dict(zip(STATE, zip(*scenario.states, strict=True), strict=True))
    states = pl.DataFrame({ours: columns[name] for ours, name in HEADINGS.items()})
    time_step = read_time_step(scenario)
    try:
        advice = WITHOUT_THEM if bad_rows is BadRows.RAISE else "Mend the file"
        check_headings(scenario.file, states, ["id"], time_step=time_step, advice=advice)
    except FormatError:
        wrong = set(heading_elsewhere(states, "id", time_step=time_step))
        kept = [state for state in scenario.states if state[0] not in wrong]
        order = dict.fromkeys(state[0] for state in scenario.states)
        if bad_rows is BadRows.RAISE or not 0 < 2 * len(wrong) < len(order):
            raise
        faults = [
            BadRow(scenario.file, number, 0, f"'{one}' heads elsewhere than it moves", "obstacle")
            for number, one in enumerate(order, start=1)
            if one in wrong
        ]
        counted = scenario.faults_counted + len(scenario.states) - len(kept)
        return replace(scenario, states=kept, faults=[*scenario.faults, *faults][:MOST_LISTED], faults_counted=counted)
    return scenario


def _in_plane(scenario: Scenario, name: str) -> tuple[pl.DataFrame, ReadReport]:
    """Returns the rows of a scenario with the front centre as position, and what reading found."""
    if not scenario.states:
        why = f" {scenario.faults[0]}" if scenario.faults else ""
        if name.startswith("C-"):
            why = " It is a cooperative scenario: its vehicles are planning problems, which have no trajectories."
        raise FormatError(f"{scenario.file}: no vehicle moves in it; expected obstacles with states.{why}")
    columns = dict(zip(STATE, zip(*scenario.states, strict=True), strict=True))
    boxes = columns.pop("box")
    length, width, ahead, left = (
        np.array([getattr(box, part) for box in boxes]) for part in ("length", "width", "front_x", "front_y")
    )
    x, y, heading = (np.array(columns.pop(part)) for part in ("x", "y", "orientation"))
    px = x + np.cos(heading) * ahead - np.sin(heading) * left
    py = y + np.sin(heading) * ahead + np.cos(heading) * left
    lanelets = [lanelet.name for lanelet in scenario.lanelets]
    inside = [lanelets[index] if index >= 0 else None for index in lanelet_at(scenario.lanelets, px, py)]
    ids, renumbered = whole_ids(pl.Series(columns.pop("id")))
    values = columns | {c.LENGTH: length, c.WIDTH: width, PX: px, PY: py, SOURCE_LANE: inside, c.VEHICLE: ids}
    rows = pl.DataFrame(values | {c.RECORDING: [name] * len(px), ROAD: [None] * len(px)}, strict=False)
    report = ReadReport(
        files=(scenario.file,),
        forms=(f"CommonRoad {scenario.attributes.get('commonRoadVersion', 'of no version')}",),
        rows_read=len(px) + scenario.not_vehicles + scenario.faults_counted,
        rows_skipped=scenario.faults_counted,
        skipped=tuple(scenario.faults),
        rows_not_vehicles=scenario.not_vehicles,
        vehicles_renumbered=renumbered,
    )
    return rows.select(pl.col(column).cast(type_) for column, type_ in PLANE_SCHEMA.items()), report


COMMONROAD = Format(
    "commonroad", "CommonRoad scenarios", ".xml, in .gz or .zip", read_commonroad, Needs(misses_commonroad)
)
