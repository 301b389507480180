"""What is done with a recording or a part of one: checked by the doctor, converted, forecast, scored."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final

import polars as pl

from rampcast.batch.plan import Plan
from rampcast.batch.reading import found
from rampcast.batch.task import Part, Record, whole
from rampcast.doctor import Diagnosis, RoadDiagnosis, doctor
from rampcast.errors import RecordingError
from rampcast.evaluate.positions import beside_truth, errors_by
from rampcast.forecast.forecaster import Forecaster
from rampcast.forecast.parts import write_forecasts
from rampcast.forecast.protocol import Parts, RecordingForecaster
from rampcast.forecast.storage import load
from rampcast.formats import read_all
from rampcast.horizon import EDGE, FUTURE, STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.cutting import BESIDE, cut_tracks
from rampcast.recording.extents import read_span, within
from rampcast.recording.invariants import check_believable
from rampcast.recording.recording import KEY, read_description, seconds_of, write_recording
from rampcast.recording.smoothing import LONGEST_FILLED_GAP, SHORTEST_TRACK
from rampcast.traffic.moments import SPAN, times_between

NO_DAY: Final = "unknown"
LIKELY: Final = 0.5  # probability from which a conflict is counted as one to come
WHOLE: Final = "--window 0 (in a plan: window = 0)"


@dataclass(frozen=True)
class Piece:
    """What is worked on.

    Attributes:
        name: in words.
        recording: its rows.
        around: these, and those before and after that its forecasts and their truth need.
        began: when it began [s since 1970, UTC]; None where that is not known.
        forecasts: gives those of a model.
    """

    name: str
    recording: Recording
    around: Recording
    began: float | None
    forecasts: Callable[[RecordingForecaster], Parts]


def do_whole(file: Path, plan: Plan) -> Record:
    """Returns what became of a file that is one task, road by road."""
    recordings, report = read_all(
        [file],
        site=plan.site,
        format=plan.format,
        mapping=plan.mapping,
        bad_rows="skip" if plan.skip_bad_rows else "raise",
    )
    roads: list[RoadDiagnosis | None] = [None] * len(recordings)
    findings = []
    if "doctor" in plan.do:
        diagnosis = doctor(recordings, report)
        _write_doctor(diagnosis, plan.out / "doctor" / f"{file.stem}.json")
        roads, findings = list(diagnosis.roads), [found(one) for one in diagnosis.in_files]
    facts = []
    for one, about in zip(recordings, roads, strict=True):
        accepted = replace(one, is_accepted=plan.accept_doubtful)
        began = min(one.began.values(), default=None)
        forecasts = partial(_in_parts, accepted, plan.every)
        piece = Piece(str(file), accepted, accepted, began, forecasts)
        span = {"begin": 0.0, "end": sum(seconds_of(one).values())}
        facts.append(_done(plan, piece, Path(f"file={file.stem}"), about) | span)
    return {"roads": facts, "sources": [], "found": findings}


def _in_parts(recording: Recording, every: float, model: RecordingForecaster) -> Parts:
    return model.in_parts(recording, every=every)


def do_part(file: Path, plan: Plan, part: Part) -> Record:
    """Returns what became of a part of a file."""
    around = replace(_around(part), is_accepted=plan.accept_doubtful)
    core = within(around, part.begin, part.end)
    about = None
    if "doctor" in plan.do and core.tracks.height:
        diagnosis = doctor(core)
        _write_doctor(diagnosis, plan.out / "doctor" / file.stem / f"{part.number:04}.json")
        about = diagnosis.roads[0]
    began = core.began.get(part.window)
    times = times_between(part.first, part.last, every=plan.every)
    times = times[(times >= part.begin - EDGE) & (times < part.end - EDGE)]

    def forecasts(model: RecordingForecaster) -> Parts:
        if not isinstance(model, Forecaster):
            raise RecordingError(
                f"the model {plan.model} forecasts recordings as a whole: give {WHOLE}, which makes each file a task"
            )
        return model.at_times(around, {part.window: times} if around.tracks.height else {})

    name = f"{file}, {part.window} from {part.begin:g} to {part.end:g} s"
    piece = Piece(name, core, around, None if began is None else began + part.begin, forecasts)
    place = Path(f"file={file.stem}") / f"part={part.number:04}"
    return {"roads": [_done(plan, piece, place, about)], "sources": [], "found": []}


def _around(part: Part) -> Recording:
    """Returns the rows of a part, of the 4 s before that a forecast looks back, and of the 15 s after that it is about.

    Raises:
        RecordingError: a vehicle jumps there, which is cut only where all of its track is known.
    """
    step = read_description(part.source).time_step
    begin, end = part.begin - SPAN, part.end + FUTURE * STEP + step
    beside = LONGEST_FILLED_GAP + BESIDE + SHORTEST_TRACK * step  # what tells a jump from a slip
    wide = read_span(part.source, part.window, begin - beside, end + beside)
    cut, count = cut_tracks(wide)
    if count:
        new = cut.tracks.join(wide.tracks, on=list(KEY), how="anti")
        at = new.group_by(c.VEHICLE).agg(pl.col(c.FRAME).min() * step)[c.FRAME]
        if at.is_between(begin, end).any():
            raise RecordingError(
                f"{part.source}: vehicles of '{part.window}' jump between {begin:g} and {end:g} s, and a jump is cut "
                f"only in a whole recording; write it again with `rampcast convert`, which cuts them, or give {WHOLE}"
            )
    return within(wide, begin, end)


def _write_doctor(diagnosis: Diagnosis, path: Path) -> None:
    with whole(path) as new:
        new.write_text(json.dumps(diagnosis.to_dict(), indent=1), encoding="utf-8")


def _done(plan: Plan, piece: Piece, below: Path, about: RoadDiagnosis | None) -> dict[str, Any]:
    """Writes what the plan asks of a piece, and returns what a summary says of it."""
    recording, day = piece.recording, _day(piece.began)
    place = Path(f"site={recording.site.name}") / f"day={day}" / below
    facts: dict[str, Any] = {
        "site": recording.site.name,
        "simulated": recording.site.simulated,
        "day": day,
        "vehicles": recording.tracks.select(c.RECORDING, c.VEHICLE).n_unique(),
        "rows": recording.tracks.height,
        "spoils": None if about is None else about.spoils,
        "findings": None if about is None else len(about.findings),
        "found": [] if about is None else [found(one) for one in about.findings],
    }
    files: list[Path] = []
    if "convert" in plan.do and recording.tracks.height:
        check_believable(recording, doing=f"conversion of {piece.name}")
        files.append(Path("recordings") / place / "recording.parquet")
        (plan.out / files[-1]).parent.mkdir(parents=True, exist_ok=True)
        write_recording(recording, plan.out / files[-1])
    if {"forecast", "evaluate"} & {*plan.do}:
        files += _forecast(plan, piece, place)
    return facts | {"files": [one.as_posix() for one in files]}


def _forecast(plan: Plan, piece: Piece, place: Path) -> list[Path]:
    """Returns the files, from the plan's folder on, of the forecasts of a piece, their conflicts and their scores."""
    folder = Path("forecasts") / place
    parts = piece.forecasts(load(plan.model))
    written = write_forecasts(parts.each, plan.out / folder, suffixes=(".parquet",))
    files = [path.relative_to(plan.out) for path in written]
    tables = {path.stem for path in files}
    if "conflicts" in tables:
        files.append(Path("conflicts") / place / "conflicts.parquet")
        with whole(plan.out / files[-1]) as path:
            conflict_counts(pl.scan_parquet(plan.out / folder / "conflicts.parquet")).write_parquet(path)
    if "evaluate" in plan.do and "forecast" in tables:
        files.append(Path("scores") / place / "scores.parquet")
        with whole(plan.out / files[-1]) as path:
            beside = beside_truth(pl.scan_parquet(plan.out / folder / "forecast.parquet"), piece.around)
            errors_by(beside, ["model", "horizon"]).write_parquet(path)
    return files


def conflict_counts(conflicts: pl.LazyFrame) -> pl.DataFrame:
    """Returns, by measure and time ahead t [s], the forecasts n, conflicts expected, and forecasts of a likely one."""
    p = pl.col("probability").cast(pl.Float64)
    counts = {"n": pl.len(), "expected": p.sum(), "likely": (p >= LIKELY).sum()}
    return conflicts.group_by("measure", "t").agg(**counts).sort("measure", "t").collect()


def _day(began: float | None) -> str:
    """Returns the day of a moment [s since 1970] in UTC."""
    return NO_DAY if began is None else datetime.fromtimestamp(began, tz=UTC).date().isoformat()
