"""Mapping files: a TOML file that says which columns of a foreign table are what, in which units and axes.

The values of the file are described in docs/formats/plain.md; `load_mapping` checks every one of them.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any
from zoneinfo import ZoneInfo

import msgspec

from rampcast.errors import FormatError, SiteError
from rampcast.file_values import Name, Number, Positive, converted, got, not_one_of, refuse_unknown_keys
from rampcast.files import read_settings
from rampcast.formats.steps.units import FOOT, KILOMETRE_PER_HOUR, MILE_PER_HOUR
from rampcast.formats.steps.written_times import WRITTEN
from rampcast.recording import columns as c
from rampcast.sites import Site, load_site
from rampcast.sites.site import site_from_dict

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": FOOT}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "day": 86400.0}
SPEEDS = {"m/s": 1.0, "km/h": KILOMETRE_PER_HOUR, "mph": MILE_PER_HOUR, "ft/s": FOOT}
ACCELERATIONS = {"m/s2": 1.0, "ft/s2": FOOT, "g": 9.80665}  # standard gravity
ANGLES = {"rad": 1.0, "deg": math.pi / 180}
NORTH = {f"{unit} from north": value for unit, value in ANGLES.items()}  # clockwise, as a compass
DEGREES = {"deg": 1.0}
UNITS: Mapping[str, Mapping[str, float]] = {
    "recording": {},
    "vehicle": {},
    "frame": {},
    "time": TIMES,
    "x": LENGTHS,
    "y": LENGTHS,
    "latitude": DEGREES,
    "longitude": DEGREES,
    "heading": ANGLES | NORTH,
    "lane": {},
    "length": LENGTHS,
    "width": LENGTHS,
    "kind": {},
    "speed": SPEEDS,
    "acceleration": ACCELERATIONS,
}
TEXTS = ("recording", "vehicle", "kind")
LISTED = ("lane", "kind")  # what `values` can translate
NO_VEHICLE = "none"  # in `values` of kinds: rows of pedestrians and things, which are left out
PLACES = ("latitude", "longitude")
BY_KIND = ("length", "width")  # what a kind can tell where nobody measured it
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
Lane = Annotated[int, msgspec.Meta(ge=0, le=1000)]


@dataclass(frozen=True)
class _File:
    """The keys of a mapping file, as they stand in it."""

    columns: dict[str, Any] = field(default_factory=dict)
    vehicles: Annotated[tuple[dict[str, Any], ...], msgspec.Meta(min_length=1)] = ({},)
    name: str = ""
    title: str = ""
    site: str | dict[str, Any] | None = None
    simulated: bool = False
    time_step: Positive | None = None
    frame_rate: Positive | None = None
    reference: str = "front"
    plane: bool = False
    absent: Any = ()
    timezone: str = "UTC"
    separator: Annotated[str, msgspec.Meta(min_length=1, max_length=1)] | None = None
    decimal: str = ""
    meridian: Annotated[float, msgspec.Meta(ge=-180, le=180)] | None = None


@dataclass(frozen=True)
class _EntryTable:
    """The keys of an entry that is a table."""

    column: Name = ""
    constant: Any = None
    unit: str | Number | None = None
    flip: bool = False
    plus: Number = 0.0
    values: dict[str, str | int] = field(default_factory=dict)
    by_kind: dict[str, Positive] = field(default_factory=dict)


KEYS, ENTRY_KEYS = (tuple(one.name for one in fields(kind)) for kind in (_File, _EntryTable))


@dataclass(frozen=True)
class Entry:
    """Where a value comes from: (+-column + plus) * factor in SI, or a constant in SI.

    Attributes:
        column: of the file; "" for a constant.
        constant: the value of every row; None for a column.
        factor: SI units in one unit of the column, below zero where the column's axis is turned.
        plus: added to the column, in its unit and after turning.
        values: what the words or numbers of the column mean; {} leaves them as they are.
        by_kind: values in SI of the kinds of vehicles, where nothing else tells them.
        written: how a time is written, as `seconds_written` takes it; "" where it is a number.
    """

    column: str = ""
    constant: float | int | str | None = None
    factor: float = 1.0
    plus: float = 0.0
    values: Mapping[str, str] = field(default_factory=dict)
    by_kind: Mapping[str, float] = field(default_factory=dict)
    written: str = ""


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
        timezone: of times that are written without one.
        separator: between two columns of a csv; "" tells it by the content.
        decimal: sign of a csv's numbers, "." or ","; "" tells it by the content.
        meridian: of the plane that latitude and longitude are put into [degrees]; None takes the nearest.
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
    timezone: str = "UTC"
    separator: str = ""
    decimal: str = ""
    meridian: float | None = None

    @property
    def on_earth(self) -> bool:
        """Returns whether places are degrees of latitude and longitude."""
        return "latitude" in self.vehicles[0]

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
        values = tomllib.loads(read_settings(path))
    except OSError as error:
        raise FormatError(f"{path}: the mapping cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:  # also of bytes that are no text, numbers of 5000 digits
        raise FormatError(f"{path}: not a TOML file: {error}. Mend it; see docs/formats/plain.md") from error
    try:
        return _mapping(path, values)
    except ValueError as error:
        raise FormatError(f"{path}: {str(error)[:LONGEST_MESSAGE]}. See docs/formats/plain.md") from error


def _mapping(path: Path, values: dict[str, Any]) -> TableMapping:
    file: _File = converted(_File, values)
    shared = _entries("columns", file.columns)
    vehicles = tuple(
        shared | _entries(f"vehicles[{number}]", block) for number, block in enumerate(file.vehicles, start=1)
    )
    for entries in vehicles:
        _check_entries(entries, file)
    if file.reference not in REFERENCES:
        raise ValueError(not_one_of(REFERENCES, file.reference, place="reference"))
    if file.decimal not in ("", ".", ","):
        raise ValueError(not_one_of((".", ","), file.decimal, place="decimal"))
    if file.time_step and file.frame_rate:
        raise ValueError("time_step and frame_rate say the same; leave one out")
    absent = file.absent if isinstance(file.absent, list | tuple) else [file.absent]
    name = file.name or path.stem
    return TableMapping(
        path=str(path),
        vehicles=vehicles,
        name=name,
        title=file.title or name,
        site=_site(path, file.site),
        simulated=file.simulated,
        time_step=1 / file.frame_rate if file.frame_rate else file.time_step,
        reference=file.reference,
        plane=file.plane or "latitude" in vehicles[0],
        absent=tuple(map(str, absent)),
        timezone=_timezone(file.timezone),
        separator=file.separator or "",
        decimal=file.decimal,
        meridian=file.meridian,
    )


def _check_entries(entries: Mapping[str, Entry], file: _File) -> None:
    advice = "name its column under [columns], or under every [[vehicles]]"
    given = [name for name in PLACES if name in entries]
    if given and (len(given) == 1 or {"x", "y"} & set(entries)):
        raise ValueError("places are latitude and longitude, both, or x and y: give one pair of columns")
    for name in ("vehicle", given[0] if given else "x"):
        if name not in entries:
            raise ValueError(f"'{name}' is missing; {advice}")
    if not {"frame", "time"} & set(entries):
        raise ValueError(f"'frame' or 'time' is missing; {advice}")
    if not {"y", "lane", *PLACES} & set(entries):
        raise ValueError(f"'y' or 'lane' is missing; {advice}, or give a constant lane (lane = 1)")
    if "time" not in entries and not (file.time_step or file.frame_rate):
        raise ValueError("'time_step' is missing: without a column of times, say how long a frame is (time_step = 0.1)")
    for name in ("x", "frame", "time", *PLACES):
        if name in entries and not entries[name].column:
            raise ValueError(f"{name} cannot be a constant: name its column")


def _entries(place: str, values: Mapping[str, Any]) -> dict[str, Entry]:
    refuse_unknown_keys(values, UNITS, place=place)
    return {name: _entry(f"{place}.{name}", name, value) for name, value in values.items()}


def _entry(place: str, name: str, value: Any) -> Entry:
    if isinstance(value, str):
        value = {"column": value}
    elif isinstance(value, int | float) and not isinstance(value, bool):
        value = {"constant": value}
    table: _EntryTable = converted(_EntryTable, value, place=place)
    if "by_kind" in value:
        return _entry_by_kind(place, name, value, table)
    if ("column" in value) == ("constant" in value):
        raise ValueError(f"{place}: expected a column or a constant, got {'both' if 'column' in value else 'none'}")
    if "constant" in value:
        if len(value) > 1:
            raise ValueError(f"{place}: a constant is in SI units and has no other keys")
        return Entry(constant=_constant(place, name, table.constant))
    return _column_entry(place, name, table)


def _column_entry(place: str, name: str, table: _EntryTable) -> Entry:
    if name not in LISTED and table.values:
        raise ValueError(f"{place}.values: only lanes and kinds can be listed")
    if not UNITS[name] and name != "frame" and (table.flip or table.plus):
        raise ValueError(f"{place}: flip and plus are for numbers")
    is_written = name == "time" and isinstance(table.unit, str) and (table.unit in WRITTEN or "%" in table.unit)
    is_compass = name == "heading" and table.unit in NORTH
    if (is_written or is_compass) and (table.flip or table.plus):
        raise ValueError(f"{place}: the unit '{table.unit}' says how it runs; leave out flip and plus")
    if is_written:
        return Entry(table.column, written=str(table.unit))
    if is_compass:
        factor = NORTH[str(table.unit)]
        return Entry(table.column, None, -factor, math.pi / 2 / factor)
    factor = _factor(f"{place}.unit", name, table.unit)
    listed = {
        key: NO_VEHICLE if name == "kind" and one == NO_VEHICLE else str(_constant(f"{place}.values.{key}", name, one))
        for key, one in table.values.items()
    }
    return Entry(table.column, None, -factor if table.flip else factor, table.plus, listed)


def _entry_by_kind(place: str, name: str, value: Mapping[str, Any], table: _EntryTable) -> Entry:
    """Returns an entry of sizes that kinds tell, and a column where it is not empty."""
    if name not in BY_KIND:
        raise ValueError(f"{place}.by_kind: only {' and '.join(BY_KIND)} can be told by the kind")
    for kind in table.by_kind:
        if kind not in c.KINDS:
            raise ValueError(not_one_of(c.KINDS, kind, place=f"{place}.by_kind"))
    rest = {key: one for key, one in value.items() if key != "by_kind"}
    entry = _entry(place, name, rest) if rest else Entry()
    return replace(entry, by_kind=table.by_kind)


def _constant(place: str, name: str, value: Any) -> float | int | str:
    if name == "kind" and value not in c.KINDS:
        raise ValueError(not_one_of(c.KINDS, value, place=place))
    if name in TEXTS:
        return str(value)
    return converted(Lane if name == "lane" else Number, value, place=place)


def _factor(place: str, name: str, unit: str | float | None) -> float:
    if unit is None:
        return 1.0
    if not UNITS[name]:
        raise ValueError(f"{place}: {name} has no unit")
    if isinstance(unit, str):
        if unit not in UNITS[name]:
            raise ValueError(f"{not_one_of(UNITS[name], unit, place=place)}; a number is a unit of its own")
        return UNITS[name][unit]
    return float(unit)


def _timezone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (ValueError, OSError) as error:  # ZoneInfoNotFoundError is a KeyError, which is none of these
        raise ValueError(f"timezone: expected a name as Europe/Berlin, {got(name)}") from error
    except KeyError as error:
        raise ValueError(f"timezone: there is none called '{name[:40]}'; expected a name as Europe/Berlin") from error
    return name


def _site(path: Path, value: str | dict[str, Any] | None) -> Site | None:
    if value is None:
        return None
    try:
        if isinstance(value, str):
            return load_site(path.parent / value if value.endswith(".toml") else value)
        return site_from_dict(value)
    except SiteError as error:
        raise SiteError(f"{path}, site: {error}. See docs/sites.md") from error
