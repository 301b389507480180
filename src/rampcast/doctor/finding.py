"""What the doctor says: findings with their places, checks that could not be made, distributions, and all together."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import polars as pl

from rampcast.doctor.places import FINDING, PLACE_SCHEMA, VALUE
from rampcast.doctor.subject import Subject
from rampcast.formats import ReadReport
from rampcast.recording import columns as c

MOST_EXAMPLES = 10


class Severity(Enum):
    """How bad a finding is, the worst first."""

    SPOILS = "spoils a forecast"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True)
class Faults:
    """What a check found.

    Attributes:
        places: where, with the columns of `PLACE_SCHEMA`, in the order of the recording.
        of: how many there are of what is counted.
        count: how many are at fault; None counts the places.
        detail: what was found, in words, beyond the count.
    """

    places: pl.DataFrame
    of: int
    count: int | None = None
    detail: str = ""


@dataclass(frozen=True)
class NotAssessed:
    """A check that cannot be made on this recording, and why."""

    reason: str


@dataclass(frozen=True)
class Check:
    """One of the doctor's checks.

    Attributes:
        name: for json and tables.
        title: what is wrong if it finds something.
        counted: what is counted, as "rows".
        measured: what the value at a place is, with its unit.
        limit: what counts as a fault, with its source.
        advice: what to do about it.
        notes, warns, spoils: shares above which it is a note, a warning, or would spoil a forecast.
        why: why these shares.
        look: makes the check.
    """

    name: str
    title: str
    counted: str
    measured: str
    limit: str
    advice: str
    why: str
    look: Callable[[Subject], Faults | NotAssessed]
    notes: float = 0.0
    warns: float = math.inf
    spoils: float = math.inf

    def counting(self, number: int) -> str:
        """Returns a number of what is counted in words, as "1 row" and "1,200 rows"."""
        word = re.sub(r"s\b", "", self.counted.replace("ies", "y"), count=1) if number == 1 else self.counted
        return f"{number:,} {word}"

    def severity(self, share: float) -> Severity | None:
        """Returns how bad a share is; None if it is nothing to speak of."""
        if share > self.spoils:
            return Severity.SPOILS
        if share > self.warns:
            return Severity.WARNING
        return Severity.NOTE if share > self.notes else None


@dataclass(frozen=True)
class Finding:
    """A fault that was found: which check, how bad, how often, and where."""

    check: Check
    severity: Severity
    found: Faults

    @property
    def count(self) -> int:
        """Returns how many are at fault."""
        return self.found.places.height if self.found.count is None else self.found.count

    @property
    def share(self) -> float:
        """Returns the share of what is counted that is at fault; 1 if there is nothing to compare with."""
        return self.count / self.found.of if self.found.of else 1.0

    @property
    def examples(self) -> pl.DataFrame:
        """Returns the worst places, at most ten: those of largest value."""
        worst = self.found.places.sort(pl.col(VALUE).abs(), descending=True, nulls_last=True, maintain_order=True)
        return worst.head(MOST_EXAMPLES)

    def example(self) -> str:
        """Returns the worst place in words; "" where there is none."""
        if not self.found.places.height:
            return ""
        row = self.examples.row(0, named=True)
        names = ("recording", "vehicle", "frame")
        place = ", ".join(f"{name} {row[name]}".replace("recording ", "") for name in names if row[name] is not None)
        return f"{place}: {row[VALUE]:.2f}" if row[VALUE] is not None else place

    def to_dict(self) -> dict[str, Any]:
        """Returns the finding as plain values, for json."""
        return {
            "name": self.check.name,
            "title": self.check.title,
            "severity": self.severity.value,
            "count": self.count,
            "of": self.found.of,
            "share": self.share,
            "counted": self.check.counted,
            "measured": self.check.measured,
            "detail": self.found.detail,
            "limit": self.check.limit,
            "advice": self.check.advice,
            "examples": _without_nan(self.examples),
        }


@dataclass(frozen=True)
class Unassessed:
    """A check that could not be made, and why."""

    check: Check
    reason: str


@dataclass(frozen=True)
class Distribution:
    """How a quantity is distributed over the rows, before or after smoothing.

    Attributes:
        quantity, unit, stage: as "acceleration", "m/s²", "before smoothing".
        samples: rows where it is known.
        quantiles: value at each share.
        beyond: share of rows whose absolute value is above each limit.
        histogram: columns left, right [unit] and share.
    """

    quantity: str
    unit: str
    stage: str
    samples: int
    quantiles: Mapping[float, float]
    beyond: Mapping[float, float]
    histogram: pl.DataFrame = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Returns the distribution as plain values, for json."""
        return {
            "quantity": self.quantity,
            "unit": self.unit,
            "stage": self.stage,
            "samples": self.samples,
            "quantiles": {str(key): value for key, value in self.quantiles.items()},
            "share_beyond": {str(key): value for key, value in self.beyond.items()},
        }


@dataclass(frozen=True)
class Diagnosis:
    """What the doctor says of a recording.

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
    unassessed: tuple[Unassessed, ...]
    distributions: tuple[Distribution, ...]
    facts: Mapping[str, str]
    pictures: Mapping[str, pl.DataFrame] = field(repr=False)

    @property
    def spoils(self) -> bool:
        """Returns whether something was found that would spoil a forecast."""
        return any(finding.severity is Severity.SPOILS for finding in self.findings)

    def finding(self, name: str) -> Finding | None:
        """Returns the finding of a check, if there is one."""
        return next((finding for finding in self.findings if finding.check.name == name), None)

    def places(self) -> pl.DataFrame:
        """Returns every place of every finding: the columns of `PLACE_SCHEMA`, and which finding."""
        tables = (one.found.places.select(pl.lit(one.check.name).alias(FINDING), pl.all()) for one in self.findings)
        return pl.concat([pl.DataFrame(schema=pl.Schema({FINDING: pl.String(), **PLACE_SCHEMA})), *tables])

    def to_dict(self) -> dict[str, Any]:
        """Returns everything but the tables as plain values, for json."""
        return {
            "site": self.site,
            "source": self.source,
            "simulated": self.simulated,
            "windows": list(self.windows),
            "time_step": self.time_step,
            "vehicles": self.vehicles,
            "rows": self.rows,
            "spoils": self.spoils,
            "findings": [finding.to_dict() for finding in self.findings],
            "sound": [check.name for check in self.sound],
            "not_assessed": {one.check.name: one.reason for one in self.unassessed},
            "distributions": [one.to_dict() for one in self.distributions],
            "facts": dict(self.facts),
        }


def to_dict(
    diagnoses: Sequence[Diagnosis], report: ReadReport | None, in_files: Sequence[Finding] = ()
) -> dict[str, Any]:
    """Returns what was found in the recordings of some files, and in reading these, as plain values for json."""
    return {
        "spoils": spoils(diagnoses, in_files),
        "reading": report.to_dict() if report else None,
        "in_files": [finding.to_dict() for finding in in_files],
        "recordings": [one.to_dict() for one in diagnoses],
    }


def spoils(diagnoses: Sequence[Diagnosis], in_files: Sequence[Finding]) -> bool:
    """Returns whether anything found in the recordings of some files, or in the files, would spoil a forecast."""
    found = [*in_files, *(finding for one in diagnoses for finding in one.findings)]
    return any(finding.severity is Severity.SPOILS for finding in found)


def _without_nan(table: pl.DataFrame) -> list[dict[str, Any]]:
    return table.with_columns(pl.col(c.X, VALUE).fill_nan(None)).to_dicts()
