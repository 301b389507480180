"""The values of a site file: which keys there are, and of which kind each value must be. The first fault is named."""

import difflib
import math
import re
from collections.abc import Callable, Collection, Mapping
from typing import Any

from rampcast.errors import SiteError

ROLES = ("main", "ramp", "exit", "shoulder")
LONGEST = 60  # characters of a value that a message shows
MOST_NAMES, LONGEST_NAME = 200, 60  # that are compared with one that is not known
Check = Callable[[str, Any], None]


def check_site_values(values: Mapping[str, Any]) -> None:
    """Checks the values of a site file one by one.

    Raises:
        SiteError: a value is missing, unknown, or of the wrong kind; the message names it.
    """
    _check_table("", values, SITE_KEYS, needed=("lanes", "name", "title", "simulated", "length", "speed_limit"))
    numbers = [lane["number"] for lane in values["lanes"]]
    twice = sorted({number for number in numbers if numbers.count(number) > 1})
    if twice:
        raise SiteError(f"lanes: the number {twice[0]} is given to {numbers.count(twice[0])} lanes; give each its own")


def close_name(name: str, known: Collection[str]) -> str:
    """Returns a question that names the most similar of the known names, or nothing where none is similar."""
    lower = {one.lower(): one for one in list(known)[:MOST_NAMES] if len(one) <= LONGEST_NAME}  # comparing takes long
    found = difflib.get_close_matches(name.lower(), lower, n=1)
    return f"; is '{lower[found[0]]}' meant?" if found else ""


def _check_table(place: str, values: Any, keys: Mapping[str, Check], *, needed: Collection[str]) -> None:
    """Checks a table of the file: `place` is where it is, as "lanes[2]", or nothing for the file itself."""
    if not isinstance(values, Mapping):
        raise SiteError(
            f"{place}: expected a table {{ {', '.join(f'{key} = ...' for key in needed)} }}, {_got(values)}"
        )
    of = f" of {place}" if place else ""
    for key in values:
        if key not in keys:
            hint = close_name(str(key), keys) or f"; known are {', '.join(keys)}"
            raise SiteError(f"there is no value '{str(key)[:LONGEST]}'{of}{hint}")
    for key in needed:
        if key not in values:
            raise SiteError(f"the value '{key}'{of} is missing")
    for key, value in values.items():
        keys[key](f"{place}.{key}" if place else key, value)


def _got(value: Any) -> str:
    """Returns a value as the file spells it, cut to a length that can be read."""
    if isinstance(value, bool):
        return f"got {str(value).lower()}"
    shown = re.sub(r"^'(.*)'$", r'"\1"', repr(value))
    return f"got {shown if len(shown) <= LONGEST else shown[:LONGEST] + '...'}"


def _text(place: str, value: Any) -> None:
    if not isinstance(value, str):
        raise SiteError(f"{place}: expected text, {_got(value)}")


def _name(place: str, value: Any) -> None:
    _text(place, value)
    if not value.strip():
        raise SiteError(f"{place}: expected text, got none")


def _truth(place: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise SiteError(f"{place}: expected true or false, without quotation marks, {_got(value)}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(place: str, value: Any) -> None:
    if not _is_number(value):
        raise SiteError(f"{place}: expected a number, {_got(value)}")


def _positive(place: str, value: Any) -> None:
    if not _is_number(value) or value <= 0:
        raise SiteError(f"{place}: expected a number above 0, {_got(value)}")


def _whole(place: str, value: Any) -> None:
    if not isinstance(value, int) or isinstance(value, bool):
        raise SiteError(f"{place}: expected a whole number, without quotation marks, {_got(value)}")


def _erratum(place: str, value: Any) -> None:
    if value is not None:  # as a recording's file says that there is none
        _whole(place, value)


def _role(place: str, value: Any) -> None:
    if value not in ROLES:
        hint = close_name(str(value), ROLES)
        raise SiteError(f"{place}: expected one of {', '.join(ROLES)}, {_got(value)}{hint}")


def _list(place: str, value: Any) -> None:
    if not isinstance(value, list | tuple):
        raise SiteError(f"{place}: expected a list, {_got(value)}")


def _texts(place: str, value: Any) -> None:
    _list(place, value)
    for number, one in enumerate(value, start=1):
        if not isinstance(one, str | int | float) or isinstance(one, bool):  # numbers are names as well
            raise SiteError(f"{place}[{number}]: expected a name, {_got(one)}")


def _zone(place: str, value: Any) -> None:
    _pair(place, value, "[from, to]")
    if not value[0] <= value[1]:
        raise SiteError(f"{place}: expected [from, to] with from before to, {_got(list(value))}")


def _pair(place: str, value: Any, what: str) -> None:
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(map(_is_number, value)):
        raise SiteError(f"{place}: expected two numbers {what}, {_got(value)}")


def _points(place: str, value: Any) -> None:
    _list(place, value)
    for number, point in enumerate(value, start=1):
        _pair(f"{place}[{number}]", point, "[x, y]")


def _tables(keys: Mapping[str, Check], needed: Collection[str]) -> Check:
    def check(place: str, value: Any) -> None:
        _list(place, value)
        for number, one in enumerate(value, start=1):
            _check_table(f"{place}[{number}]", one, keys, needed=needed)

    return check


def _lanes(place: str, value: Any) -> None:
    _tables(LANE_KEYS, ("number", "role", "centre"))(place, value)
    if not value:
        raise SiteError("lanes: expected one lane or more, got none")


LANE_KEYS: Mapping[str, Check] = {"number": _whole, "role": _role, "centre": _number, "sources": _texts}
WINDOW_KEYS: Mapping[str, Check] = {"name": _name, "start": _text, "end": _text}
NOTE_KEYS: Mapping[str, Check] = {"text": _text, "source": _text, "erratum": _erratum}
SITE_KEYS: Mapping[str, Check] = {
    "name": _name,
    "title": _text,
    "simulated": _truth,
    "location": _text,
    "timezone": _text,
    "length": _positive,
    "speed_limit": _positive,
    "gore": _number,
    "ramp_end": _number,
    "merge_zone": _zone,
    "target_lane": _whole,
    "lane_line": _points,
    "reference": _points,
    "mirrored": _truth,
    "lanes": _lanes,
    "windows": _tables(WINDOW_KEYS, ("name", "start", "end")),
    "notes": _tables(NOTE_KEYS, ("text", "source")),
}
