"""Which recorded window a row belongs to, told by the clock that it was recorded with.

In every file of the originals Global_Time = start + 100 ms * Frame_ID, with one start a window: the window's clock. The
nominal bounds do not tell windows apart: the cameras ran longer (the I-80 window of 16:00 holds rows from 15:58:55 to
16:15:32, that of 17:15 begins at 17:12:45), so windows overlap in time, and their vehicle ids repeat. The clock tells
them apart, keeps every track whole, and never joins two vehicles of one id. (First and last Frame_ID and Global_Time of
the three I-80 windows, as users of the data have published them.)

Where one clock runs through several windows, as in files whose frames were numbered anew, a track (rows of one vehicle
with no hole of more than 5 s) belongs to the window in which its middle lies.
"""

from collections.abc import Iterable, Mapping

import polars as pl

from rampcast.errors import FormatError
from rampcast.recording import columns as c
from rampcast.sites import Site, load_site, site_names

FRAME_MS = 100  # [ms] NGSIM is recorded at 10 Hz
CLOCK = "clock"  # Global_Time of frame 0 [ms since 1970]
MAIN_SHARE = 0.01  # a clock that fewer rows share is a slip of one of the others
MOST_SLIPS = 0.01  # share of rows; more is a file whose frames or times were changed
EARLIEST, LATEST = -180_000, 60_000  # [ms] from the nominal start to a window's clock; the originals: -135 s to -21 s
SAME_DAY = 12 * 60 * 60 * 1000  # [ms] a time this near to a site's windows is of that site's day of recording
LONGEST_HOLE = 50  # frames; as in smoothing
OUTSIDE, SEVERAL = "", "*"  # names for the rows of no window, and of a clock that runs through several

Bounds = Mapping[str, tuple[int, int]]


def split_windows(rows: pl.DataFrame, clocks: pl.DataFrame, bounds: Bounds) -> dict[str, pl.DataFrame]:
    """Returns the rows of each window by its name, and those of no window as ""."""
    windows = window_of_clocks(clocks, bounds)
    if len(set(windows.values())) == 1 and SEVERAL not in windows.values():
        return dict.fromkeys(windows.values(), rows)
    parts: dict[str, list[pl.DataFrame]] = {}
    for window in set(windows.values()):
        own = rows.filter(pl.col(CLOCK).is_in([clock for clock, name in windows.items() if name == window]))
        for name, part in (_by_track(own, bounds) if window == SEVERAL else {window: own}).items():
            parts.setdefault(name, []).append(part)
    return {name: pl.concat(own) for name, own in parts.items()}


def window_of_clocks(clocks: pl.DataFrame, bounds: Bounds) -> dict[int, str]:
    """Returns the window of each clock.

    It is the one that the clock begins with, else the one that its rows overlap the longest.

    Args:
        clocks: one row per clock: clock, rows, first, last (the first and last Global_Time) [ms].
        bounds: start and end of each window [ms].
    """
    main = clocks.filter(pl.col("rows") >= MAIN_SHARE * int(clocks["rows"].sum())).sort(CLOCK)
    main = main if main.height else clocks
    windows = {row[CLOCK]: _window(row, bounds) for row in main.iter_rows(named=True)}
    known = list(windows)
    for clock in clocks[CLOCK].to_list():
        if clock not in windows:
            windows[clock] = windows[min(known, key=lambda other: abs(other - clock))]
    return windows


def clocks_of(rows: pl.DataFrame) -> pl.DataFrame:
    """Returns one row per clock: clock, rows, first, last [ms]."""
    spans = rows.group_by(CLOCK).agg(rows=pl.len(), first=pl.col(c.FRAME).min(), last=pl.col(c.FRAME).max())
    times = ((pl.col(CLOCK) + FRAME_MS * pl.col(name).cast(pl.Int64)).alias(name) for name in ("first", "last"))
    return spans.with_columns(times)


def check_site(file: str, clocks: pl.DataFrame, site: Site) -> None:
    """Raises a FormatError if the rows were recorded on the day of another shipped site and not on this one's."""
    if any(_same_day(row, site) for row in clocks.iter_rows(named=True)):
        return
    for name in site_names():
        other = load_site(name)
        if other.name != site.name and not other.simulated and other.windows != site.windows:
            hit = next((row for row in clocks.iter_rows(named=True) if _same_day(row, other)), None)
            if hit:
                raise FormatError(
                    f"{file}: Global_Time {hit['first']} is of the day on which site {other.name} was recorded, and "
                    f"the site asked for is {site.name}; read it with --site {other.name}"
                )


def sites_of_times(times: Iterable[int]) -> list[str]:
    """Returns the shipped sites on whose day of recording one of the times [ms] lies."""
    sites = [load_site(name) for name in site_names()]
    rows = [{"first": time, "last": time} for time in times]
    return [site.name for site in sites if any(_same_day(row, site) for row in rows)]


def _window(row: Mapping[str, int], bounds: Bounds) -> str:
    overlaps = {name: min(row["last"], end) - max(row["first"], start) for name, (start, end) in bounds.items()}
    if sum(overlap > -EARLIEST for overlap in overlaps.values()) > 1:
        return SEVERAL
    begins = [name for name, (start, _) in bounds.items() if EARLIEST <= row[CLOCK] - start <= LATEST]
    if begins and row["last"] >= bounds[begins[0]][0] + EARLIEST:
        return begins[0]
    best = max(overlaps, key=lambda name: overlaps[name], default=OUTSIDE)
    return best if best and overlaps[best] >= 0 else OUTSIDE


def _by_track(rows: pl.DataFrame, bounds: Bounds) -> dict[str, pl.DataFrame]:
    """Returns the rows of each window; a track belongs to the window in which its middle lies, or nearest to it."""
    rows = rows.sort(CLOCK, c.VEHICLE, c.FRAME)
    same = (pl.col(name) == pl.col(name).shift(1) for name in (CLOCK, c.VEHICLE))
    goes_on = pl.all_horizontal(*same, pl.col(c.FRAME).diff() <= LONGEST_HOLE).fill_null(False)
    rows = rows.with_columns(track=(~goes_on).cum_sum())
    frame = (pl.col(c.FRAME).min() + pl.col(c.FRAME).max()).over("track").cast(pl.Int64) // 2
    middle = pl.col(CLOCK) + FRAME_MS * frame
    away = {name: pl.max_horizontal(start - middle, middle - end, 0) for name, (start, end) in bounds.items()}
    nearest = pl.min_horizontal(*away.values())
    name_of_nearest = pl.coalesce(pl.when(gap == nearest).then(pl.lit(name)) for name, gap in away.items())
    window = pl.when(nearest <= -EARLIEST).then(name_of_nearest).otherwise(pl.lit(OUTSIDE))
    parts = rows.with_columns(window=window).drop("track").partition_by("window", as_dict=True, include_key=False)
    return {str(key[0]): part for key, part in parts.items()}


def _same_day(row: Mapping[str, int], site: Site) -> bool:
    bounds = site.window_bounds().values()
    return any(row["last"] >= start - SAME_DAY and row["first"] <= end + SAME_DAY for start, end in bounds)
