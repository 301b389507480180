"""Mapping files: a TOML file that says which columns of a foreign table are what, in which units and axes.

The values of the file are described in docs/formats/plain.md; `load_mapping` checks every one of them.
"""

import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rampcast.errors import FormatError, SiteError
from rampcast.file_values import close_name
from rampcast.formats.steps.units import FOOT, KILOMETRE_PER_HOUR, MILE_PER_HOUR
from rampcast.recording import columns as c
from rampcast.sites import Site, load_site
from rampcast.sites.site import site_from_dict

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": FOOT}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SPEEDS = {"m/s": 1.0, "km/h": KILOMETRE_PER_HOUR, "mph": MILE_PER_HOUR, "ft/s": FOOT}
ACCELERATIONS = {"m/s2": 1.0, "ft/s2": FOOT, "g": 9.80665}  # standard gravity
ANGLES = {"rad": 1.0, "deg": math.pi / 180}
UNITS: Mapping[str, Mapping[str, float]] = {
    "recording": {},
    "vehicle": {},
    "frame": {},
    "time": TIMES,
    "x": LENGTHS,
    "y": LENGTHS,
    "heading": ANGLES,
    "lane": {},
    "length": LENGTHS,
    "width": LENGTHS,
    "kind": {},
    "speed": SPEEDS,
    "acceleration": ACCELERATIONS,
}
TEXTS = ("recording", "vehicle", "kind")
LISTED = ("lane", "kind")  # what `values` can translate
# How far the front centre lies from the position: lengths ahead, widths to the left.
REFERENCES: Mapping[str, tuple[float, float]] = {
    "front": (0.0, 0.0),
    "centre": (0.5, 0.0),
    "rear": (1.0, 0.0),
    "front left": (0.0, -0.5),
    "front right": (0.0, 0.5),
    "rear left": (1.0, -0.5),
    "rear right": (1.0, 0.5),
}
LONGEST_MESSAGE = 1000  # letters: what a mapping holds may be of any length
KEYS = (
    "name",
    "title",
    "site",
    "simulated",
    "time_step",
    "frame_rate",
    "reference",
    "plane",
    "absent",
    "columns",
    "vehicles",
)
ENTRY_KEYS = ("column", "constant", "unit", "flip", "plus", "values")


@dataclass(frozen=True)
class Entry:
    """Where a value comes from: (+-column + plus) * factor in SI, or a constant in SI.

    Attributes:
        column: of the file; "" for a constant.
        constant: the value of every row; None for a column.
        factor: SI units in one unit of the column, below zero where the column's axis is turned.
        plus: added to the column, in its unit and after turning.
        values: what the words or numbers of the column mean; {} leaves them as they are.
    """

    column: str = ""
    constant: float | int | str | None = None
    factor: float = 1.0
    plus: float = 0.0
    values: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TableMapping:
    """What a table's columns mean.

    Attributes:
        path: of the mapping file, for messages; "" for rampcast's own form.
        vehicles: the entries by their names, one mapping for each vehicle of a row.
        name, title: of the place, where there is no site.
        site: of the place; None leaves it to the caller or to the table.
        simulated: whether no vehicle of it ever existed.
        time_step: time between two frames [s]; None tells it from the times.
        reference: which point of a vehicle the positions are, one of `REFERENCES`.
        plane: whether x and y are in a plane, as a map's; else x is along the road and y to its left.
        absent: ids that stand for no vehicle.
    """

    path: str
    vehicles: tuple[Mapping[str, Entry], ...]
    name: str = ""
    title: str = ""
    site: Site | None = None
    simulated: bool = False
    time_step: float | None = None
    reference: str = "front"
    plane: bool = False
    absent: tuple[str, ...] = ()

    @property
    def columns(self) -> dict[str, str]:
        """Returns the columns of the file that are used, each with the first entry that uses it."""
        found: dict[str, str] = {}
        for entries in self.vehicles:
            for name, entry in entries.items():
                if entry.column:
                    found.setdefault(entry.column, name)
        return found


