"""The ramp of a site, set by hand or proposed from the tracks: target lane, gore, end, merge zone, lane line.

What was proposed is said in the site's notes, so that it travels with the numbers that come of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.errors import SiteError
from rampcast.recording import columns as c
from rampcast.recording.recording import Recording
from rampcast.sites.site import LANE_WIDTH, NO_LANE, Lane, Note, Role, Site, site_from_dict, site_to_dict

EARLY, LATE = 0.01, 0.99  # of the changes from the ramp lie before and up to these: labels of single ones may be wrong
ZONE = (0.05, 0.95)  # of the changes lie in the merge zone between these
CELL = 20.0  # [m] in which the lane line is taken from the tracks
FEW = 5  # rows of both lanes in a cell below which the lane line is taken from the cells around
ASIDE = 1.5  # lane widths from the target lane's centre up to which the ramp runs beside it
OFF_CENTRE = 0.5  # [m] by which drivers keep off a lane's centre; beyond, the centre is another
CHANGING = 2.5  # [s] before and after the crossing: a change of lane takes about 5 s (Toledo and Zohar, 2007)
STRAIGHT = 0.1  # [m] a lane line that varies by less is straight along the road
SOURCE = "proposed by rampcast site"

VALUES = ("target_lane", "gore", "ramp_end", "merge_zone")

FROM, TO = "from_lane", "to_lane"


@dataclass(frozen=True)
class RampValues:
    """What somebody says of a ramp; None, or no lanes, where nothing is said. Positions are x [m]."""

    lanes: tuple[int, ...] = ()
    target_lane: int | None = None
    gore: float | None = None
    ramp_end: float | None = None  # infinite: the lane goes on
    merge_zone: tuple[float, float] | None = None

    def or_of(self, site: Site) -> "RampValues":
        """Returns these values, completed by those of a site that has a ramp, unless other ramp lanes are asked for."""
        if not site.has_ramp or (self.lanes and set(self.lanes) != set(site.ramp_lanes)):
            return self
        unsaid = {name: getattr(site, name) for name in VALUES if getattr(self, name) is None}
        return replace(self, lanes=site.ramp_lanes, **unsaid)


def lane_changes(tracks: pl.DataFrame) -> pl.DataFrame:
    """Returns the changes between lanes: recording, vehicle, `x` of the first row in the new lane [m], both lanes.

    Args:
        tracks: of a recording. Rows without a lane are passed over: a change may lie between the rows beside them.
    """
    key = (c.RECORDING, c.VEHICLE)
    rows = tracks.filter(pl.col(c.LANE) != NO_LANE).select(*key, c.X, c.LANE)
    same = pl.all_horizontal(pl.col(name) == pl.col(name).shift() for name in key)
    rows = rows.with_columns(pl.col(c.LANE).shift().alias(FROM))
    return rows.filter(same & (pl.col(c.LANE) != pl.col(FROM))).rename({c.LANE: TO}).select(*key, c.X, FROM, TO)


def lanes_driven(recording: Recording) -> pl.DataFrame:
    """Returns a row for each lane, from the left: number, role, centre [m], vehicles, rows, and changes out of it.

    `x_from` and `x_to` [m] are where 99 % of its rows lie; `left` and `right` count the changes to lanes on that side,
    `left_from` and `left_to` (and so on) are between which x [m] nine in ten of them lie.
    """
    lanes = sorted(recording.site.lanes, key=lambda lane: (-lane.centre, lane.number))
    driven = recording.tracks.group_by(c.LANE).agg(
        vehicles=pl.struct(c.RECORDING, c.VEHICLE).n_unique(),
        rows=pl.len(),
        x_from=pl.col(c.X).quantile(0.005),
        x_to=pl.col(c.X).quantile(0.995),
    )
    table = pl.DataFrame(
        {
            c.LANE: pl.Series([lane.number for lane in lanes], dtype=pl.Int16),
            "role": [lane.role for lane in lanes],
            "centre": pl.Series([lane.centre for lane in lanes], dtype=pl.Float64),
        }
    ).join(driven, on=c.LANE, how="left", maintain_order="left")
    table = table.with_columns(pl.col("vehicles", "rows").fill_null(0))
    changes = lane_changes(recording.tracks)
    centre = {lane.number: lane.centre for lane in lanes}
    to, out_of = (pl.col(name).replace_strict(centre, default=None, return_dtype=pl.Float64) for name in (TO, FROM))
    changes = changes.with_columns(to_left=to > out_of)
    for side in ("left", "right"):
        moved = changes.filter(pl.col("to_left") == (side == "left")).group_by(pl.col(FROM).alias(c.LANE))
        low, high = (pl.col(c.X).quantile(share) for share in ZONE)
        counts = moved.agg(pl.len().alias(side), low.alias(f"{side}_from"), high.alias(f"{side}_to"))
        table = table.join(counts, on=c.LANE, how="left", maintain_order="left").with_columns(pl.col(side).fill_null(0))
    return table


def with_ramp(site: Site, recording: Recording, values: RampValues) -> Site:
    """Returns the site with a ramp; what is not given is proposed from the tracks, and a note says so.

    Args:
        site: with the lanes of the recording.
        recording: made with this site.
        values: what is known of the ramp: its lanes, at least.

    Raises:
        SiteError: there is no such lane, or the values do not go together.
    """
    _check_lanes(site, values)
    before, site = site, replace(site, lanes=_roles(site, values.lanes))
    known, beside, reasons = _proposed(site, recording, values)
    found = replace(site, **{name: getattr(known, name) for name in VALUES})
    found = replace(
        found,
        lanes=_centred(found, beside),
        lane_line=_lane_line(found, beside),
        notes=(*_still_true(before, found), *(Note(why, SOURCE) for why in reasons)),
    )
    found = site_from_dict(site_to_dict(found))  # checks that the values go together
    _check_zone(found)
    return found


def _roles(site: Site, ramp_lanes: Sequence[int]) -> tuple[Lane, ...]:
    def role(lane: Lane) -> Role:
        return "ramp" if lane.number in ramp_lanes else "main" if lane.role == "ramp" else lane.role

    return tuple(replace(lane, role=role(lane)) for lane in site.lanes)


def _proposed(site: Site, recording: Recording, values: RampValues) -> tuple[RampValues, "_Beside", list[str]]:
    """Returns the values with proposals for what is not given, how both lanes run, and a reason for each proposal."""
    out_of_ramp = pl.col(FROM).is_in(values.lanes) & ~pl.col(TO).is_in(values.lanes)
    changes = lane_changes(recording.tracks).filter(out_of_ramp)
    reasons = []

    def settle(name: str, proposal: tuple[Any, str]) -> Any:
        nonlocal values
        if getattr(values, name) is None:
            values = replace(values, **{name: proposal[0]})
            reasons.append(proposal[1])
        return getattr(values, name)

    target = settle("target_lane", _target(site, changes))
    merges = changes.filter(pl.col(TO) == target).unique([c.RECORDING, c.VEHICLE], keep="first", maintain_order=True)
    places = np.sort(merges[c.X].to_numpy())
    beside = _beside(site, recording, target)
    gore = settle("gore", _gore(places, beside))
    end = settle("ramp_end", _end(places, beside, gore, site.length))
    settle("merge_zone", _zone(places, gore, end))
    return values, beside, reasons


def road_named(recordings: Sequence[Recording], name: str | None) -> Recording:
    """Returns the recording of the road of that name (all of its site's name, or the end of it); None if there is one.

    Raises:
        SiteError: there is no such road, or there are several.
    """
    found = [one for one in recordings if name is None or one.site.name == name or one.site.name.endswith(f"-{name}")]
    if len(found) != 1:
        known = ", ".join(f"{one.site.name} ({one.tracks.height:,} rows)" for one in recordings)
        raise SiteError(
            f"expected one road, found {len(found)}{f' named {name}' * bool(name)}; name it with --road: {known}"
        )
    return found[0]


def without_ramp(site: Site) -> Site:
    """Returns the site with no lane of a ramp."""
    notes = tuple(note for note in site.notes if note.source != SOURCE)
    return site_from_dict(site_to_dict(replace(site, lanes=_roles(site, ()), notes=notes)))


def mirrored(recording: Recording) -> Recording:
    """Returns the recording with left and right exchanged, its lanes numbered from the other side.

    For a source whose plane grows to the right where it should grow to the left. Set the ramp afterwards.
    """
    site = without_ramp(recording.site)
    order = sorted(site.lanes, key=lambda lane: (lane.centre, lane.number))
    numbers = {lane.number: number for number, lane in enumerate(order, start=1)} | {NO_LANE: NO_LANE}
    lanes = tuple(replace(lane, number=numbers[lane.number], centre=-lane.centre) for lane in order)
    tracks = recording.tracks.with_columns(
        -pl.col(c.Y), pl.col(c.LANE).replace_strict(numbers, default=NO_LANE, return_dtype=c.SCHEMA[c.LANE])
    )
    return replace(recording, tracks=tracks, site=replace(site, lanes=lanes, mirrored=not site.mirrored))


def _check_lanes(site: Site, values: RampValues) -> None:
    numbers = [lane.number for lane in site.lanes]
    for number in (*values.lanes, *([] if values.target_lane is None else [values.target_lane])):
        if number not in numbers:
            raise SiteError(f"site '{site.name}' has no lane {number}; its lanes are {numbers}")
    if not values.lanes or values.target_lane in values.lanes:
        raise SiteError(
            f"expected ramp lanes and another lane as their target, got {list(values.lanes)} and {values.target_lane}"
        )
    if set(numbers) == set(values.lanes):
        raise SiteError(
            f"site '{site.name}' has no lane beside those of the ramp that vehicles could merge into: name fewer with "
            "--ramp-lane, or say --no-ramp"
        )


def _check_zone(site: Site) -> None:
    low, high = site.merge_zone
    end = min(site.ramp_end, site.length)
    if low < site.gore or high > end:  # never of an unknown one, which is NaN
        raise SiteError(
            f"merge_zone: expected two x between the gore ({site.gore:.1f} m) and the end of the "
            f"ramp ({end:.1f} m), got {low:g} {high:g}; give --merge-zone, --gore or --ramp-end anew"
        )


def _target(site: Site, changes: pl.DataFrame) -> tuple[int, str]:
    """Returns the lane that most vehicles of the ramp move to, else the nearest on its left, else the nearest."""
    others = [lane for lane in site.lanes if lane.role != "ramp"]
    moved = {lane.number: changes.filter(pl.col(TO) == lane.number).height for lane in others}
    ramp = max(lane.centre for lane in site.lanes if lane.role == "ramp")

    def rank(lane: Lane) -> tuple[int, bool, float]:
        return moved[lane.number], lane.centre > ramp, -abs(lane.centre - ramp)

    best = max(others, key=rank).number
    if moved[best]:
        how = f"{moved[best]} of {changes.height} changes out of the ramp lead into it"
    else:
        how = "no vehicle leaves the ramp; it is the nearest beside it"
    return best, f"target_lane {best} is a proposal: {how}."


@dataclass(frozen=True)
class _Beside:
    """How the ramp and the target lane run beside each other: their y [m] in cells around x [m], where both are driven.

    `first` and `last` are the ends of what is driven on the ramp [m]; `through` of its `vehicles` drive on it to where
    the target lane is seen last.
    """

    x: Float[np.ndarray, "cell"]
    ramp: Float[np.ndarray, "cell"]
    target: Float[np.ndarray, "cell"]
    first: float
    last: float
    through: int
    vehicles: int


def _beside(site: Site, recording: Recording, target: int) -> _Beside:
    rows = _apart_from_changes(recording).filter(pl.col(c.X).is_between(0.0, site.length))
    rows = rows.filter(pl.col(c.LANE).is_in([target, *site.ramp_lanes]))
    is_target = pl.col(c.LANE) == target
    keeps = pl.col("keeps_lane")
    cells = rows.group_by((pl.col(c.X) / CELL).floor().alias("cell")).agg(
        ramp=pl.col(c.Y).filter(~is_target & keeps).median(),
        target=pl.col(c.Y).filter(is_target & keeps).median(),
        fewest=pl.min_horizontal((is_target & keeps).sum(), (~is_target & keeps).sum()),
    )
    cells = cells.filter(pl.col("fewest") >= FEW).sort("cell")
    driven = rows.filter(~is_target)[c.X].to_numpy()
    first, last = (float(driven.min()), float(driven.max())) if len(driven) else (0.0, site.length)
    x = (cells["cell"].to_numpy() + 0.5) * CELL
    on_ramp = recording.tracks.filter(pl.col(c.LANE).is_in(site.ramp_lanes))
    reached = on_ramp.group_by(c.RECORDING, c.VEHICLE).agg(pl.col(c.X).max())[c.X].to_numpy()
    ends = float(rows.filter(is_target).select(pl.col(c.X).max().fill_null(site.length)).item())  # where sight ends
    through = int(np.count_nonzero(reached >= ends - CELL))
    return _Beside(x, cells["ramp"].to_numpy(), cells["target"].to_numpy(), first, last, through, len(reached))


def _apart_from_changes(recording: Recording) -> pl.DataFrame:
    """Returns x, y and lane of all rows, and whether their vehicles keep the lane around that moment.

    A vehicle that changes lane is near the line before and after, on one side of a lane's middle.
    """
    key = (c.RECORDING, c.VEHICLE)
    changed = pl.col(c.LANE) != pl.col(c.LANE).shift().over(key)
    moment = pl.when(changed).then(pl.col(c.FRAME))
    since = pl.col(c.FRAME) - moment.forward_fill().over(key)
    until = moment.backward_fill().over(key) - pl.col(c.FRAME)
    most = CHANGING / recording.time_step
    keeps = (since > most).fill_null(True) & (until > most).fill_null(True)
    return recording.tracks.select(c.X, c.Y, c.LANE, keeps_lane=keeps)


def _lane_line(site: Site, beside: _Beside) -> tuple[tuple[float, float], ...]:
    """Returns the points (x, y) [m] half-way between ramp and target lane."""
    middle = (beside.ramp + beside.target) / 2
    if len(middle) == 0:
        ramp = max(lane.centre for lane in site.lanes if lane.role == "ramp")
        middle = np.array([(ramp + site.lane_centre(site.target_lane)) / 2])
    if len(middle) == 1 or np.ptp(middle) < STRAIGHT:
        y = round(float(np.median(middle)), 2)
        return ((0.0, y), (site.length, y))
    return tuple((float(x), round(float(y), 2)) for x, y in zip(beside.x, middle, strict=True))


def _centred(site: Site, beside: _Beside) -> tuple[Lane, ...]:
    """Returns the lanes, that of the ramp beside the target lane centred where it is driven between gore and ramp end.

    A draft's centre is that of all its rows, also of those upstream where the ramp comes from afar.
    """
    here = (beside.x >= site.gore) & (beside.x <= site.ramp_end)
    if not here.any():
        return site.lanes
    target = site.lane_centre(site.target_lane)
    ramp = min((lane for lane in site.lanes if lane.role == "ramp"), key=lambda lane: abs(lane.centre - target))
    centre = round(float(np.median(beside.ramp[here])), 2)
    if abs(centre - ramp.centre) < OFF_CENTRE:
        return site.lanes
    return tuple(replace(lane, centre=centre) if lane == ramp else lane for lane in site.lanes)


def _still_true(before: Site, found: Site) -> list[Note]:
    """Returns the notes of a site but those on a proposal that is no longer its value."""

    def is_true(note: Note) -> bool:
        name = note.text.split()[0]
        return note.source != SOURCE or getattr(before, name) == getattr(found, name)

    return [note for note in before.notes if is_true(note)]


def _gore(places: Float[np.ndarray, "merge"], beside: _Beside) -> tuple[float, str]:
    near = np.abs(beside.target - beside.ramp) <= ASIDE * LANE_WIDTH
    first = float(beside.x[near.argmax()] - CELL / 2) if near.any() else beside.first
    if len(places) == 0:
        return first, f"gore {first:.0f} m is a proposal: from there on the ramp runs beside the target lane."
    gore = max(float(np.floor(np.quantile(places, EARLY))), 0.0)
    text = f"gore {gore:.0f} m is a proposal: 99 % of the {len(places)} vehicles that merge do so beyond it"
    return gore, f"{text}; the ramp runs beside the target lane from about {first:.0f} m."


def _end(places: Float[np.ndarray, "merge"], beside: _Beside, gore: float, length: float) -> tuple[float, str]:
    if beside.through > (1.0 - LATE) * beside.vehicles:
        how = f"{beside.through} of the {beside.vehicles} vehicles of the ramp drive on it to the end of the section"
        return np.inf, f"ramp_end is left out: the lane goes on, as {how}; if it ends there, give --ramp-end."
    if len(places) == 0 or beside.last < length - CELL:
        end = float(np.ceil(beside.last))
        how = "no vehicle is seen on the ramp beyond it; the lane itself may go on"
    else:
        end = float(np.ceil(np.quantile(places, LATE)))
        how = "hardly a vehicle drives on the ramp to the end of the section, and 99 % of the merges lie before it"
    end = min(max(end, gore + 1.0), length)
    return end, f"ramp_end {end:.0f} m is a proposal: {how}."


def _zone(places: Float[np.ndarray, "merge"], gore: float, end: float) -> tuple[tuple[float, float], str]:
    if len(places) == 0 and np.isinf(end):
        return (np.nan, np.nan), "merge_zone is left out: no merge was seen."
    if len(places) == 0:
        return (gore, end), "merge_zone is a proposal: from gore to ramp_end, since no merge was seen."
    low, high = (float(np.clip(round(place), gore, end)) for place in np.quantile(places, ZONE))
    return (low, high), f"merge_zone {low:.0f} to {high:.0f} m is a proposal: nine in ten merges lie in it."
