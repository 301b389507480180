"""A breach of what roads and vehicles can have: where, how much, and what it likely comes of."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from rampcast.errors import RecordingError

SHOWN = 3  # breaches that a refusal names; all are counted

OF_RECORDINGS = (
    '`rampcast doctor` shows where; to go on all the same give --accept-doubtful (rc.read: doubtful="accept")'
)


class Doubtful(Enum):
    """What to do with a recording, or with a frame of a stream, that is not as roads and vehicles are."""

    REFUSE = "refuse"
    ACCEPT = "accept"


@dataclass(frozen=True)
class Breach:
    """Something that no road or vehicle has.

    Attributes:
        name: short, as "impossible_speeds".
        what: is wrong, in words.
        window: name of the window; "" where it is the whole recording, or a frame of a stream.
        vehicle: id of the worst; None where it is no single one.
        frame: of the worst; None where it is no single one.
        value: of the worst, in its unit.
        expected: which values are, in words and with the unit.
        count, of: how many there are, of how many.
        cause: what it likely comes of.
        most: the share of `count` in `of` above which a forecast is spoilt.
    """

    name: str
    what: str
    window: str
    vehicle: int | str | None
    frame: int | None
    value: float
    expected: str
    count: int
    of: int
    cause: str
    most: float

    @property
    def spoils(self) -> bool:
        """Returns whether a forecast would be spoilt."""
        return self.count > self.most * max(self.of, 1)

    def __str__(self) -> str:
        place = [f"{self.window}"] if self.window else []
        place += [f"vehicle {self.vehicle}"] if self.vehicle is not None else []
        place += [f"frame {self.frame}"] if self.frame is not None else []
        where = f"{', '.join(place)}: " if place else ""
        return (
            f"{self.what} ({self.count:,} of {self.of:,}); {where}{self.value:,.6g}, expected {self.expected}. "
            f"Likely {self.cause}"
        )


def refuse(breaches: Sequence[Breach], *, doing: str, what: str = "the recording", advice: str = OF_RECORDINGS) -> None:
    """Raises an error where a breach spoils a forecast.

    Args:
        breaches: what was found.
        doing: what is refused, as "forecast of i80".
        what: is not as roads and vehicles are.
        advice: how to go on.

    Raises:
        RecordingError: one does; it names the first of them.
    """
    spoiling = [breach for breach in breaches if breach.spoils]
    if not spoiling:
        return
    named = "; ".join(str(breach) for breach in spoiling[:SHOWN])
    more = f"; and {len(spoiling) - SHOWN} more" if len(spoiling) > SHOWN else ""
    raise RecordingError(f"{doing} is refused, since {what} is not as roads and vehicles are: {named}{more}. {advice}")


def over_parts(parts: Sequence[tuple[int, Sequence[Breach]]]) -> tuple[Breach, ...]:
    """Returns the breaches of a recording of which only parts are in memory: the worst of each name, counts added.

    Args:
        parts: rows and breaches of each; a part without a breach has as many rows, or vehicles, of which it counts.
    """
    rows = sum(count for count, _ in parts)
    named: dict[str, list[tuple[int, Breach]]] = {}
    for count, found in parts:
        for breach in found:
            named.setdefault(breach.name, []).append((count, breach))
    whole = []
    for those in named.values():
        worst = max((one for _, one in those), key=lambda one: math.inf if math.isnan(one.value) else abs(one.value))
        of = sum(one.of for _, one in those) * rows / max(sum(count for count, _ in those), 1)
        whole.append(replace(worst, count=sum(one.count for _, one in those), of=round(of)))
    return tuple(whole)