def load_mapping(path: Path) -> TableMapping:
    """Returns the mapping in a TOML file.

    Raises:
        FormatError: the file is not there, no TOML, or a value of it is missing, unknown or of the wrong kind.
        SiteError: the site that it names is not there or not as it should be.
    """
    path = Path(path)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FormatError(f"{path}: the mapping cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:  # also of bytes that are no text, numbers of 5000 digits
        raise FormatError(f"{path}: not a TOML file: {error}. Mend it; see docs/formats/plain.md") from error
    try:
        return _mapping(path, values)
    except ValueError as error:
        raise FormatError(f"{path}: {str(error)[:LONGEST_MESSAGE]}. See docs/formats/plain.md") from error


def _mapping(path: Path, values: dict[str, Any]) -> TableMapping:
    _check_keys("", values, KEYS)
    shared = _entries("columns", _table("columns", values.get("columns", {})))
    blocks = values.get("vehicles", [{}])
    if not isinstance(blocks, list) or not blocks:
        raise ValueError("vehicles: expected one [[vehicles]] table or more, one for each vehicle of a row")
    vehicles = tuple(
        shared | _entries(f"vehicles[{number}]", _table("vehicles", block))
        for number, block in enumerate(blocks, start=1)
    )
    for entries in vehicles:
        _check_entries(entries, values)
    reference = values.get("reference", "front")
    if reference not in REFERENCES:
        raise ValueError(f"reference: expected one of {', '.join(REFERENCES)}, found {reference!r}")
    absent = values.get("absent", [])
    return TableMapping(
        path=str(path),
        vehicles=vehicles,
        name=_text("name", values, path.stem),
        title=_text("title", values, _text("name", values, path.stem)),
        site=_site(path, values.get("site")),
        simulated=_flag("simulated", values),
        time_step=_time_step(values),
        reference=reference,
        plane=_flag("plane", values),
        absent=tuple(str(one) for one in (absent if isinstance(absent, list) else [absent])),
    )


def _check_keys(place: str, values: Mapping[str, Any], known: Collection[str]) -> None:
    for key in values:
        if key not in known:
            where = f"{place}: " if place else ""
            raise ValueError(f"{where}there is no key '{key}'{close_name(key, known)} Known keys: {', '.join(known)}")


def _check_entries(entries: Mapping[str, Entry], values: Mapping[str, Any]) -> None:
    advice = "name its column under [columns], or under every [[vehicles]]"
    for name in ("vehicle", "x"):
        if name not in entries:
            raise ValueError(f"'{name}' is missing; {advice}")
    if not {"frame", "time"} & set(entries):
        raise ValueError(f"'frame' or 'time' is missing; {advice}")
    if not {"y", "lane"} & set(entries):
        raise ValueError(f"'y' or 'lane' is missing; {advice}, or give a constant lane (lane = 1)")
    if "time" not in entries and not {"time_step", "frame_rate"} & set(values):
        raise ValueError("'time_step' is missing: without a column of times, say how long a frame is (time_step = 0.1)")
    for name in ("x", "frame", "time"):
        if name in entries and not entries[name].column:
            raise ValueError(f"{name} cannot be a constant: name its column")


def _entries(place: str, values: Mapping[str, Any]) -> dict[str, Entry]:
    _check_keys(place, values, UNITS)
    return {name: _entry(f"{place}.{name}", name, value) for name, value in values.items()}


def _entry(place: str, name: str, value: Any) -> Entry:
    if value == "" or (isinstance(value, dict) and value.get("column") == ""):
        raise ValueError(f"{place}: expected the name of a column, found ''")
    if isinstance(value, str):
        return Entry(column=value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Entry(constant=_constant(place, name, value))
    values = _table(place, value)
    _check_keys(place, values, ENTRY_KEYS)
    if ("column" in values) == ("constant" in values):
        raise ValueError(f"{place}: expected a column or a constant, found {'both' if 'column' in values else 'none'}")
    if "constant" in values:
        if len(values) > 1:
            raise ValueError(f"{place}: a constant is in SI units and has no other keys")
        return Entry(constant=_constant(place, name, values["constant"]))
    is_turned = _flag("flip", values, place)
    factor = _factor(place, name, values.get("unit"))
    plus = _number(f"{place}.plus", values.get("plus", 0.0))
    if name not in LISTED and "values" in values:
        raise ValueError(f"{place}.values: only lanes and kinds can be listed")
    if not UNITS[name] and name != "frame" and (is_turned or plus):
        raise ValueError(f"{place}: flip and plus are for numbers")
    listed = _listed(place, name, _table(f"{place}.values", values.get("values", {})))
    return Entry(_text("column", values, "", place), None, -factor if is_turned else factor, plus, listed)


def _constant(place: str, name: str, value: Any) -> float | int | str:
    if name == "kind":
        if value not in c.KINDS:
            raise ValueError(f"{place}: expected one of {', '.join(c.KINDS)}, found {value!r}")
        return str(value)
    if name in ("recording", "vehicle"):
        return str(value)
    if name == "lane":
        return _whole(place, value)
    return _number(place, value)


def _factor(place: str, name: str, unit: Any) -> float:
    if unit is None:
        return 1.0
    if isinstance(unit, int | float) and not isinstance(unit, bool) and UNITS[name]:
        return _number(f"{place}.unit", unit)
    if not UNITS[name]:
        raise ValueError(f"{place}.unit: {name} has no unit")
    if unit not in UNITS[name]:
        raise ValueError(f"{place}.unit: expected one of {', '.join(UNITS[name])}, or a number, found {unit!r}")
    return UNITS[name][unit]


def _listed(place: str, name: str, values: Mapping[str, Any]) -> dict[str, str]:
    if name == "kind":
        for key, value in values.items():
            if value not in c.KINDS:
                raise ValueError(f"{place}.values.{key}: expected one of {', '.join(c.KINDS)}, found {value!r}")
        return {key: str(value) for key, value in values.items()}
    return {key: str(_whole(f"{place}.values.{key}", value)) for key, value in values.items()}


def _time_step(values: Mapping[str, Any]) -> float | None:
    if "time_step" in values and "frame_rate" in values:
        raise ValueError("time_step and frame_rate say the same; leave one out")
    if "frame_rate" in values:
        return 1 / _positive("frame_rate", values["frame_rate"])
    return _positive("time_step", values["time_step"]) if "time_step" in values else None


def _site(path: Path, value: Any) -> Site | None:
    if value is None:
        return None
    try:
        if isinstance(value, str):
            return load_site(path.parent / value if value.endswith(".toml") else value)
        return site_from_dict(_table("site", value))
    except SiteError as error:
        raise SiteError(f"{path}, site: {error}. See docs/sites.md") from error


def _table(place: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{place}: expected a table of keys and values, found {value!r}")
    return value


def _text(key: str, values: Mapping[str, Any], default: str, place: str = "") -> str:
    value = values.get(key, default)
    if not isinstance(value, str):
        raise ValueError(f"{place}{'.' if place else ''}{key}: expected text, found {value!r}")
    return value


def _flag(key: str, values: Mapping[str, Any], place: str = "") -> bool:
    value = values.get(key, False)
    if not isinstance(value, bool):
        raise ValueError(f"{place}{'.' if place else ''}{key}: expected true or false, found {value!r}")
    return value


def _number(place: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{place}: expected a number, found {value!r}")
    return float(value)


def _whole(place: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 1000:
        raise ValueError(f"{place}: expected a lane, a whole number from 0 to 1000, found {value!r}")
    return value


def _positive(place: str, value: Any) -> float:
    number = _number(place, value)
    if number <= 0:
        raise ValueError(f"{place}: expected a number above 0, found {value!r}")
    return number
