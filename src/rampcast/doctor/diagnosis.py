"""The diagnosis: what is wrong with the roads of some files, where, how bad it is, and what to do about it."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import polars as pl

from rampcast.arguments import expected
from rampcast.doctor.checks import CHECKS, ramp, reading
from rampcast.doctor.distributions import Distribution, distributions
from rampcast.doctor.finding import Check, Faults, Finding, NotAssessed, finding_of
from rampcast.doctor.picture_tables import picture_tables
from rampcast.doctor.places import FINDING, PLACE_SCHEMA
from rampcast.doctor.severity import Severity
from rampcast.doctor.subject import subject_of
from rampcast.notebook import html_table
from rampcast.recording import Recording
from rampcast.recording.reading import ReadReport
from rampcast.recording.recording import READ_FIRST


@dataclass(frozen=True)
class RoadDiagnosis:
    """What the doctor says of the recording of one road.

    Attributes:
        site, source, windows, simulated, time_step: of the recording.
        vehicles, rows: of the recording; an id in two windows is two vehicles.
        findings: the worst first.
        sound: checks that found nothing to speak of.
        unassessed: checks that could not be made, and why.
        distributions: of speed, acceleration and jerk, before and after smoothing.
        facts: other numbers to know, by name.
        pictures: tables that the page draws, by name.
    """

    site: str
    source: str
    simulated: bool
    windows: tuple[str, ...]
    time_step: float
    vehicles: int
    rows: int
    findings: tuple[Finding, ...]
    sound: tuple[Check, ...]
    unassessed: Mapping[Check, str]
    distributions: tuple[Distribution, ...]
    facts: Mapping[str, str]
    pictures: Mapping[str, pl.DataFrame] = field(repr=False)

    @property
    def spoils(self) -> bool:
        """Returns whether something was found that would spoil a forecast."""
        return _spoils(self.findings)

    def finding(self, name: str) -> Finding | None:
        """Returns the finding of a check, if there is one."""
        return next((finding for finding in self.findings if finding.check.name == name), None)

    def places(self) -> pl.DataFrame:
        """Returns every place of every finding: which finding, and the columns of `PLACE_SCHEMA`."""
        tables = (one.places.select(pl.lit(one.check.name).alias(FINDING), pl.all()) for one in self.findings)
        return pl.concat([pl.DataFrame(schema=pl.Schema({FINDING: pl.String(), **PLACE_SCHEMA})), *tables])

    def to_dict(self) -> dict[str, Any]:
        """Returns everything but the tables as plain values, for json."""
        as_they_are = ("site", "source", "simulated", "time_step", "vehicles", "rows", "spoils")
        return {name: getattr(self, name) for name in as_they_are} | {
            "windows": list(self.windows),
            "findings": [finding.to_dict() for finding in self.findings],
            "sound": [check.name for check in self.sound],
            "not_assessed": {check.name: reason for check, reason in self.unassessed.items()},
            "distributions": [one.to_dict() for one in self.distributions],
            "facts": dict(self.facts),
        }


@dataclass(frozen=True)
class Diagnosis:
    """What the doctor says of all recordings that it was given together.

    Attributes:
        roads: of each recording.
        in_files: what reading counted in files of several roads; of one road it is among the road's findings.
        report: what reading the files found; None if nothing was read from files.
    """

    roads: tuple[RoadDiagnosis, ...]
    in_files: tuple[Finding, ...] = ()
    report: ReadReport | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Returns what was found in the files and in all roads."""
        return (*self.in_files, *(finding for road in self.roads for finding in road.findings))

    @property
    def spoils(self) -> bool:
        """Returns whether anything found would spoil a forecast."""
        return _spoils(self.findings)

    def places(self) -> pl.DataFrame:
        """Returns every place of every finding: site, which finding, and the columns of `PLACE_SCHEMA`."""
        return pl.concat([road.places().select(pl.lit(road.site).alias("site"), pl.all()) for road in self.roads])

    def to_polars(self) -> pl.DataFrame:
        """Returns a row for each finding; the site is null where it is one of the files."""
        names = [None] * len(self.in_files) + [road.site for road in self.roads for _ in road.findings]
        rows = [
            (site, one.severity.value, one.check.name, one.check.title, one.count, one.of, one.share, one.check.advice)
            for site, one in zip(names, self.findings, strict=True)
        ]
        heads = ("site", "severity", "name", "title", "count", "of", "share", "advice")
        kinds = (*[pl.String()] * 4, pl.Int64(), pl.Int64(), pl.Float64(), pl.String())
        return pl.DataFrame(rows, schema=dict(zip(heads, kinds, strict=True)), orient="row")

    def to_dict(self) -> dict[str, Any]:
        """Returns everything but the tables as plain values, for json."""
        return {
            "spoils": self.spoils,
            "reading": self.report.to_dict() if self.report else None,
            "in_files": [finding.to_dict() for finding in self.in_files],
            "recordings": [road.to_dict() for road in self.roads],
        }

    def __repr__(self) -> str:
        counts = Counter(finding.severity.value for finding in self.findings)
        found = ", ".join(f"{kind.value}: {counts[kind.value]}" for kind in Severity if counts[kind.value])
        return f"<Diagnosis of {', '.join(road.site for road in self.roads)}; {found or 'nothing found'}>"

    def __str__(self) -> str:
        """Returns what was found and what to do, line by line."""
        roads = [(f"{one.site}: {one.vehicles:,} vehicles, {one.rows:,} rows", one.findings) for one in self.roads]
        files = [("all files", self.in_files)] if self.in_files else []
        lines = [line for title, findings in [*files, *roads] for line in (title, *_lines(findings))]
        end = "this would spoil a forecast" if self.spoils else "nothing here would spoil a forecast"
        return "\n".join([*lines, end])

    def _repr_html_(self) -> str:
        rows = {one.check.title: f"{one.severity.value}: {one.check.counting(one.count)}" for one in self.findings}
        return html_table(repr(self)[1:-1], rows)


