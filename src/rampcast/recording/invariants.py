"""What every recording of a road keeps, whatever it was made from: checked before anything is written or forecast.

One set of checks for the doctor, `inspect` and the doors of `convert`, `train`, `forecast` and `serve`. Each finds at
most one `Breach`: the worst place, how many there are, and whether they spoil a forecast.
"""

from collections.abc import Callable, Iterator

import numpy as np
import polars as pl
from jaxtyping import Bool, Int

from rampcast.arguments import expected
from rampcast.horizon import SAME_STEP, STEP
from rampcast.recording import columns as c
from rampcast.recording.breach import Breach, refuse
from rampcast.recording.cutting import FASTEST
from rampcast.recording.recording import KEY, READ_FIRST, Recording
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION, SHORTEST_STEP
from rampcast.recording.track_rows import Row, TrackRows
from rampcast.sites import Site

BESIDE = 500.0  # [m] and half the section before and behind it: the originals of NGSIM go 9 % beyond
ASIDE = 500.0  # [m] beside the lanes: a ramp that comes from afar
LENGTHS = (1.0, 30.0)  # [m] a moped is 1.7 m long, the longest road trains in Europe 25.25 m
CAR_LENGTHS = (2.5, 9.0)  # [m] of the median car; feet taken for metres are 13 and more; the doctor is stricter
LONGEST_STEP = 2.0  # [s] a car that drives 30 m/s is 60 m on, and may have changed its lane meanwhile
LONGEST_HOLE = 6 * 3600.0  # [s] in which nobody is seen; a longer one parts two recordings
BESIDE_LANE = 5.0  # [m] more than a lane's width
LANE_SPACING = (1.5, 15.0)  # [m] between two lanes' centres next to each other; beyond it there is another road
BACKWARDS = -5.0  # [m] a vehicle that ends a car's length behind where it began drives upstream
RATIO = (0.86, 1.14)  # of recorded to derived speeds; whole m/s in a queue are 0.9, 25 Hz read as 30 1.2, 30 as 25 0.83
MOST_FASTEST = 50.0  # [m/s] 180 km/h: on roads without a limit half of the cars drive 40 m/s or less
MOVING = 3.0  # [m/s] slower vehicles tell nothing of a ratio
SLOWEST = 0.001  # [m/s] of a ratio: what does not move at all has none
SAME_PLACE = 0.5  # [m] two vehicles cannot be in one lane and so near to each other
SPEED_OFF = 2.0  # [m/s] of a smoothed speed against its positions: 10 m after 5 s
SLIP = 5.0  # [m] and all that grip allows, from where a vehicle was going; `cutting` cuts there
FEW = 20  # rows below which shares tell nothing
FEWEST = 3  # vehicles of a lane that tell its direction
SAME_UNIT = 0.05  # by which a ratio of speeds may be off a unit's factor
RARE, SOME, MANY, HALF = 0.001, 0.01, 0.1, 0.5  # shares of rows, or of vehicles
UNITS = {"km/h": 3.6, "miles per hour": 1 / 0.44704, "feet per second": 1 / 0.3048}  # of a speed over one in m/s

Check = Callable[[TrackRows], Breach | None]


def most_at_once(site: Site) -> int:
    """Returns how many of the shortest cars fit into the lanes of a site, and of what may be seen beside it."""
    return int(len(site.lanes) * 2 * (site.length + BESIDE) / CAR_LENGTHS[0])


def breaches_of(recording: Recording) -> tuple[Breach, ...]:
    """Returns what of a recording no road or vehicle has."""
    if recording.tracks.is_empty():
        return ()
    sorted_tracks = recording.tracks.sort(KEY, maintain_order=True)
    repeats = pl.all_horizontal(pl.col(name) == pl.col(name).shift() for name in KEY).fill_null(False)
    rows = TrackRows(recording, sorted_tracks.filter(~repeats))
    return tuple(_found(rows))


def check_believable(recording: Recording, *, doing: str) -> tuple[Breach, ...]:
    """Returns the breaches of a recording that may be gone on with.

    Args:
        recording: whose `is_accepted` says whether somebody accepted what it is like; its raw rows count too.
        doing: what is about to be done, as "forecast of i80".

    Raises:
        RecordingError: a breach spoils a forecast, and nobody accepted it.
    """
    expected(Recording, recording, name="recording", advice=READ_FIRST)
    raw = () if recording.raw is None else breaches_of(recording.raw)
    found = (*raw, *(one for one in breaches_of(recording) if one.name not in {breach.name for breach in raw}))
    if not recording.is_accepted:
        refuse(found, doing=doing)
    return found


