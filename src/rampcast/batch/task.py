"""One task of a batch: all that is done with one file. It runs in a process of its own, here or on another machine."""

import hashlib
import json
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from rampcast import __version__
from rampcast.batch.plan import Plan
from rampcast.errors import RampcastError
from rampcast.evaluate.positions import beside_truth, errors_by
from rampcast.files import sha256_of, write_whole
from rampcast.forecast.parts import write_forecasts
from rampcast.forecast.storage import PRETRAINED, PRETRAINED_FOLDER, load
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.invariants import check_believable
from rampcast.recording.recording import write_recording
from rampcast.threads import choosing_threads

if TYPE_CHECKING:
    from rampcast.doctor import RoadDiagnosis

RECORDS: Final = ".tasks"  # folder of what became of each task
NO_DAY: Final = "unknown"
PLAIN: Final = (RampcastError, OSError)  # whose words are for users


@dataclass(frozen=True)
class Task:
    """What is done with one file; see `Plan`."""

    file: Path
    plan: Plan

    @property
    def name(self) -> str:
        """Returns the name of its results."""
        return self.file.stem

    @property
    def record(self) -> Path:
        """Returns the file that says what became of it."""
        return self.plan.out / RECORDS / f"{self.name}.json"

    def key(self) -> str:
        """Returns a digest of all that its results depend on."""
        settings = {name: value for name, value in asdict(self.plan).items() if name not in ("files", "out")}
        parts = [json.dumps(settings, sort_keys=True, default=str), __version__, sha256_of(self.file)]
        for given in (self.plan.mapping, self.plan.site, self.plan.model):
            parts += [sha256_of(path) for path in _files_of(given)]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def run_task(task: Task) -> dict[str, Any]:
    """Returns what became of a task, and writes it beside its results; one that was done before is not done again.

    A file that cannot be read, or whatever else goes wrong, is part of what is returned: it spoils no other task.
    """
    try:
        key = task.key()
        if (before := _record(task)) is not None and before.get("key") == key and _all_there(task, before):
            return before
        with choosing_threads(1):
            found: dict[str, Any] = {"key": key, "error": None, "roads": _roads(task)}
    except PLAIN as error:
        return {"name": task.name, "file": str(task.file), "key": None, "error": str(error), "roads": []}
    except Exception as error:  # whatever it is, the other tasks go on
        told = f"{type(error).__name__}: {error}; please report it with\n{traceback.format_exc()}"
        return {"name": task.name, "file": str(task.file), "key": None, "error": told, "roads": []}
    found |= {"name": task.name, "file": str(task.file)}
    with _whole(task.record) as path:
        path.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return found


def _roads(task: Task) -> list[dict[str, Any]]:
    """Returns what became of each road of the file."""
    from rampcast.doctor import doctor
    from rampcast.formats import read_all

    plan = task.plan
    recordings, report = read_all(
        [task.file],
        site=plan.site,
        format=plan.format,
        mapping=plan.mapping,
        bad_rows="skip" if plan.skip_bad_rows else "raise",
    )
    if "doctor" in plan.do:
        diagnosis = doctor(recordings, report)
        with _whole(plan.out / "doctor" / f"{task.name}.json") as path:
            path.write_text(json.dumps(diagnosis.to_dict(), indent=1), encoding="utf-8")
        roads: list[RoadDiagnosis | None] = list(diagnosis.roads)
    else:
        roads = [None] * len(recordings)
    accepted = [replace(one, is_accepted=plan.accept_doubtful) for one in recordings]
    return [_road(task, one, about) for one, about in zip(accepted, roads, strict=True)]


def _road(task: Task, recording: Recording, about: "RoadDiagnosis | None") -> dict[str, Any]:
    """Writes what the plan asks of a road, and returns what a summary says of it."""
    plan, day = task.plan, _day(recording)
    place = Path(f"site={recording.site.name}") / f"day={day}" / f"file={task.name}"
    facts: dict[str, Any] = {
        "site": recording.site.name,
        "day": day,
        "vehicles": recording.tracks.select(c.RECORDING, c.VEHICLE).n_unique(),
        "rows": recording.tracks.height,
        "spoils": None if about is None else about.spoils,
        "findings": None if about is None else len(about.findings),
    }
    files: list[Path] = []
    if "convert" in plan.do:
        check_believable(recording, doing=f"conversion of {task.file}")
        files.append(Path("recordings") / place / "recording.parquet")
        (plan.out / files[-1]).parent.mkdir(parents=True, exist_ok=True)
        write_recording(recording, plan.out / files[-1])
    if {"forecast", "evaluate"} & {*plan.do}:
        folder = plan.out / "forecasts" / place
        parts = load(plan.model).in_parts(recording, every=plan.every)
        files += [path.relative_to(plan.out) for path in write_forecasts(parts.each, folder, suffixes=(".parquet",))]
        if "evaluate" in plan.do:
            files.append(Path("scores") / place / "scores.parquet")
            with _whole(plan.out / files[-1]) as path:
                beside = beside_truth(pl.scan_parquet(folder / "forecast.parquet"), recording)
                errors_by(beside, ["model", "horizon"]).write_parquet(path)
    return facts | {"files": [one.as_posix() for one in files]}


def _day(recording: Recording) -> str:
    """Returns the day on which a recording began, in UTC."""
    if not recording.began:
        return NO_DAY
    return datetime.fromtimestamp(min(recording.began.values()), tz=UTC).date().isoformat()


def _record(task: Task) -> dict[str, Any] | None:
    try:
        return dict(json.loads(task.record.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):  # none yet, or a damaged one: the task is done again
        return None


def _all_there(task: Task, record: Mapping[str, Any]) -> bool:
    return all((task.plan.out / name).is_file() for road in record["roads"] for name in road["files"])


def _files_of(given: str | None) -> list[Path]:
    """Returns the files that a value of the plan names; none for a site that ships with rampcast."""
    if given == PRETRAINED:
        given = str(PRETRAINED_FOLDER)
    if given is None or not Path(given).exists():
        return []
    path = Path(given)
    return [path] if path.is_file() else sorted(one for one in path.iterdir() if one.is_file())


def _whole(path: Path) -> Any:
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(path)
