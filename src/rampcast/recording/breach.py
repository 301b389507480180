"""A breach of what roads and vehicles can have: where, how much, and what it likely comes of."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from rampcast.errors import RecordingError

SHOWN = 3  # breaches that a refusal names; all are counted


class Doubtful(Enum):
    """What to do with a recording that is not as roads and vehicles are."""

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
        spoils: whether a forecast would be spoilt.
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
    spoils: bool

    def __str__(self) -> str:
        place = [f"{self.window}"] if self.window else []
        place += [f"vehicle {self.vehicle}"] if self.vehicle is not None else []
        place += [f"frame {self.frame}"] if self.frame is not None else []
        where = f"{', '.join(place)}: " if place else ""
        return (
            f"{self.what} ({self.count:,} of {self.of:,}); {where}{self.value:,.6g}, expected {self.expected}. "
            f"Likely {self.cause}"
        )


def refuse(breaches: Sequence[Breach], *, doing: str) -> None:
    """Raises an error where a breach spoils a forecast.

    Args:
        breaches: what was found.
        doing: what is refused, as "forecast of i80".

    Raises:
        RecordingError: one does; it names the first of them.
    """
    spoiling = [breach for breach in breaches if breach.spoils]
    if not spoiling:
        return
    named = "; ".join(str(breach) for breach in spoiling[:SHOWN])
    more = f"; and {len(spoiling) - SHOWN} more" if len(spoiling) > SHOWN else ""
    raise RecordingError(
        f"{doing} is refused, since the recording is not as roads and vehicles are: {named}{more}. `rampcast doctor` "
        'shows where; to go on all the same give --accept-doubtful (rc.read: doubtful="accept")'
    )