def _found(rows: TrackRows) -> Iterator[Breach]:
    for check in CHECKS:
        if (breach := check(rows)) is not None:
            yield breach


def _no_numbers(rows: TrackRows) -> Breach | None:
    """Returns positions, speeds and sizes that are no finite numbers."""
    names = [name for name in (c.X, c.Y, c.LENGTH, c.WIDTH, c.V, c.U, c.A, c.E) if name in rows.tracks.columns]
    finite = rows.tracks.select(pl.all_horizontal(pl.col(name).is_finite().fill_null(False) for name in names))
    found = ~finite.to_series().to_numpy()
    words = {"what": f"not all of {', '.join(names)} are finite numbers", "expected": "finite numbers"}
    return rows.breach(
        "no_numbers",
        found,
        np.full(len(found), np.nan),
        len(found),
        0.0,
        **words,
        cause="a damaged file, or a division by 0",
    )


def _time_step(rows: TrackRows) -> Breach | None:
    step = rows.recording.time_step
    if rows.recording.is_smoothed and abs(step - STEP) > SAME_STEP:
        what, usual = "the time step of a smoothed recording is another", f"{STEP} s"
    elif not SHORTEST_STEP <= step <= LONGEST_STEP:
        word = "short" if step < SHORTEST_STEP else "long"
        what, usual = f"the time step is too {word} [s]", f"{SHORTEST_STEP} to {LONGEST_STEP:g} s"
    elif (apart := _apart(rows)) > LONGEST_STEP:
        what, usual, step = "the rows of a vehicle lie too far apart [s]", f"{LONGEST_STEP:g} s at most of half", apart
    else:
        return None
    return Breach("time_step", what, "", None, None, step, usual, 1, 1, "a wrong unit of the times", 0.0)


def _apart(rows: TrackRows) -> float:
    """Returns the median time from a vehicle's row to its next [s]; 0 where no vehicle has two."""
    frames = np.diff(rows.tracks[c.FRAME].to_numpy().astype(float), prepend=0.0)[rows.same]
    return float(np.median(frames)) * rows.recording.time_step if len(frames) else 0.0


def _holes(rows: TrackRows) -> Breach | None:
    """Returns holes in which nobody is seen for hours."""
    frames = rows.tracks.select(c.RECORDING, c.FRAME).unique().sort(c.RECORDING, c.FRAME)
    hole = frames.with_columns(hole=pl.col(c.FRAME).cast(pl.Int64).diff().over(c.RECORDING) * rows.recording.time_step)
    worst = hole.filter(pl.col("hole") > LONGEST_HOLE).sort("hole", descending=True)
    if worst.is_empty():
        return None
    window, frame, seconds = worst.row(0)
    return Breach(
        "long_holes", "nobody is seen for hours [s]", str(window), None, frame, seconds,
        f"{LONGEST_HOLE:,.0f} s at most", worst.height, frames.height,
        "two recordings in one window, or a wrong unit of the times", 0.0,
    )  # fmt: skip


def _places(rows: TrackRows) -> Breach | None:
    site = rows.recording.site
    beyond = BESIDE + site.length / 2
    found = (rows.x < -beyond) | (rows.x > site.length + beyond)
    words = {"what": "positions far beyond the section [m]", "expected": f"x from 0 to {site.length:g} m"}
    cause = "the wrong site, a wrong unit, or an origin that is not the site's"
    return rows.breach("far_places", found, rows.x, len(found), SOME, **words, cause=cause)


def _lateral(rows: TrackRows) -> Breach | None:
    centres = [lane.centre for lane in rows.recording.site.lanes]
    y = rows.tracks[c.Y].to_numpy().astype(float)
    found = (y < min(centres) - ASIDE) | (y > max(centres) + ASIDE)
    words = {"what": "positions far beside the lanes [m]", "expected": f"y from {min(centres):g} to {max(centres):g} m"}
    return rows.breach(
        "far_aside",
        found,
        y,
        len(found),
        SOME,
        **words,
        cause="swapped axes, a wrong unit, or the wrong reference line",
    )


