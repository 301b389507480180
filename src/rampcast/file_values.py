"""The values of a file that a person wrote, as a dataclass: msgspec converts them, and the first fault is named.

A message says where the value stands ("lanes[2].centre", counted from 1), what was expected there, and what came.
"""

import difflib
import re
from collections.abc import Collection, Mapping
from typing import Annotated, Any

import msgspec
from msgspec.inspect import DataclassType, LiteralType, TupleType, Type, VarTupleType, type_info

LONGEST = 60  # characters of a value that a message shows
MOST_NAMES, LONGEST_NAME = 200, 60  # that are compared with one that is not known
LARGEST = 1e12  # no value of a file is larger; it also keeps out infinity and what is not a number
Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST)]
Name = Annotated[str, msgspec.Meta(pattern=r"\S")]
WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table of keys and values",
}
UNQUOTED = {"float", "int", "bool"}
LIMITS = {">": "above", ">=": "of at least", "<": "below", "<=": "of at most"}


def converted(kind: Any, values: Any, *, place: str = "") -> Any:
    """Returns the values as a dataclass, or a single value as what it should be.

    Args:
        kind: what is expected, as the annotations of the dataclass say.
        values: as they were read.
        place: where in the file they stand; "" for the file itself.

    Raises:
        ValueError: a value is missing, unknown, or not of its kind; the message names it.
    """
    _refuse_unknown(type_info(kind), values, place)
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        what, _, path = str(error).partition(" - at `$")
        raise ValueError(_told(what, *_at(path, type_info(kind), values, place))) from error


UNIT_WORDS = frozenset(
    [
        "m",
        "cm",
        "mm",
        "km",
        "ft",
        "feet",
        "foot",
        "inch",
        "mi",
        "mile",
        "miles",
        "s",
        "ms",
        "us",
        "ns",
        "sec",
        "min",
        "h",
        "kmh",
        "kph",
        "mph",
        "fps",
        "mps",
        "deg",
        "degrees",
        "rad",
        "pixel",
        "px",
    ]
)


def close_name(name: str, known: Collection[str]) -> str:
    """Returns a question that names the most similar of the known names, or nothing where none is similar."""
    lower = {one.lower(): one for one in list(known)[:MOST_NAMES] if len(one) <= LONGEST_NAME}  # comparing takes long
    found = difflib.get_close_matches(name.lower(), lower, n=1)
    return f"; is '{lower[found[0]]}' meant?" if found else ""


def close_column(name: str, columns: Collection[str], *, needed: Collection[str]) -> str:
    """Returns the column of a table that is most like a missing one, "" where none is: none that is needed as itself.

    A column in another unit is not meant either, as `speed_kmh` for `speed`: to rename it would not convert it.

    Args:
        name: of the column that is missing.
        columns: of the table.
        needed: names that have a meaning of their own.
    """
    own = {one.lower() for one in needed}
    known = [one for one in list(columns)[:MOST_NAMES] if len(one) <= LONGEST_NAME and one.lower() not in own]
    known = [one for one in known if _units_in(one) <= _units_in(name)]
    found = difflib.get_close_matches(name.lower(), [one.lower() for one in known], n=1)
    return next((one for one in known if found and one.lower() == found[0]), "")


def _units_in(name: str) -> set[str]:
    return set(re.split(r"[^a-z]+", name.lower())) & UNIT_WORDS


def refuse_unknown_keys(values: Collection[str], known: Collection[str], *, place: str = "") -> None:
    """Refuses a key that is not known, with the question whether a similar one is meant.

    Raises:
        ValueError: there is one.
    """
    for key in values:
        if key not in known:
            of = f" of {place}" if place else ""
            hint = close_name(str(key), known) or f"; known are {', '.join(known)}"
            raise ValueError(f"there is no value '{str(key)[:LONGEST]}'{of}{hint}")


def not_one_of(known: Collection[Any], value: Any, *, place: str) -> str:
    """Returns the message of a value that is none of those that are known."""
    names = [str(one) for one in known]
    return f"{place}: expected one of {', '.join(names)}, {got(value)}{close_name(str(value), names)}"


def got(value: Any) -> str:
    """Returns "got" and a value as the file spells it, cut to a length that can be read."""
    shown = str(value).lower() if isinstance(value, bool) else re.sub(r"^'(.*)'$", r'"\1"', repr(value))
    return f"got {shown if len(shown) <= LONGEST else shown[:LONGEST] + '...'}"


def _refuse_unknown(kind: Type, values: Any, place: str) -> None:
    if isinstance(kind, DataclassType) and isinstance(values, Mapping):
        fields = {field.name: field.type for field in kind.fields}
        refuse_unknown_keys(values, fields, place=place)
        for key, value in values.items():
            _refuse_unknown(fields[key], value, f"{place}.{key}" if place else key)
    if isinstance(kind, VarTupleType) and isinstance(values, list | tuple):
        for number, value in enumerate(values, start=1):
            _refuse_unknown(kind.item_type, value, f"{place}[{number}]")


def _at(path: str, kind: Type, value: Any, place: str) -> tuple[str, Type, Any]:
    """Returns what stands at a path of msgspec's, as ".lanes[0].centre": the place, what is expected, and what came."""
    for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", path):
        value = value[key or int(index)]
        place = f"{place}[{int(index) + 1}]" if index else f"{place}.{key}" if place else key
        if isinstance(kind, DataclassType):
            kind = next(field.type for field in kind.fields if field.name == key)
        elif isinstance(kind, VarTupleType):
            kind = kind.item_type
        elif isinstance(kind, TupleType):
            kind = kind.item_types[int(index)]
    return place, kind, value


def _told(what: str, place: str, kind: Type, value: Any) -> str:
    """Returns a message of msgspec's in the words of this program."""
    if missing := re.match(r"Object missing required field `(\w+)`", what):
        return f"the value '{missing[1]}'{f' of {place}' if place else ''} is missing"
    if isinstance(kind, LiteralType):
        return not_one_of(kind.values, value, place=place)
    if isinstance(kind, DataclassType):
        needed = ", ".join(f"{field.name} = ..." for field in kind.fields if field.required)
        return f"{place}: expected a table {f'{{ {needed} }}' if needed else 'of keys and values'}, {got(value)}"
    expected, limit = re.findall(r"Expected `([^`]*)`( (?:of length )?[<>=]* ?[-+.e\d]+)?", what)[0]
    names = [name for name in expected.split(" | ") if name != "null"]
    words = " or ".join(WORDS.get(name, name) for name in names)
    hint = ", without quotation marks" if isinstance(value, str) and UNQUOTED & set(names) else ""
    return f"{place}: expected {words}{_limit(limit)}{hint}, {got(value)}"


def _limit(limit: str) -> str:
    for sign, word in LIMITS.items():
        limit = limit.replace(f" {sign} ", f" {word} ")
    return re.sub(r"\.0$", "", limit)
