"""NGSIM trajectories of freeways: the 18-column text, the csv of each site, and the portal's export.

Source: US Department of Transportation, Next Generation Simulation, data set 8ect-6jqj.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head
from rampcast.formats.format import Format, Needs, Recordings
from rampcast.formats.readers.ngsim import windows as clocks
from rampcast.formats.readers.ngsim.forms import LOCATION, WANTED, form_of, misses_ngsim
from rampcast.formats.readers.ngsim.site import guess_ngsim_site, of_others
from rampcast.formats.steps.units import FOOT
from rampcast.formats.steps.vehicles import with_sizes
from rampcast.formats.tables.columns import Column, Rows, alike
from rampcast.formats.tables.rows import read_rows
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.order import sorted_unique
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.sites import Site, load_site, site_names

SOURCE = "ngsim"
TIME_STEP = 0.1  # [s]
SHORTEST_CAR = 8.0  # [ft] the shortest car sold is 8.2 ft (2.5 m)
LATEST = 4_102_444_800_000  # [ms since 1970] the year 2100
LONGEST, WIDEST = 200, 30  # [ft] no road vehicle is larger
FASTEST = 500  # [ft/s] no car drives 550 km/h; NGSIM writes up to 95.3 ft/s
STRONGEST = 3000  # [ft/s^2] 93 g; NGSIM clips at 11.2 ft/s^2
LOOKED_AT = 50_000  # rows of a file that tell whether its positions are in the unit of its speeds
MOVING, NEAR = 1.0, 0.1  # [m/s] of vehicles that tell it, and how near the ratio must be to that of metre and foot
FARTHEST_CLOCK = 1000  # [ms] between the clocks of one window; in the originals it has but one
BESIDE = 50.0  # [m] positions this far beside the outer lanes are still believed
BEYOND = 0.25  # share of the site's length by which a position may lie outside; the originals go 9 % beyond
IN_METRES = (
    'Convert Local_X, Local_Y, v_Length and v_Width, or read it with --mapping, with unit = "m" where they are metres '
    "(docs/formats/ngsim.md has the whole file)"
)
RECORDED = {"v_vel": c.RECORDED_V, "v_acc": c.RECORDED_A}  # read where a file has them


def read_ngsim(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the trajectories of one site in NGSIM's files, and what reading found.

    Rows are told apart into the site's recorded windows by the clock of the recording (see `ngsim_windows`); rows
    outside all of them are kept under the site's name alone. Without a site the files' content tells it; its `location`
    picks the rows of the portal's export.
    """
    site = site or guess_ngsim_site(heads)
    parts, reports = [], []
    for head in heads:
        form, header = form_of(head)
        found = read_rows(replace(head, header=header), columns_of(site), bad_rows=bad_rows)
        _check_location(found, site)
        parts.append(_to_metres(found.table))
        _check_feet(found.file, parts[-1], site)
        reports.append(found.report(form))
    rows, filled = with_sizes(pl.concat(parts))
    del parts, found  # they are not needed beside the whole
    recording, report = _assemble(rows, site, replace(join_reports(reports), sizes_filled=filled))
    return (recording,), report


def columns_of(site: Site) -> tuple[Column, ...]:
    """Returns the columns of NGSIM's files, in feet, and what a row of that site may hold."""
    lateral = [-lane.centre for lane in site.lanes]
    left, right = round((min(lateral) - BESIDE) / FOOT), round((max(lateral) + BESIDE) / FOOT)
    lanes = tuple(lane.number for lane in site.lanes)
    unknown = f"lane {{}} is unknown: site {site.name} has the lanes {', '.join(map(str, lanes))}"

    def number(name: str, kind: Any, low: float | int = -math.inf, high: float | int = math.inf, **more: Any) -> Column:
        return Column(name, (name,), kind, low, high, **more)

    return (
        number("vehicle_id", pl.Int32(), 0),
        number("frame_id", pl.Int32(), 0),
        number("global_time", pl.Int64(), 0, LATEST),
        number("local_x", pl.Float64(), left, right),
        number("local_y", pl.Float64(), round(-BEYOND * site.length / FOOT), round((1 + BEYOND) * site.length / FOOT)),
        number("v_length", pl.Float32(), 0, LONGEST),
        number("v_width", pl.Float32(), 0, WIDEST),
        number("v_class", pl.Int8(), 1, len(c.KINDS)),
        number("lane_id", pl.Int16(), among=lanes, unknown=unknown),
        number("v_vel", pl.Float32(), -FASTEST, FASTEST, optional=True),
        number("v_acc", pl.Float32(), -STRONGEST, STRONGEST, optional=True),
        Column(LOCATION, (LOCATION,), pl.String(), optional=True, may_be_blank=True, only=alike(site.location)),
    )