def _speeds(rows: TrackRows) -> Breach | None:
    size = np.abs(rows.speed[np.isfinite(rows.speed)])
    middle = float(np.median(size)) if len(size) >= FEW else 0.0
    fastest, who = (MOST_FASTEST, "traffic") if FASTEST >= middle > MOST_FASTEST else (FASTEST, "vehicle")
    found = np.abs(rows.speed) > fastest
    words = {"what": f"speeds that no {who} has [m/s]", "expected": f"{fastest:g} m/s at most"}
    is_unit = len(size) > 0 and np.median(size) > MOST_FASTEST
    cause = "a wrong unit of positions or times" if is_unit else "jumps: ids of two vehicles, or of two places, in one"
    return rows.breach("impossible_speeds", found, rows.speed, len(found), SOME, **words, cause=cause)


def _jumps(rows: TrackRows) -> Breach | None:
    """Returns rows that lie far from where the steps before and after say that the vehicle was going."""
    before = np.r_[np.nan, rows.speed[:-1]]
    before[1:][~rows.same[:-1]] = np.nan
    after = np.where(np.r_[rows.same[1:], False], np.r_[rows.speed[1:], np.nan], np.nan)
    off = (rows.speed - np.fmin(before, after)) * rows.elapsed
    low = (rows.speed - np.fmax(before, after)) * rows.elapsed
    reach = SLIP + IMPOSSIBLE_ACCELERATION * rows.elapsed**2 / 2
    with np.errstate(invalid="ignore"):
        found = ((off > reach) & (low > reach)) | ((off < -reach) & (low < -reach))
    values = np.where(found, np.diff(rows.x, prepend=np.nan), np.nan)
    words = {"what": "vehicles that jump [m]", "expected": f"steps of {SLIP:g} m and what grip allows at most"}
    cause = "two vehicles with one id, files of two places read as one, or a simulator's teleport"
    return rows.breach("jumps", found, values, len(found), RARE, **words, cause=cause)


def _accelerations(rows: TrackRows) -> Breach | None:
    if not rows.recording.is_smoothed:
        return None
    a = rows.tracks[c.A].to_numpy()
    with np.errstate(invalid="ignore"):
        found = np.abs(a) > IMPOSSIBLE_ACCELERATION
    words = {"what": "accelerations beyond grip [m/s²]", "expected": f"{IMPOSSIBLE_ACCELERATION:g} m/s² at most"}
    cause = "jumps, or accelerations that were not smoothed"
    return rows.breach("accelerations", found, a, len(found), SOME, **words, cause=cause)


def _smoothed_speeds(rows: TrackRows) -> Breach | None:
    """Returns smoothed speeds that are not those of the smoothed positions."""
    if not rows.recording.is_smoothed:
        return None
    v = rows.tracks[c.V].to_numpy()
    mean = np.where(rows.same, (v + np.r_[np.nan, v[:-1]]) / 2, np.nan)
    with np.errstate(invalid="ignore"):
        off = mean - rows.speed
        found = (np.abs(off) > SPEED_OFF) & (rows.elapsed <= STEP + SAME_STEP)
    words = {
        "what": "speeds that are not those of the positions [m/s]",
        "expected": f"{SPEED_OFF:g} m/s of difference at most",
    }
    return rows.breach(
        "speeds_off", found, off, len(found), SOME, **words, cause="another time step, or another unit in one column"
    )


def _recorded_speeds(rows: TrackRows) -> Breach | None:
    """Returns recorded speeds that are, on the whole, not those of the positions."""
    if c.RECORDED_V not in rows.tracks.columns:
        return None
    recorded = np.abs(rows.tracks[c.RECORDED_V].fill_null(float("nan")).to_numpy().astype(float))
    derived = np.abs(rows.speed)
    with np.errstate(invalid="ignore"):
        known = np.isfinite(recorded) & np.isfinite(derived)
        moving = known & (recorded > MOVING)  # positions that tremble make those faster that are looked at by them
        moving = moving if moving.sum() >= FEW else known & (derived > MOVING)
    if moving.sum() < FEW or not recorded[moving].any():
        return None
    ratio = recorded[moving] / np.maximum(derived[moving], SLOWEST)
    median = float(np.median(ratio))
    if RATIO[0] <= median <= RATIO[1]:
        return _two_units(rows, moving, np.where(moving, recorded / np.maximum(derived, SLOWEST), np.nan))
    unit = next((name for name, factor in UNITS.items() if abs(median / factor - 1) < SAME_UNIT), "")
    cause = f"recorded speeds in {unit}" if unit else _why_slower(median)
    return Breach(
        "recorded_speeds", "recorded speeds are not those of the positions (ratio)", "", None, None, median,
        f"{RATIO[0]} to {RATIO[1]}", int(moving.sum()), int(moving.sum()), cause, 1.0 if unit else HALF,
    )  # fmt: skip


