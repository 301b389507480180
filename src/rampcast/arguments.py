"""What callers of public functions give: taken as what was meant, or a sentence that says what was expected."""

from enum import Enum
from typing import TypeVar

from rampcast.errors import RampcastError

Choice = TypeVar("Choice", bound=Enum)
Kind = TypeVar("Kind")
LONGEST = 60  # letters of a value that an error shows


def chosen(choices: type[Choice], value: object, *, name: str) -> Choice:
    """Returns the member of an Enum that is meant by itself or by its value.

    Args:
        choices: the Enum.
        value: what the caller gave.
        name: of the argument, for the error.

    Raises:
        RampcastError: it is none of them.
    """
    try:
        return choices(value)
    except ValueError:
        known = ", ".join(repr(one.value) for one in choices)
        raise RampcastError(f"{name}: expected one of {known}, got {_shown(value)}") from None


def expected(kind: type[Kind], value: object, *, name: str, advice: str) -> Kind:
    """Returns a value that is of the kind that a function takes.

    Args:
        kind: the class.
        value: what the caller gave.
        name: of the argument, for the error.
        advice: how to get one, for the error.

    Raises:
        RampcastError: it is something else.
    """
    if not isinstance(value, kind):
        raise RampcastError(f"{name}: expected a {kind.__name__}, got {_shown(value)}; {advice}")
    return value


def _shown(value: object) -> str:
    text = repr(value)
    if isinstance(value, str | int | float | None) and len(text) <= LONGEST:
        return text
    return f"a {type(value).__name__}"
