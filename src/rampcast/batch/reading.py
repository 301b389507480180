"""The first task of a file: it becomes rampcast's own parquet, if it is none, and is told in which parts to go on."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from rampcast.batch.plan import Plan
from rampcast.batch.task import Part, Record, Task, digest, model_files, settings
from rampcast.doctor.diagnosis import examine_reading
from rampcast.errors import RecordingError
from rampcast.files import put, work_folder
from rampcast.formats.files.head import heads_of
from rampcast.formats.readers.own import OWN
from rampcast.formats.reading import convert_all, format_of
from rampcast.recording.extents import EDGE, extents_of
from rampcast.recording.reading import ReadReport
from rampcast.recording.recording import read_description
from rampcast.sites import site_of

READ: Final = ".read"  # folder of recordings that were read from other formats, until all their parts are done
MOST_PARTS: Final = 100_000  # of a window: five minutes each for a year


def read_sources(file: Path, plan: Plan) -> Record:
    """Returns which recordings of rampcast's own hold the rows of a file, and what they span.

    A file of another format, or one that another site is asked for, is converted first: I-24 MOTION's part by part,
    others whole in memory.
    """
    heads = heads_of(file)
    is_own = plan.mapping is None and format_of(heads, plan.format) is OWN
    if is_own and (plan.site is None or site_of(plan.site) == read_description(file).site):
        sources, findings = [file], []
    else:
        sources, report = _converted(file, plan)
        findings = [found(one) for one in examine_reading(report)]
    return {"roads": [], "sources": [_source(path, plan.window) for path in sources], "found": findings}


def found(finding: Any) -> dict[str, Any]:
    """Returns a finding of the doctor as records keep it."""
    kept = {"severity": finding.severity.value, "name": finding.check.name, "title": finding.check.title}
    return kept | {"count": finding.count, "of": finding.of}


def _converted(file: Path, plan: Plan) -> tuple[list[Path], ReadReport]:
    folder = plan.out / READ / file.stem
    with work_folder(folder) as work:
        written, report = convert_all(
            file,
            work / "recording.parquet",
            site=plan.site,
            format=plan.format,
            mapping=plan.mapping,
            bad_rows="skip" if plan.skip_bad_rows else "raise",
            doubtful="accept" if plan.accept_doubtful else "refuse",
        )
        for path in written:
            put(path, folder / path.name)
    return [folder / path.name for path in written], report


def _source(path: Path, window: float) -> dict[str, Any]:
    extents = extents_of(path)
    for one in extents:
        if (one.last - one.first) / window > MOST_PARTS:
            raise RecordingError(
                f"{path}: the window '{one.window}' spans {(one.last - one.first) / 86_400:,.0f} days, more than "
                f"{MOST_PARTS:,} parts of {window:g} s; are its times in another unit, or two recordings in one?"
            )
    return {"path": str(path), "site": read_description(path).site.name, "windows": [asdict(one) for one in extents]}


def parts_of(record: Mapping[str, Any], plan: Plan) -> list[Task]:
    """Returns the tasks of the parts of a file that was read."""
    work = digest(settings(plan), model_files(plan))
    return [
        Task(
            Path(record["file"]),
            plan,
            Part(
                number, Path(source["path"]), source["site"], one["window"], begin, end, one["first"], one["last"], key
            ),
        )
        for number, (source, one, begin, end) in enumerate(_pieces(record["sources"], plan.window))
        for key in [digest({"file": record["key"], "work": work, "window": one, "span": (begin, end)}, [])]
    ]


def _pieces(
    sources: Sequence[Mapping[str, Any]], window: float
) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any], float, float]]:
    for source in sources:
        for one in source["windows"]:
            for begin, end in spans(one["first"], one["last"], window):
                yield source, one, begin, end


def spans(first: float, last: float, window: float) -> list[tuple[float, float]]:
    """Returns the spans [s] that hold all of a recording, as the clock strikes; one of less than half joins another.

    Args:
        first, last: times of the first and last rows [s].
        window: length of a span [s].
    """
    low, high = (math.floor((time + EDGE) / window) for time in (first, last))
    edges = [number * window for number in range(low, high + 2)]
    if len(edges) > 2 and edges[1] - first < window / 2:
        del edges[1]
    if len(edges) > 2 and last - edges[-2] < window / 2:
        del edges[-2]
    return list(pairwise(edges))
