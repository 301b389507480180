"""Times that are written out, as 2026-11-28T13:05:02.1+01:00, as seconds."""

from typing import Final

import polars as pl

DAY: Final = 86400.0  # [s]
BY_MIDNIGHT: Final = 60.0  # [s] before and after it in which a recording that goes on over it has rows
WRITTEN: Final = ("iso", "clock")
ISO: Final = r"^(\d{4}-\d{2}-\d{2})[T ](\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?)\s*(Z|UTC|GMT|[+-]\d{2}(?::?\d{2})?)?$"
CLOCK: Final = r"^(\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?)$"
# 130502.1, and 130502100 with thousandths; programs that take it for a number leave out a zero before it.
DIGITS: Final = r"^0?(\d{1,2})(\d{2})(\d{2}(?:[.,]\d+)?)$"
THOUSANDTHS: Final = r"^0?(\d{1,2})(\d{2})(\d{2})(\d{3})$"


def seconds_written(texts: pl.Series, written: str, timezone: str = "UTC") -> pl.Series:
    """Returns times [s since 1970, UTC; of a clock since midnight]; null where one is not written so.

    A time of a zone whose clocks are set back comes twice, and one that they leap over never: it is null too. Times of
    a clock that goes on over midnight go on over 24 h.

    Args:
        texts: as they stand in the file.
        written: "iso" (date, time and maybe zone), "clock" (13:05:02.1, 130502.1 or 130502100), or a format as
            28/11/26 is %d/%m/%y.
        timezone: of times that name none.
    """
    text = pl.col(texts.name).cast(pl.String).str.strip_chars(' "')
    if written == "iso":
        date, clock, zone = (text.str.extract(ISO, group) for group in (1, 2, 3))
        moment = _naive(pl.concat_str(date, pl.lit("T"), _full(clock)), "%Y-%m-%dT%H:%M:%S%.f")
        seconds = _utc(moment, zone, timezone)
    elif written == "clock":
        clock = pl.coalesce(text.str.extract(CLOCK, 1), _with_colons(text))
        moment = _naive(pl.lit("1970-01-01T") + _full(clock), "%Y-%m-%dT%H:%M:%S%.f")
        return _over_midnight(texts.to_frame().select(_seconds(moment)).to_series())
    else:
        moment = text.str.to_datetime(written, time_unit="us", strict=False)
        seconds = _seconds(moment) if "%z" in written else _utc(moment, pl.lit(None, pl.String), timezone)
    return texts.to_frame().select(seconds).to_series()


def _with_colons(text: pl.Expr) -> pl.Expr:
    """Returns times of a clock that are written in digits alone as others are; null what is none."""
    parts = [text.str.extract(THOUSANDTHS, group) for group in (1, 2, 3, 4)]
    whole = pl.concat_str(*parts[:2], pl.concat_str(*parts[2:], separator="."), separator=":")
    return pl.coalesce(whole, pl.concat_str(*(text.str.extract(DIGITS, group) for group in (1, 2, 3)), separator=":"))


def _over_midnight(seconds: pl.Series) -> pl.Series:
    """Returns times of a clock [s] with those after midnight a day later, where the recording goes on over midnight."""
    moments = seconds.drop_nulls().unique().sort()
    if len(moments) < 2 or moments[0] > BY_MIDNIGHT or moments[-1] < DAY - BY_MIDNIGHT:
        return seconds
    hole = int(moments.diff().arg_max() or 0)
    if moments[hole] - moments[hole - 1] < DAY / 2:
        return seconds
    return seconds + DAY * (seconds < moments[hole]).cast(pl.Float64)


def _full(clock: pl.Expr) -> pl.Expr:
    """Returns a time of day with seconds, and a point before their parts."""
    clock = clock.str.replace(",", ".", literal=True)
    return pl.when(clock.str.count_matches(":") == 1).then(clock + ":00").otherwise(clock)


def _naive(text: pl.Expr, written: str) -> pl.Expr:
    return text.str.to_datetime(written, time_unit="us", strict=False)


def _seconds(moment: pl.Expr) -> pl.Expr:
    return moment.dt.epoch("us").cast(pl.Float64) / 1e6


def _utc(moment: pl.Expr, zone: pl.Expr, timezone: str) -> pl.Expr:
    """Returns the seconds of a time that is ahead of UTC as its zone says, or of the time zone if it has none."""
    hours, minutes = zone.str.extract(r"^[+-](\d{2})", 1), zone.str.extract(r"^[+-]\d{2}:?(\d{2})$", 1)
    ahead = hours.cast(pl.Float64).fill_null(0.0) * 3600 + minutes.cast(pl.Float64).fill_null(0.0) * 60
    sign = pl.when(zone.str.starts_with("-")).then(-1.0).otherwise(1.0)
    local = moment.dt.replace_time_zone(timezone, ambiguous="null", non_existent="null")
    return pl.when(zone.is_null()).then(_seconds(local)).otherwise(_seconds(moment) - sign * ahead)