def doctor(recording: Recording | Sequence[Recording], report: ReadReport | None = None) -> Diagnosis:
    """Returns what is wrong with a recording, or with those of the roads of some files, and what could not be told.

    Of several roads, what reading counted is not known road by road: it is said once and spoils no single road.

    Args:
        recording: raw or smoothed, or several; raw tells more.
        report: what reading the files of all of them found; None takes the report of each recording.

    Raises:
        RampcastError: it is something else.
    """
    given = recording if isinstance(recording, list | tuple) and recording else [recording]
    recordings = [expected(Recording, one, name="recording", advice=READ_FIRST) for one in given]
    if report is None or len(recordings) == 1:
        roads = tuple(examine(one, report or one.report) for one in recordings)
        return Diagnosis(roads, (), report or (recordings[0].report if len(roads) == 1 else None))
    of_roads = [check for check in CHECKS if check.name not in reading.OF_FILES or check.name in reading.OF_ROWS]
    return Diagnosis(tuple(examine(one, checks=of_roads) for one in recordings), examine_reading(report), report)


def examine_reading(report: ReadReport) -> tuple[Finding, ...]:
    """Returns what is wrong with files by what reading them found alone, in all of their roads together."""
    of_files = [(check, reading.in_files(report, check.name)) for check in CHECKS if check.name in reading.OF_FILES]
    return _judged(of_files)[0]


def examine(
    recording: Recording, report: ReadReport | None = None, *, checks: Sequence[Check] = CHECKS
) -> RoadDiagnosis:
    """Returns what is wrong with the recording of one road, and what could not be told.

    Args:
        recording: raw or smoothed.
        report: what reading its files found.
        checks: those to make.
    """
    subject = subject_of(recording, report)
    findings, sound, unassessed = _judged((check, check.look(subject)) for check in checks)
    return RoadDiagnosis(
        site=recording.site.name,
        source=recording.source,
        simulated=recording.site.simulated,
        windows=tuple(recording.names),
        time_step=recording.time_step,
        vehicles=len(subject.starts),
        rows=recording.tracks.height,
        findings=findings,
        sound=sound,
        unassessed=unassessed,
        distributions=distributions(subject),
        facts=ramp.facts(subject),
        pictures=picture_tables(subject, findings),
    )


def _judged(
    outcomes: Iterable[tuple[Check, Faults | NotAssessed]],
) -> tuple[tuple[Finding, ...], tuple[Check, ...], dict[Check, str]]:
    """Returns what is a finding, the worst first, which checks found nothing to speak of, and what is not known."""
    findings, sound, unassessed = [], [], {}
    for check, outcome in outcomes:
        if isinstance(outcome, NotAssessed):
            unassessed[check] = outcome.reason
        elif (finding := finding_of(check, outcome)) is None:
            sound.append(check)
        else:
            findings.append(finding)
    order = list(Severity)
    findings.sort(key=lambda finding: (order.index(finding.severity), -finding.share))
    return tuple(findings), tuple(sound), unassessed


def _lines(findings: Iterable[Finding]) -> Iterator[str]:
    for one in findings:
        share = f", {one.share:.2%}" if one.of else ""
        yield f"  {one.severity.value}: {one.check.title} ({one.check.counting(one.count)}{share}). {one.check.advice}"


def _spoils(findings: Iterable[Finding]) -> bool:
    return any(finding.severity is Severity.SPOILS for finding in findings)