def _to_metres(rows: pl.DataFrame) -> pl.DataFrame:
    """Returns rows in SI: x = Local_Y, and y = -Local_X because NGSIM counts to the right and rampcast to the left."""
    time, frame = pl.col("global_time"), pl.col("frame_id")
    return rows.select(
        pl.col("vehicle_id").alias(c.VEHICLE),
        frame.alias(c.FRAME),
        (pl.col("local_y") * FOOT).alias(c.X),
        (pl.col("local_x") * -FOOT).alias(c.Y),
        pl.col("lane_id").alias(c.LANE),
        (pl.col("v_length") * FOOT).alias(c.LENGTH),
        (pl.col("v_width") * FOOT).alias(c.WIDTH),
        _kind(pl.col("v_class")).alias(c.KIND),
        *(_recorded(rows, name).alias(ours) for name, ours in RECORDED.items()),
        (time - clocks.FRAME_MS * frame.cast(pl.Int64)).alias(clocks.CLOCK),
    )


def _recorded(rows: pl.DataFrame, name: str) -> pl.Expr:
    return pl.col(name) * FOOT if name in rows.columns else pl.lit(None, pl.Float32())


def _kind(v_class: pl.Expr) -> pl.Expr:
    """Returns the kind of vehicle; NGSIM's data dictionary: 1 motorcycle, 2 auto, 3 truck."""
    motorcycle, car, truck = (pl.lit(kind, dtype=c.SCHEMA[c.KIND]) for kind in c.KINDS)
    return pl.when(v_class == 1).then(motorcycle).when(v_class == 2).then(car).otherwise(truck)


def _check_location(found: Rows, site: Site) -> None:
    if not found.table.height:
        others = ", ".join(f"{location} ({count:,} rows)" for location, count in found.others.items())
        fits = [one.name for one in map(load_site, site_names()) if alike(one.location) in map(alike, found.others)]
        what = f"Read it with --site {fits[0]}" if fits else of_others(sorted(found.others))
        raise FormatError(
            f"{found.file}: no row has the Location '{site.location}' of site {site.name}; found {others}. {what}"
        )


def _check_feet(name: str, rows: pl.DataFrame, site: Site) -> None:
    cars = rows.filter(pl.col(c.KIND) == "car").select(c.LENGTH, c.WIDTH).median()
    median, width = (float(size or 0.0) / FOOT for size in cars.row(0))
    if 0 < median < SHORTEST_CAR and width > median:
        raise FormatError(
            f"{name}: half of the cars are {median:.1f} ft long and {width:.1f} ft wide: v_Length and v_Width seem to "
            "be exchanged. Exchange the names of these columns"
        )
    if (ratio := _speed_ratio(rows.head(LOOKED_AT))) and abs(ratio * FOOT - 1) < NEAR:
        raise FormatError(
            f"{name}: the vehicles' v_Vel are {ratio:.2f} times the speeds of their Local_Y: the positions seem to be "
            f"in metres. Expected NGSIM's own feet. {IN_METRES}"
        )
    if 0 < median < SHORTEST_CAR:
        raise FormatError(
            f"{name}: half of the cars are shorter than {median:.1f} ft ({median * FOOT:.1f} m): the "
            f"file seems to be in metres. Expected NGSIM's own feet. {IN_METRES}"
        )
    if abs(_times_beside(rows, site) / FOOT - 1) < NEAR:
        raise FormatError(
            f"{name}: Local_X is 0.3 times where the lanes lie: positions seem to be in metres. Expected NGSIM's own "
            f"feet. {IN_METRES}"
        )


def _times_beside(rows: pl.DataFrame, site: Site) -> float:
    """Returns how many times as far from the road's edge as the middle of their lane vehicles are, in the middle."""
    centres = {lane.number: lane.centre for lane in site.lanes if lane.centre}
    times = rows[c.Y] / rows[c.LANE].replace_strict(centres, default=None, return_dtype=pl.Float64)
    return float(np.median(times.drop_nulls().to_numpy())) if times.count() else 1.0


