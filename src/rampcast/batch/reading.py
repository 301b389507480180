"""The first task of a file: it becomes rampcast's own parquet, if it is none, and is told what that spans."""

from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from rampcast.batch.plan import Plan
from rampcast.batch.task import READ, Record
from rampcast.doctor.diagnosis import examine_reading
from rampcast.errors import RecordingError
from rampcast.files import put, work_folder
from rampcast.formats.files.head import heads_of
from rampcast.formats.readers.own import OWN
from rampcast.formats.reading import convert_all, format_of
from rampcast.recording.extents import extents_of
from rampcast.recording.reading import ReadReport
from rampcast.recording.recording import read_description
from rampcast.sites import site_of

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
