"""What somebody says of a table, what is asked of them, and what is proposed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from rampcast.errors import RampcastError
from rampcast.formats.readers.plain.mapping import UNITS
from rampcast.roads.ramp import RampValues


class StartError(RampcastError):
    """A table cannot be told by its content: the message says what to answer, or what is wrong with the guess."""


@dataclass(frozen=True)
class Question:
    """What a table does not tell: in words, and the option that answers it."""

    text: str
    option: str


Ask = Callable[[Question], str | None]


def nobody_answers(question: Question) -> None:
    """Returns no answer: for programs without a terminal."""


@dataclass(frozen=True)
class Answers:
    """What is known of a table beforehand; nothing, and the table tells it.

    Attributes:
        columns: the column of a value, as {"vehicle": "obj"}; "" says that there is none.
        units: of a value, as {"x": "ft", "time": "iso"}, or how many SI units are one of it.
        frame_rate: frames per second.
        reference: which point of a vehicle its positions are.
        plane: whether positions are in a plane; None: the table tells it.
        timezone: of times that name none.
        road: which of several roads.
        ramp: lanes and places of the ramp.
        no_ramp: that there is none.
        mirrored: that the plane grows to the right.
        name: of the place.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    frame_rate: float | None = None
    reference: str | None = None
    plane: bool | None = None
    timezone: str | None = None
    road: str | None = None
    ramp: RampValues = field(default_factory=RampValues)
    no_ramp: bool = False
    mirrored: bool = False
    name: str = ""


NOTHING: Final = Answers()


@dataclass
class Proposal:
    """A mapping file in the making.

    Attributes:
        values: of the mapping file.
        reasons: what each was told by, in words.
        assumed: names of values that nothing in the rows looked at tells.
    """

    values: dict[str, Any] = field(default_factory=dict)
    reasons: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)

    def say(self, name: str, value: Any, reason: str) -> None:
        """Adds what a value of `[columns]` is, and why."""
        self.values.setdefault("columns", {})[name] = value
        self.reasons.append(f"{name}: {reason}")


def answers_of(columns: Sequence[str], units: Sequence[str], ramp: tuple[Any, ...], said: Mapping[str, Any]) -> Answers:
    """Returns answers from words as a command line has them.

    Args:
        columns: as "vehicle=obj"; units: as "x=ft".
        ramp: values of `RampValues`.
        said: other values of `Answers`.

    Raises:
        StartError: a column or unit is of no value.
    """
    for option, given in (("--column", columns), ("--unit", units)):
        for one in given:
            if "=" not in one or one.partition("=")[0] not in UNITS:
                raise StartError(f"{option} {one}: expected VALUE=..., with a value of {', '.join(UNITS)}")
    named, in_units = (dict(one.partition("=")[::2] for one in given) for given in (columns, units))
    return Answers(columns=named, units=in_units, ramp=RampValues(*ramp), **said)


def answer_to(question: Question, ask: Ask) -> str:
    """Returns the answer to a question.

    Raises:
        StartError: nobody answers it.
    """
    answer = ask(question)
    if answer is None or not answer.strip():
        raise StartError(f"{question.text} Answer with {question.option}")
    return answer.strip()