def _why_slower(ratio: float) -> str:
    """Returns what may make recorded speeds so many times those of the positions, where they are in no other unit."""
    taken = {"m/s taken for feet per second, or positions in feet for metres": 0.3048, "m/s taken for km/h": 1 / 3.6}
    other = next((what for what, factor in taken.items() if abs(ratio / factor - 1) < SAME_UNIT), "")
    return other or "a wrong unit of positions or times"


def _two_units(rows: TrackRows, moving: Bool[np.ndarray, "row"], ratio: Row) -> Breach | None:
    """Returns the vehicles whose speeds are as if their positions, or speeds, were in another unit than others'."""
    starts = np.flatnonzero(~rows.same)
    track = np.repeat(np.arange(len(starts)), np.diff(np.r_[starts, len(ratio)]))
    moved = pl.DataFrame({"track": track, "ratio": ratio}).filter(pl.Series(moving))
    middle = moved.group_by("track").agg(pl.col("ratio").median(), pl.len()).filter(pl.col("len") >= FEW)
    values = np.full(len(starts), np.nan)
    values[middle["track"].to_numpy()] = middle["ratio"].to_numpy()
    found = np.zeros(len(starts), bool)
    for factor in UNITS.values():
        found |= (np.abs(values / factor - 1) < SAME_UNIT) | (np.abs(values * factor - 1) < SAME_UNIT)
    is_found, shown = np.zeros((2, len(ratio)))
    is_found[starts], shown[starts] = found, np.nan_to_num(values)
    words = {"what": "vehicles in another unit than others (ratio of speeds)", "expected": f"{RATIO[0]} to {RATIO[1]}"}
    cause = "two units in one column, or files in two units read as one"
    return rows.breach("two_units", is_found.astype(bool), shown, middle.height, MANY, **words, cause=cause)


def _directions(rows: TrackRows) -> Breach | None:
    starts = np.flatnonzero(~rows.same)
    ends = np.r_[starts[1:], len(rows.x)] - 1
    came = rows.x[ends] - rows.x[starts]
    found, values = np.zeros((2, len(rows.x)))
    values[starts] = came
    found[starts] = came < BACKWARDS
    words = {"what": "vehicles that drive upstream [m]", "expected": "x to grow downstream"}
    cause = "the opposite carriageway, a reference line turned round, or the wrong site"
    whole = rows.breach("upstream", found.astype(bool), values, len(starts), MANY, **words, cause=cause)
    return whole if whole is None or whole.spoils else _lane_upstream(rows, starts, found.astype(bool), values) or whole


def _lane_upstream(
    rows: TrackRows, starts: Int[np.ndarray, "track"], found: Bool[np.ndarray, "row"], values: Row
) -> Breach | None:
    """Returns the vehicles of a lane that most of its vehicles drive upstream, where they are few of all."""
    lane = rows.tracks[c.LANE].to_numpy()
    for number in np.unique(lane[starts]):
        here = np.zeros(len(lane), bool)
        here[starts] = lane[starts] == number
        count, wrong = int(here.sum()), int((found & here).sum())
        if count >= FEWEST and wrong > count / 2:
            words = {"what": f"vehicles of lane {number} that drive upstream [m]", "expected": "x to grow downstream"}
            cause = "a lane of the opposite carriageway among the site's"
            return rows.breach("upstream", found & here, values, count, HALF, **words, cause=cause)
    return None


def _lengths(rows: TrackRows) -> Breach | None:
    length = rows.tracks[c.LENGTH].to_numpy().astype(float)
    found = (length < LENGTHS[0]) | (length > LENGTHS[1])
    words = {"what": "lengths that no vehicle has [m]", "expected": f"{LENGTHS[0]:g} to {LENGTHS[1]:g} m"}
    cause = "another unit of lengths than of positions"
    single = rows.breach("impossible_lengths", found, length, len(found), MANY, **words, cause=cause)
    if single is not None and single.spoils:
        return single
    cars = rows.tracks.filter((pl.col(c.KIND) == "car") & (pl.col(c.LENGTH) > 0))[c.LENGTH]
    median = float(np.median(cars.to_numpy())) if cars.len() >= FEW else CAR_LENGTHS[0]
    if CAR_LENGTHS[0] <= median <= CAR_LENGTHS[1]:
        return single
    cause = "lengths in feet" if median > CAR_LENGTHS[1] else "lengths and widths exchanged, or a wrong unit of lengths"
    return Breach(
        "car_lengths", "the median length of cars [m]", "", None, None, median,
        f"{CAR_LENGTHS[0]:g} to {CAR_LENGTHS[1]:g} m", cars.len(), cars.len(), cause, HALF,
    )  # fmt: skip


