"""One task of a batch: a file that is read, or a part of one that is worked on; and the record of what became of it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rampcast import __version__
from rampcast.batch.plan import Plan
from rampcast.files import sha256_of, write_whole
from rampcast.forecasters import PRETRAINED, PRETRAINED_FOLDER

Record = dict[str, Any]
RECORDS: Final = ".tasks"  # folder of what became of each task
READ: Final = ".read"  # folder of recordings that were read from other formats, until all their parts are done
READING: Final = ("site", "format", "mapping", "skip_bad_rows", "accept_doubtful")  # what reading depends on


@dataclass(frozen=True)
class Part:
    """A part of a recording: a window of a site, for some time.

    Attributes:
        number: counted over the file.
        source: rampcast's own parquet that its rows are read from.
        site: name of its site.
        window: name of the window.
        begin, end: its rows and its forecasts are from `begin` on and before `end` [s].
        first, last: of the whole window, times of its first and last rows [s].
        key: digest of all that its results depend on.
    """

    number: int
    source: Path
    site: str
    window: str
    begin: float
    end: float
    first: float
    last: float
    key: str


@dataclass(frozen=True)
class Task:
    """What is done with one file, or with one part of it; see `Plan`."""

    file: Path
    plan: Plan
    part: Part | None = None

    @property
    def name(self) -> str:
        """Returns its name in words."""
        return self.file.stem if self.part is None else f"{self.file.stem}, part {self.part.number:04}"

    @property
    def record(self) -> Path:
        """Returns the file that says what became of it."""
        of_file = self.plan.out / RECORDS / f"{self.file.stem}.json"
        return of_file if self.part is None else of_file.with_suffix("") / f"{self.part.number:04}.json"

    def key(self) -> str:
        """Returns a digest of all that its results depend on."""
        if self.part is not None:
            return self.part.key
        if self.plan.window:
            return digest({name: getattr(self.plan, name) for name in READING}, [self.file, *reading_files(self.plan)])
        return digest(settings(self.plan), [self.file, *reading_files(self.plan), *model_files(self.plan)])

    @property
    def about(self) -> Record:
        """Returns how its record begins."""
        about = {"name": self.name, "file": str(self.file)}
        if self.part is None:
            return about
        seen = {"begin": max(self.part.begin, self.part.first), "end": min(self.part.end, self.part.last)}
        return about | {"site": self.part.site, "part": self.part.number} | seen


def failed(task: Task, reason: str) -> Record:
    """Returns the record of a task that failed, which is not kept: it is tried again."""
    return task.about | {"key": None, "error": reason, "roads": [], "sources": [], "peak_mb": peak_memory()}


def done_before(task: Task) -> Record | None:
    """Returns what became of a task if it was done and its results are there."""
    try:
        found = dict(json.loads(task.record.read_text(encoding="utf-8")))
        there = all((task.plan.out / name).is_file() for road in found["roads"] for name in road["files"])
    except (OSError, ValueError, TypeError, KeyError):  # none yet, or a damaged one: the task is done again
        return None
    return found if there else None


def settings(plan: Plan) -> dict[str, Any]:
    """Returns what a plan says beside where from and where to."""
    return {name: value for name, value in asdict(plan).items() if name not in ("files", "out")}


def digest(values: Mapping[str, Any], files: list[Path]) -> str:
    """Returns the SHA-256 of values, this release, and the content of files."""
    parts = [json.dumps(values, sort_keys=True, default=str), __version__, *map(sha256_of, files)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def reading_files(plan: Plan) -> list[Path]:
    """Returns the files beside a recording's own that its reading depends on."""
    return [*_files_of(plan.mapping), *_files_of(plan.site)]


def model_files(plan: Plan) -> list[Path]:
    """Returns the files of the model."""
    return _files_of(str(PRETRAINED_FOLDER) if plan.model == PRETRAINED else plan.model)


def _files_of(given: str | None) -> list[Path]:
    """Returns the files that a value of the plan names; none for a site that ships with rampcast."""
    if given is None or not Path(given).exists():
        return []
    path = Path(given)
    return [path] if path.is_file() else sorted(one for one in path.iterdir() if one.is_file())


def whole(path: Path) -> Any:
    """Gives a path to write a file to, whole or not at all, in a folder that is made if it is not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(path)


def peak_memory() -> float | None:
    """Returns the most memory that this process has had [MB]; None where the system is not Linux."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return None
    found = next((line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")), None)
    return None if found is None else round(int(found) / 1024, 1)
