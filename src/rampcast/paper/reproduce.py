"""The paper's whole protocol: train on windows 1 and 3, test on window 2, in both modes, and report.

Every finished part is kept under the output folder with a fingerprint of what went into it; a second run takes up where
the first was interrupted, and a part whose inputs have changed is made again.
"""

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import polars as pl

from rampcast import __version__
from rampcast.arguments import chosen
from rampcast.errors import ModelError, OutputError, RecordingError
from rampcast.files import check_outputs, sha256_of, write_outputs, write_whole
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.forecaster import Forecaster, ForecasterSpec, fit
from rampcast.forecast.protocol import Progress, RecordingForecaster, tell_nobody
from rampcast.forecast.storage import save
from rampcast.forecast.tags import TAGS as OUR_TAGS
from rampcast.formats import BadRows, read_any, why_not
from rampcast.models.correction import CorrectionSpec
from rampcast.models.folder import load_model, save_model, versions
from rampcast.models.plain_data import Tags
from rampcast.paper.framework import (
    PaperForecaster,
    PaperSpec,
    assemble,
    fit_lane_changes,
    fit_neighbours,
    for_each_lane,
)
from rampcast.paper.lane_change.forests import LaneChangeForests
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm
from rampcast.paper.protocol import Evaluation, evaluate, run_counts
from rampcast.paper.report.report import PAGE, fill_report
from rampcast.paper.shared_time import without_shared_time
from rampcast.paper.tags import TAGS
from rampcast.recording import Recording, clean, concatenate, read_recording, write_recording
from rampcast.recording.hashes import recording_hash
from rampcast.sites import Site, site_of
from rampcast.sites.site import site_to_dict

TRAINING_WINDOWS, TEST_WINDOW = ("1", "3"), "2"  # the paper, section "Data Set"
SUFFIXES = (".txt", ".csv", ".gz", ".zip", ".parquet")
FINGERPRINTS, UNFINISHED = "fingerprints", "unfinished"
OURS = Path("models/rampcast")  # in the folder of a run: the forecaster of our own
RUN, READING, CLEANING = "run.json", "reading.json", "cleaning.json"

T = TypeVar("T")


@dataclass(frozen=True)
class Protocol:
    """How the protocol is run.

    Attributes:
        ours: how rampcast's own forecaster is trained.
        paper: how the paper's framework is trained, in each mode.
        every: corrected mode: time between the anchors that are scored [s].
        modes: the readings of the paper, side by side in the report.
        command: what the user called, for the run record.
    """

    ours: ForecasterSpec
    paper: PaperSpec
    every: float = 1.0
    modes: tuple[Mode, ...] = tuple(Mode)
    command: str = "rampcast.paper.reproduce.reproduce"

    @property
    def record(self) -> dict[str, Any]:
        """Returns what the run record says of it."""
        training = {"rampcast": asdict(self.ours), "paper": asdict(self.paper)}
        return {"command": self.command, "seed": self.paper.seed, "training": training, "every": self.every}


DEMO = Protocol(
    ours=ForecasterSpec(spacing=5.0, model=CalibratedSpec(samples=50, folds=3, correction=CorrectionSpec(trees=60))),
    paper=PaperSpec(lstm=LstmSpec(epochs=8, batch=64, decay=0.7), window_stride=15),
    every=5.0,
)


def reproduce(
    files: Sequence[Path],
    out: Path,
    *,
    protocol: Protocol,
    site: Site | str | Path | None = None,
    bad_rows: BadRows | str = BadRows.RAISE,
    progress: Progress | None = None,
) -> Path:
    """Runs the protocol and writes models, tables, figures and report.html to a folder; returns the report's path.

    Args:
        files: the three windows of one site, in any form that rampcast reads; other sites' rows are left out.
        out: the folder; what an earlier run finished there is taken over.
        protocol: how to train and score.
        site: the geometry, its name or its file; None tells it by the files' content.
        bad_rows: whether a malformed row is an error or is skipped and counted.
        progress: called as (what, done, total).

    Raises:
        RecordingError: a window is missing.
        OutputError: a file of the user's would be lost.
    """
    out, tell, started = Path(out), progress or tell_nobody, time.perf_counter()
    check_outputs(out, (PAGE, RUN, READING, CLEANING))
    site = None if site is None else site_of(site)
    recording = _smoothed(files, out, site, chosen(BadRows, bad_rows, name="bad_rows"), tell)
    training = concatenate([_window(recording, name) for name in TRAINING_WINDOWS])
    test = _window(recording, TEST_WINDOW)
    alone = without_shared_time(training, test)  # erratum 8
    parts = {Mode.PAPER: training, Mode.CORRECTED: alone}
    results = [_scored(parts[mode], test, out / "models", mode, protocol, tell) for mode in protocol.modes]
    tables, counts = _side_by_side(results, test)
    counts["training_rows_of_minutes_of_the_test"] = training.tracks.height - alone.tracks.height
    trained = (training.names, recording_hash(training))
    run = _run_record(trained, test, counts, how=protocol.record, seconds=time.perf_counter() - started)
    tell("report", 0, 1)
    page = _written(tables, run, recording.site, out)
    tell("report", 1, 1)
    return page


