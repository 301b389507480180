"""A check, the faults that it counts, and the finding that it makes of them: how bad, how often, and where."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import polars as pl

from rampcast.doctor.places import VALUE
from rampcast.doctor.severity import Severity
from rampcast.doctor.subject import Subject
from rampcast.recording import columns as c

MOST_EXAMPLES = 10


@dataclass(frozen=True)
class Faults:
    """What a check counted.

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


NOT_SMOOTHED = NotAssessed("the recording cannot be smoothed")


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
    limit: str
    advice: str
    why: str
    look: Callable[[Subject], Faults | NotAssessed]
    measured: str = ""
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
    """Faults to speak of.

    Attributes:
        check: that found them.
        severity: how bad they are.
        places: where they are, with the columns of `PLACE_SCHEMA`.
        count, of: how many are at fault, of how many.
        detail: more in words.
    """

    check: Check
    severity: Severity
    places: pl.DataFrame = field(repr=False)
    count: int
    of: int
    detail: str

    @property
    def share(self) -> float:
        """Returns the share of what is counted that is at fault; 1 if there is nothing to compare with."""
        return self.count / self.of if self.of else 1.0

    @property
    def examples(self) -> pl.DataFrame:
        """Returns the worst places, at most ten: those of largest value."""
        worst = self.places.sort(pl.col(VALUE).abs(), descending=True, nulls_last=True, maintain_order=True)
        return worst.head(MOST_EXAMPLES)

    def example(self) -> str:
        """Returns the worst place in words; "" where there is none."""
        if not self.places.height:
            return ""
        row = self.examples.row(0, named=True)
        names = (c.RECORDING, c.VEHICLE, c.FRAME)
        place = ", ".join(f"{name} {row[name]}".replace("recording ", "") for name in names if row[name] is not None)
        return f"{place}: {row[VALUE]:.2f}" if row[VALUE] is not None else place

    def to_dict(self) -> dict[str, Any]:
        """Returns the finding as plain values, for json."""
        of_check = ("name", "title", "counted", "measured", "limit", "advice")
        examples = self.examples.with_columns(pl.col(c.X, VALUE).fill_nan(None)).to_dicts()
        return {name: getattr(self.check, name) for name in of_check} | {
            "severity": self.severity.value,
            "count": self.count,
            "of": self.of,
            "share": self.share,
            "detail": self.detail,
            "examples": examples,
        }


def finding_of(check: Check, faults: Faults) -> Finding | None:
    """Returns the finding that faults are; None if they are nothing to speak of."""
    count = faults.places.height if faults.count is None else faults.count
    found = Finding(check, Severity.NOTE, faults.places, count, faults.of, faults.detail)
    severity = check.severity(found.share) if count else None
    return None if severity is None else replace(found, severity=severity)