def _speed_ratio(rows: pl.DataFrame) -> float | None:
    """Returns the median ratio of recorded to derived speeds of moving vehicles; None if there is none."""
    sorted_rows = rows.sort(clocks.CLOCK, c.VEHICLE, c.FRAME)
    follows = pl.all_horizontal(pl.col(name) == pl.col(name).shift() for name in (clocks.CLOCK, c.VEHICLE))
    derived = pl.col(c.X).diff() / (pl.col(c.FRAME).diff() * TIME_STEP)
    moving = sorted_rows.select(derived=derived, recorded=c.RECORDED_V, follows=follows).filter(
        pl.col("follows") & (pl.col("derived") > MOVING) & (pl.col("recorded") > 0)
    )
    ratio = (moving["recorded"] / moving["derived"]).to_numpy()
    return float(np.median(ratio)) if len(ratio) else None


def _assemble(rows: pl.DataFrame, site: Site, report: ReadReport) -> tuple[Recording, ReadReport]:
    """Returns the recording: rows told apart into windows, duplicates removed, sorted."""
    table = clocks.clocks_of(rows)
    clocks.check_site(report.files[0], table, site)
    parts, began, duplicates, conflicts, slips, outside, off = [], {}, 0, 0, 0, 0, 0
    columns = [*c.SCHEMA, *(name for name in c.OPTIONAL_SCHEMA if _is_known(rows[name]))]
    for window, part in clocks.split_windows(rows, table, site.window_bounds()).items():
        name = f"{site.name}-{window}" if window else site.name
        part, removed, differing = sorted_unique(part.with_columns(pl.lit(name).alias(c.RECORDING)))
        duplicates, conflicts = duplicates + removed, conflicts + differing
        slips += _slips(part)
        began[name] = float(np.median(part[clocks.CLOCK].to_numpy())) / 1000.0  # [ms] to [s]; single clocks may slip
        outside += part.height if window == clocks.OUTSIDE else 0
        off += _off_clock(part, began[name]) if window != clocks.OUTSIDE else 0
        parts.append(part.select(columns))
    total = sum(part.height for part in parts)
    _check_slips(slips, total, report)
    _check_clock(off, total, report)
    report = replace(
        report,
        duplicates=duplicates,
        conflicting_duplicates=conflicts,
        rows_outside_windows=outside,
        clock_slips=slips,
        rows=total,
    )
    parts.sort(key=lambda part: str(part[c.RECORDING][0]))
    return Recording(pl.concat(parts), site, TIME_STEP, SOURCE, began=began), report


def _is_known(recorded: pl.Series) -> bool:
    """Returns whether a file gives speeds or accelerations at all: some are cut from sources without, and say 0."""
    return bool((recorded != 0).any())


def _slips(rows: pl.DataFrame) -> int:
    same = pl.col(c.VEHICLE) == pl.col(c.VEHICLE).shift(1)
    return int(rows.select((same & (pl.col(clocks.CLOCK) != pl.col(clocks.CLOCK).shift(1))).sum()).item())


def _check_slips(slips: int, rows: int, report: ReadReport) -> None:
    if slips > clocks.MOST_SLIPS * rows:
        raise FormatError(
            f"{', '.join(report.files)}: Frame_ID and Global_Time do not advance together in {slips:,} of {rows:,} "
            "rows. Expected 100 ms a frame. A spreadsheet program may have rounded Global_Time, or the file was "
            "resampled: use the original"
        )


def _off_clock(rows: pl.DataFrame, began: float) -> int:
    """Returns how many rows of a window are far from its clock, which began at that time [s since 1970]."""
    return int(((rows[clocks.CLOCK] - round(1000.0 * began)).abs() > FARTHEST_CLOCK).sum())


def _check_clock(off: int, rows: int, report: ReadReport) -> None:
    if off > clocks.MOST_SLIPS * rows:
        raise FormatError(
            f"{', '.join(report.files)}: Frame_ID is not that of Global_Time in {off:,} of {rows:,} rows: frames seem "
            "to be counted anew for each vehicle. Read it with a mapping of Global_Time (docs/formats/ngsim.md): "
            "frames follow from that"
        )


NGSIM = Format(
    "ngsim", "NGSIM freeway trajectories", ".txt, .csv, in .gz or .zip", read_ngsim, Needs(misses_ngsim, WANTED)
)