class Found(NamedTuple):
    """The recordings in a folder, and why each other file of such a name is none."""

    files: list[Path]
    left_out: dict[Path, str]


def find_files(folder: Path, *, without: Path | None = None) -> Found:
    """Returns the files in a folder, and below it, that are recordings by their beginning, and those that are not.

    Args:
        folder: where to look.
        without: a folder below it that is not looked into, such as that of the results.

    Raises:
        RecordingError: the folder is not there or holds none.
    """
    if not Path(folder).is_dir():
        raise RecordingError(f"{folder}: there is no such folder; give the folder that holds the NGSIM files")
    below = (path for path in Path(folder).rglob("*") if path.is_file() and path.suffix.lower() in SUFFIXES)
    own = without.resolve() if without else None
    named = sorted(path for path in below if own is None or own not in path.resolve().parents)
    reasons = {path: why_not(path) for path in named}
    files = [path for path, reason in reasons.items() if reason is None]
    left_out = {path: reason for path, reason in reasons.items() if reason is not None}
    if not files:
        told = "".join(f"\n  {reason}" for reason in left_out.values())
        raise RecordingError(
            f"{folder}: no recording ends in {', '.join(SUFFIXES)}; put the three I-80 windows there (see "
            f"docs/reproducing.md for where to get them){told}"
        )
    return Found(files, left_out)


def paper_values() -> dict[str, Any]:
    """Returns what the paper prints, by law and parameter: mean, median, standard deviation."""
    return {"parameters": {key: {entry.name: entry._asdict() for entry in law.published} for key, law in LAWS.items()}}


def score(
    forecaster: RecordingForecaster, recording: Recording, out: Path, *, every: float, seed: int, command: str
) -> tuple[Evaluation, Path]:
    """Scores a forecaster on a smoothed recording; writes tables, figures and report.html; returns scores and page."""
    started = time.perf_counter()
    check_outputs(out, (PAGE, RUN))
    result = evaluate([forecaster], recording, every=every, seed=seed)
    run = _run_record(
        (forecaster.trained_on, forecaster.data_hash),
        recording,
        run_counts(recording, result.scenes),
        how={"command": command, "seed": seed, "training": {"seed": seed}, "every": every},
        seconds=time.perf_counter() - started,
    )
    return result, _written(result.tables, run, recording.site, out)


def _smoothed(files: Sequence[Path], out: Path, site: Site | None, bad_rows: BadRows, tell: Progress) -> Recording:
    contents = [(path.name, sha256_of(path)) for path in map(Path, files)]
    inputs = [contents, site_to_dict(site) if site else None, bad_rows.value]
    path = out / "recording.parquet"

    def make() -> Recording:
        recording, report = read_any(files, site=site, bad_rows=bad_rows)
        with write_outputs(out) as new:
            (new / READING).write_text(json.dumps({"read": report.to_dict()}, indent=2))
        return recording

    tell("read and smooth the recordings", 0, 1)
    smoothed, cleaning = clean(_kept(out, "recording", inputs, path, make, write_recording, read_recording))
    with write_outputs(out) as new:
        (new / CLEANING).write_text(json.dumps(asdict(cleaning), indent=2))
    tell("read and smooth the recordings", 1, 1)
    return smoothed


def _side_by_side(results: Sequence[Evaluation], test: Recording) -> tuple[dict[str, pl.DataFrame], dict[str, int]]:
    """Returns the tables of all modes one below the other, and the counts of each."""
    tables = {name: pl.concat([result.tables[name] for result in results]) for name in results[0].tables}
    counts = {
        f"{result.mode} mode: {name}": n for result in results for name, n in run_counts(test, result.scenes).items()
    }
    return tables, counts


def _window(recording: Recording, number: str) -> Recording:
    name = f"{recording.site.name}-{number}"
    if name not in recording.names:
        raise RecordingError(
            f"window {number} of site '{recording.site.name}' is missing: the protocol trains on windows "
            f"{' and '.join(TRAINING_WINDOWS)} and tests on window {TEST_WINDOW}, and the files hold "
            f"{', '.join(recording.names)}. Put all three windows into the folder"
        )
    return recording.window(name)


