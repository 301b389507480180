"""The clock of a table: what its times are, by how they are written, how large they are, and how far apart."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import polars as pl

from rampcast.formats.readers.plain.mapping import TIMES
from rampcast.formats.steps.written_times import WRITTEN, seconds_written
from rampcast.start.asking import Answers, Ask, Proposal, Question, StartError, answer_to
from rampcast.start.names import unit_in

FORMATS: Final = (
    "iso", "clock", "%d.%m.%Y %H:%M:%S%.f", "%Y/%m/%d %H:%M:%S%.f", "%m/%d/%Y %H:%M:%S%.f", "%d/%m/%Y %H:%M:%S%.f",
)  # fmt: skip
SECONDS: Final = "seconds"  # name of the column of our own
SHORTEST, LONGEST = 0.009, 1.05  # [s] between two rows of a vehicle
LATEST: Final = 1e10  # [s since 1970] the year 2286
SCALES: Final = (("ms", 1000), ("s", 1))  # units of times that a clock's digits look like, and how many are a second
EPOCHS: Final = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))  # how large a time since 1970 is, at least


def clock_of(table: pl.DataFrame, columns: dict[str, str], answers: Answers, ask: Ask, proposal: Proposal) -> None:
    """Proposes what tells the time; the table's seconds are `seconds_of` afterwards."""
    if "time" in columns:
        name = columns["time"]
        unit = answers.units.get("time") or _written(table[name]) or _unit(table, name, columns)
        _check_size(table[name], name, unit)
        if unit:
            value = name if unit == "s" else {"column": name, "unit": unit}
            proposal.say("time", value, f"'{name}' in {unit}, by {_why(unit, name)}")
            columns.pop("frame", None)
            return
        if "frame" not in columns and not table[name].dtype.is_numeric():
            first = str(table[name].drop_nulls().cast(pl.String).first())
            text = f"How is the time written? '{name}' holds '{first}'."
            raise StartError(f"{text} Answer with --unit time=FORMAT, as --unit 'time=%d.%m.%Y %H:%M:%S%.f'")
        columns.setdefault("frame", name)
        columns.pop("time")
    question = Question(
        f"How many frames are a second? '{columns['frame']}' counts frames, and nothing tells.", "--frame-rate NUMBER"
    )
    rate = answers.frame_rate or _number(answer_to(question, ask), "--frame-rate")
    proposal.values["frame_rate"] = rate
    proposal.say("frame", columns["frame"], f"'{columns['frame']}', {rate:g} a second")


def _check_size(times: pl.Series, name: str, unit: str) -> None:
    """Raises where times that are numbers are no seconds of this age, as 20260701120000 is."""
    largest = times.cast(pl.Float64, strict=False).abs().to_numpy().max(initial=0.0)
    if unit in TIMES and largest * TIMES[unit] > LATEST:
        raise StartError(
            f"How is the time written? '{name}' holds '{times[0]}', which is no number of seconds. Answer with "
            "--column time=NAME for another column, or --unit time=FORMAT, as --unit time=%Y%m%d%H%M%S"
        )


def _number(text: str, option: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise StartError(f"{option}: expected a number, got {text}") from None


def seconds_of(table: pl.DataFrame, columns: Mapping[str, str], values: Mapping[str, object]) -> pl.Series:
    """Returns the times of a table [s], by what was proposed."""
    entry = dict(values["columns"])  # type: ignore[call-overload]
    if "time" not in columns:
        return table[columns["frame"]] / float(values["frame_rate"])  # type: ignore[arg-type]
    unit = entry["time"]["unit"] if isinstance(entry["time"], dict) else "s"
    if unit in WRITTEN or "%" in unit:
        return seconds_written(_as_it_stands(table[columns["time"]]), unit)
    return table[columns["time"]].cast(pl.Float64) * TIMES[unit]


def _as_it_stands(times: pl.Series) -> pl.Series:
    """Returns times that were taken for numbers as they stand in the file: whole ones without a point."""
    is_whole = times.dtype.is_float() and bool((times.drop_nulls() == times.drop_nulls().round()).all())
    return times.cast(pl.Int64) if is_whole else times


def _written(times: pl.Series) -> str:
    """Returns how times are written; "" where they are numbers, or in no way that is known."""
    if times.dtype.is_numeric():
        return ""
    some = times.drop_nulls().gather_every(max(len(times) // 2000, 1))
    return next((one for one in FORMATS if len(some) and seconds_written(some, one).null_count() == 0), "")


def _unit(table: pl.DataFrame, name: str, columns: Mapping[str, str]) -> str:
    """Returns the unit of times that are numbers, by their name, their size and their steps; "" where nothing tells."""
    times = table[name]
    if not times.dtype.is_numeric():
        return ""
    largest, step = float(times.max() or 0.0), _step(table, name, columns)  # type: ignore[arg-type]
    if unit_in(name) in TIMES and _is_step(step, unit_in(name)):
        return unit_in(name)
    if any(_is_step(step, unit) and _is_clock(times, scale) for unit, scale in SCALES):
        return "clock"
    for unit, least in EPOCHS:
        if largest >= least and _is_step(step, unit):
            return unit
    if 30_000 <= largest <= 80_000 and _is_step(step, "day"):
        return "day"
    whole = bool((times.drop_nulls() == times.drop_nulls().round()).all())
    fitting = [unit for unit in ("s", "ms", "us", "ns") if _is_step(step, unit)]
    if whole and 0.5 < step < 1.5:  # 0, 1, 2 ...: seconds, or frames
        return ""
    return fitting[0] if fitting else ""


def _is_clock(times: pl.Series, scale: int) -> bool:
    """Returns whether numbers are hours, minutes and seconds in digits: none has 60 seconds or minutes or more.

    Args:
        times: that go on for more than a minute; else nothing tells.
        scale: how many of their units are a second.
    """
    digits = (times.drop_nulls().cast(pl.Float64) / scale).floor().cast(pl.Int64)
    minutes, seconds = digits // 100 % 100, digits % 100
    is_one = digits.is_between(10_000, 235_959) & (minutes < 60) & (seconds < 60)
    return bool(is_one.all()) and minutes.n_unique() > 1


def _is_step(step: float, unit: str) -> bool:
    return SHORTEST <= step * TIMES[unit] <= LONGEST


def _step(table: pl.DataFrame, name: str, columns: Mapping[str, str]) -> float:
    """Returns the usual time from a row of a vehicle to its next, in the column's unit."""
    if "vehicle" in columns and columns["vehicle"] in table.columns:
        rows = table.select(v=pl.col(columns["vehicle"]).cast(pl.String), t=pl.col(name)).drop_nulls().sort("v", "t")
        steps = rows.select((pl.col("t").shift(-1) - pl.col("t")).over("v")).to_series().drop_nulls().to_numpy()
    else:
        steps = np.diff(np.unique(table[name].drop_nulls().to_numpy()))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 0.0


def _why(unit: str, name: str) -> str:
    if unit in WRITTEN or "%" in unit:
        return "how it is written"
    return "its name" if unit_in(name) == unit else "how far apart rows of a vehicle are"