def _widths(rows: TrackRows) -> Breach | None:
    """Returns vehicles that are wider than they are long."""
    length, width = (rows.tracks[name].to_numpy().astype(float) for name in (c.LENGTH, c.WIDTH))
    words = {"what": "vehicles that are wider than long [m]", "expected": "lengths above widths"}
    cause = "lengths and widths exchanged"
    return rows.breach("wider_than_long", width > length, width, len(width), MANY, **words, cause=cause)


def _lanes(rows: TrackRows) -> Breach | None:
    """Returns a site's lanes that lie too close to each other, or too far apart."""
    mains = [lane.centre for lane in rows.recording.site.lanes if lane.role == "main"]
    centres = np.unique(mains)
    steps = np.diff(centres) if len(centres) > 1 or len(mains) < 2 else np.zeros(1)
    wrong = steps[(steps < LANE_SPACING[0]) | (steps > LANE_SPACING[1])]
    if len(wrong) <= len(steps) / 2:
        return None
    return Breach(
        "lane_spacing", "the distance from lane to lane [m]", "", None, None, float(np.median(wrong)),
        f"{LANE_SPACING[0]:g} to {LANE_SPACING[1]:g} m", len(wrong), len(steps),
        "a site or lateral positions in feet or centimetres, or two roads taken for one", HALF,
    )  # fmt: skip


def _beside_lanes(rows: TrackRows) -> Breach | None:
    """Returns rows that lie far from the middle of the lane that they are in, if most do."""
    centres = {lane.number: lane.centre for lane in rows.recording.site.lanes if lane.role == "main"}
    centre = rows.tracks[c.LANE].replace_strict(centres, default=None, return_dtype=pl.Float64)
    off = (rows.tracks[c.Y] - centre).abs().drop_nulls().to_numpy()
    middle = float(np.median(off)) if len(off) >= FEW else 0.0
    if not middle > BESIDE_LANE:
        return None
    return Breach(
        "beside_lanes", "how far vehicles are from the middle of their lane [m]", "", None, None, middle,
        f"{BESIDE_LANE:g} m at most of half of the rows", int((off > BESIDE_LANE).sum()), len(off),
        "positions in another unit than the site's, another zero of y, or the wrong site", HALF,
    )  # fmt: skip


def _one_place(rows: TrackRows) -> Breach | None:
    """Returns vehicles that are where another one is, in the same lane at the same moment."""
    places = rows.tracks.select(c.RECORDING, c.FRAME, c.LANE, c.X, c.Y, row=pl.int_range(pl.len()))
    places = places.sort(c.RECORDING, c.FRAME, c.LANE, c.X)
    alike = pl.all_horizontal(pl.col(name) == pl.col(name).shift() for name in (c.RECORDING, c.FRAME, c.LANE))
    near = (pl.col(name).diff().abs() < SAME_PLACE for name in (c.X, c.Y))
    found = places.filter(pl.all_horizontal(alike, *near))["row"].to_numpy()
    is_found = np.zeros(len(rows.x), bool)
    is_found[found] = True
    words = {"what": "vehicles in the place of another [m]", "expected": f"{SAME_PLACE} m between them at least"}
    cause = "a column of positions that is constant, files of two places or the same vehicles twice"
    return rows.breach("one_place", is_found, rows.x, len(rows.x), MANY, **words, cause=cause)


def _crowds(rows: TrackRows) -> Breach | None:
    """Returns moments with more vehicles than fit on the road: a forecast of half a million would take for ever."""
    most = most_at_once(rows.recording.site)
    counts = rows.tracks.group_by(c.RECORDING, c.FRAME).len().sort("len", c.FRAME, descending=True)
    crowded = counts.filter(pl.col("len") > most)
    if crowded.is_empty():
        return None
    window, frame, count = crowded.row(0)
    return Breach(
        "crowds", "moments with more vehicles than fit on the road", str(window), None, frame, float(count),
        f"{most:,} at most", crowded.height, counts.height, "times that are all alike, or files of many places", 0.0,
    )  # fmt: skip


CHECKS: tuple[Check, ...] = (
    _no_numbers, _time_step, _holes, _places, _lateral, _speeds, _jumps, _accelerations, _smoothed_speeds,
    _recorded_speeds, _directions, _lengths, _widths, _lanes, _beside_lanes, _one_place, _crowds,
)  # fmt: skip