def _scored(
    training: Recording, test: Recording, models: Path, mode: Mode, protocol: Protocol, tell: Progress
) -> Evaluation:
    """Returns the scores of one mode; ours stands beside the paper's framework in corrected mode."""
    forecasters: list[RecordingForecaster] = [_paper(training, models / mode, mode, protocol.paper, tell)]
    if mode is Mode.CORRECTED:
        forecasters.insert(0, _ours(training, models.parent / OURS, protocol.ours, tell))
    tell(f"{mode} mode: forecast and score window {TEST_WINDOW}", 0, 1)
    result = evaluate(forecasters, test, every=protocol.every, seed=protocol.paper.seed)
    tell(f"{mode} mode: forecast and score window {TEST_WINDOW}", 1, 1)
    return result


def _ours(recording: Recording, folder: Path, spec: ForecasterSpec, tell: Progress) -> Forecaster:
    def train() -> Forecaster:
        return fit(recording, spec=spec, progress=tell)

    return _kept_model(folder, _inputs(recording, spec), train, OUR_TAGS, kind="rampcast")


def _paper(recording: Recording, folder: Path, mode: Mode, spec: PaperSpec, tell: Progress) -> PaperForecaster:
    inputs = [mode, _inputs(recording, spec)]
    parts = folder.with_name(f"{folder.name}-parts")

    def lstm(lane: str) -> NeighbourLstm:
        def fit() -> NeighbourLstm:
            return fit_neighbours(recording, lane, mode=mode, spec=spec, progress=tell)

        return _kept_model(parts / lane, inputs, fit, TAGS, kind="neighbours")

    def forests() -> LaneChangeForests:
        return fit_lane_changes(recording, mode=mode, spec=spec, progress=tell)

    ramp, target = for_each_lane(lstm)
    lane_changes = _kept_model(parts / "forests", inputs, forests, TAGS, kind="lane_changes")
    forecaster = assemble(recording, mode=mode, spec=spec, ramp=ramp, target=target, forests=lane_changes)
    save(forecaster, folder)
    return forecaster


def _inputs(recording: Recording, spec: ForecasterSpec | PaperSpec) -> dict[str, Any]:
    """Returns all that a trained part depends on."""
    return {"data": recording_hash(recording), "site": site_to_dict(recording.site), "spec": asdict(spec)}


def _kept_model(path: Path, inputs: object, make: Callable[[], T], tags: Tags, *, kind: str) -> T:
    write, read = partial(save_model, tags=tags), partial(load_model, tags=tags, kind=kind)
    return _kept(path.parent, path.name, inputs, path, make, write, read)


def _kept(
    folder: Path,
    name: str,
    inputs: object,
    path: Path,
    make: Callable[[], T],
    write: Callable[[T, Path], None],
    read: Callable[[Path], T],
) -> T:
    """Returns what an earlier run left at `path` if it was made from the same inputs, else makes it and keeps it."""
    text = json.dumps([__version__, inputs], default=str, sort_keys=True)
    fingerprint = hashlib.sha256(text.encode()).hexdigest()
    mark = folder / FINGERPRINTS / name
    if path.is_file() and not mark.is_file():
        raise OutputError(f"{path}: this file is not of an earlier run and would be lost; choose another --out")
    if path.exists() and mark.is_file() and mark.read_text() == fingerprint:
        with suppress(ModelError, RecordingError):  # damaged since: make it again
            return read(path)
    made = make()
    with write_whole(mark) as partial:
        partial.write_text(UNFINISHED)
    write(made, path)
    with write_whole(mark) as partial:
        partial.write_text(fingerprint)
    return made


def _run_record(
    trained: tuple[Sequence[str], str],
    test: Recording,
    counts: dict[str, int],
    *,
    how: dict[str, Any],
    seconds: float,
) -> dict[str, Any]:
    """Returns what is known of a run; `trained` are the names of the windows trained on, and the hash of their data."""
    return how | {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "data_hash": trained[1],
        "test_data_hash": recording_hash(test),
        "source": test.source,
        "versions": {"rampcast": __version__} | versions(),
        "trained_on": list(trained[0]),
        "tested_on": test.names,
        "counts": counts,
        "timings": {"this run [s]": round(seconds, 1)},
    }


def _written(tables: dict[str, pl.DataFrame], run: dict[str, Any], site: Site, out: Path) -> Path:
    """Writes the tidy tables, the run record and the report, all or none; returns the report's path."""
    with write_outputs(out) as new:
        (new / "tables").mkdir()
        for name, table in tables.items():
            table.write_parquet(new / "tables" / f"{name}.parquet")
            table.write_csv(new / "tables" / f"{name}.csv")
        (new / RUN).write_text(json.dumps(run, indent=2), encoding="utf-8")
        fill_report(tables, site=site, run=run, paper=paper_values(), folder=new)
    return out / PAGE
