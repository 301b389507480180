"""Sites: the geometry of a road section, the recorded windows, and where each value came from.

A site is a TOML file. The shipped ones lie in ``site_data``; a user's own is given by its path, no code is touched.
"""

import math
import re
import tomllib
from dataclasses import asdict, dataclass, fields
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal
from zoneinfo import ZoneInfo

import msgspec
import numpy as np
import tomli_w
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from rampcast.arguments import expected
from rampcast.errors import SiteError
from rampcast.file_values import LARGEST, Name, Number, Positive, close_name, converted, got
from rampcast.files import read_settings, write_whole
from rampcast.notebook import html_table

SITE_FOLDER = Path(__file__).parent / "data"
PAIR = re.compile(r"\[\s+([-+.\w]+),\s+([-+.\w]+),\s+\]")  # a point, which the writer spreads over four lines
NO_LANE = 0  # number of the lane of a vehicle that is in none of the site's lanes
LANE_WIDTH = 3.6  # [m] where no site or source tells it: a motorway's lanes are 3.5 to 3.75 m wide, 12 ft in the US
SAME_X, SAME_Y = 2.0, 1.0  # [m] by which one road may differ: half a car's length, a third of a lane's width
RAMP_VALUES = ("gore", "ramp_end", "merge_zone", "target_lane", "lane_line")  # a site without a ramp has none of them

Point = tuple[Number, Number]
Place = Annotated[float, msgspec.Meta(ge=-LARGEST)]  # a number, or infinity
MOST_LANE = 32_767  # the largest number of a lane that a recording has room for
Role = Literal["main", "ramp", "exit", "shoulder"]


@dataclass(frozen=True)
class Lane:
    """A lane: its number in the recording, its role, and the lateral position of its centre [m].

    `sources` are its names in the files of the source (lanelets, lanes of a net); none where vehicles are put into the
    lane whose centre is nearest.
    """

    number: Annotated[int, msgspec.Meta(ge=0, le=MOST_LANE)]
    role: Role
    centre: Number
    sources: tuple[str, ...] = ()


@dataclass(frozen=True)
class Window:
    """A recorded window: its name and its start and end as local wall-clock times."""

    name: Name
    start: str
    end: str


@dataclass(frozen=True)
class Note:
    """Something a reader of this site's numbers must know, with its source."""

    text: str
    source: str
    erratum: int | None = None


@dataclass(frozen=True)
class Site:
    """The geometry of a road section. Longitudinal values are x [m], lateral values y [m, grows to the left].

    A section without an on-ramp has no lane of role "ramp", and the defaults for the values that tell of the ramp: it
    can be read and checked, but there is no merge to forecast. A ramp lane that goes on beyond the section (an
    auxiliary lane) ends nobody's drive: its `ramp_end` is infinite, or lies beyond the length.
    """

    name: Name
    title: str
    simulated: bool
    length: Positive  # [m]
    speed_limit: Positive  # [m/s]
    lanes: Annotated[tuple[Lane, ...], msgspec.Meta(min_length=1)]
    gore: Number = math.nan  # x where the ramp lane begins to run beside the target lane [m]
    ramp_end: Place = math.inf  # x where the ramp lane ends: x_end of the paper [m]; infinite where it goes on
    merge_zone: Point = (math.nan, math.nan)  # [m, m]; NaN where not known
    target_lane: int = NO_LANE
    lane_line: tuple[Point, ...] = ()  # (x, y) of the line between ramp lane and target lane
    timezone: str = "UTC"
    location: str = ""  # the value of the portal's Location column
    windows: tuple[Window, ...] = ()
    notes: tuple[Note, ...] = ()
    reference: tuple[Point, ...] = ()  # points of the line y = 0 in the source's plane [m], downstream
    mirrored: bool = False  # whether the source's plane grows to the right where it should grow to the left

    def __eq__(self, other: object) -> bool:
        """Returns whether all values are the same; what is not known (NaN) is the same as what is not known."""
        return self._known() == other._known() if isinstance(other, Site) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._known())

    def _known(self) -> tuple[object, ...]:
        zone = tuple(None if math.isnan(one) else one for one in self.merge_zone)
        values = {"gore": None if math.isnan(self.gore) else self.gore, "merge_zone": zone}
        return tuple(values.get(one.name, getattr(self, one.name)) for one in fields(self))

    @property
    def ramp_lanes(self) -> tuple[int, ...]:
        """Returns the numbers of the lanes from which vehicles merge."""
        return tuple(lane.number for lane in self.lanes if lane.role == "ramp")

    def on_ramp(self, lane: Int[ArrayLike, "*shape"]) -> Bool[np.ndarray, "*shape"]:
        """Returns whether lanes of those numbers are ones from which vehicles merge."""
        return np.isin(lane, self.ramp_lanes, kind="sort")  # of few lanes sooner done than by a table

    @property
    def has_ramp(self) -> bool:
        """Returns whether vehicles merge from a ramp here."""
        return bool(self.ramp_lanes)

    @property
    def ramp_goes_on(self) -> bool:
        """Returns whether the ramp lane is still there where the section ends."""
        return self.has_ramp and self.ramp_end > self.length

    def lane_centre(self, number: int) -> float:
        """Returns the lateral position of a lane's centre [m]."""
        for lane in self.lanes:
            if lane.number == number:
                return lane.centre
        raise SiteError(f"site '{self.name}' has no lane {number}; it has {[lane.number for lane in self.lanes]}")

    def lane_line_y(self, x: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
        """Returns the lateral position [m] of the line between ramp lane and target lane at x [m]."""
        points = np.asarray(self.lane_line)
        return np.interp(x, points[:, 0], points[:, 1])

    def window_bounds(self) -> dict[str, tuple[int, int]]:
        """Returns start and end of each recorded window [ms since 1970, UTC]."""
        return {w.name: (self._milliseconds(w.start), self._milliseconds(w.end)) for w in self.windows}

    def _repr_html_(self) -> str:
        end = "goes on" if self.ramp_goes_on else f"ends at {self.ramp_end:g} m"
        ramp = f"gore at {self.gore:g} m, {end}, into lane {self.target_lane}"
        rows = {
            "name": self.name,
            "length": f"{self.length:g} m",
            "lanes": ", ".join(f"{lane.number} ({lane.role})" for lane in self.lanes),
            "ramp": ramp if self.has_ramp else "none",
            "windows": ", ".join(window.name for window in self.windows) or "none named",
        }
        return html_table(f"Site: {self.title}", rows)

    def _milliseconds(self, local: str) -> int:
        moment = datetime.fromisoformat(local).replace(tzinfo=ZoneInfo(self.timezone))
        return round(moment.timestamp() * 1000)


def site_names() -> list[str]:
    """Returns the names of the shipped sites."""
    return sorted(path.stem for path in SITE_FOLDER.glob("*.toml"))


def load_site(name: str | Path) -> Site:
    """Returns the site of that name, in capitals or not, or the one described by the TOML file at that path.

    Raises:
        SiteError: there is no such site, or its file lacks a value or has one of the wrong kind.
    """
    shipped = {known.casefold(): known for known in site_names()}.get(str(name).casefold(), name)
    path = Path(name) if str(name).endswith(".toml") else SITE_FOLDER / f"{shipped}.toml"
    if not path.is_file():
        raise SiteError(
            f"there is no site '{name}'{close_name(str(name), site_names()) or '.'} "
            f"Shipped sites: {', '.join(site_names())}; "
            "or give the path of a site file that ends in .toml (see docs/sites.md, 'A site of your own')"
        )
    try:
        return site_from_dict(tomllib.loads(read_settings(path)))
    except (ValueError, RecursionError) as error:  # also of bytes that are no text, numbers of 5000 digits
        raise SiteError(f"{path}: not a TOML file: {error}") from error
    except SiteError as error:
        raise SiteError(f"{path}: {error}") from error


def site_of(site: object) -> Site:
    """Returns a site that is given by itself, by its name, or by the path of its file.

    Raises:
        SiteError: as `load_site`, or it is something else.
    """
    if isinstance(site, str | Path):
        return load_site(site)
    return expected(Site, site, name="site", advice="or the name of a site, or the path of a site file")


def site_from_dict(values: dict[str, Any]) -> Site:
    """Returns the site that a site file's values describe.

    Raises:
        SiteError: a value is missing, unknown, or of the wrong kind.
    """
    try:
        site = converted(
            Site, values | {"lanes": _with_text_as_sources(values["lanes"])} if "lanes" in values else values
        )
    except ValueError as error:
        raise SiteError(str(error)) from error
    _check(site)
    return site


def site_to_dict(site: Site) -> dict[str, Any]:
    """Returns the values of a site file; the inverse of `site_from_dict`."""
    values = asdict(site)
    unknown = {"ramp_end": math.isinf(site.ramp_end), "merge_zone": math.isnan(site.merge_zone[0])}
    absent = [name for name in RAMP_VALUES if not site.has_ramp or unknown.get(name)]
    for lane in values["lanes"]:
        if not lane["sources"]:
            del lane["sources"]
    return {name: value for name, value in values.items() if name not in absent}


def differences(site: Site, other: Site) -> list[str]:
    """Returns in which places two sites are not the same road, as "gore 118.0 m and 122.0 m"; none if they are.

    Titles, notes and windows do not count, and values may differ by as much as a drawing of the road is wrong.
    """
    found = []
    for name in ("length", "gore", "ramp_end"):
        mine, its = getattr(site, name), getattr(other, name)
        if not (mine == its or abs(mine - its) <= SAME_X or (math.isnan(mine) and math.isnan(its))):
            found.append(f"{name} {mine:.1f} m and {its:.1f} m")
    if site.target_lane != other.target_lane:
        found.append(f"target_lane {site.target_lane} and {other.target_lane}")
    if site.ramp_lanes != other.ramp_lanes:
        found.append(f"ramp lanes {list(site.ramp_lanes)} and {list(other.ramp_lanes)}")
    lanes, others = ({lane.number: lane.centre for lane in one.lanes} for one in (site, other))
    if lanes.keys() != others.keys():
        found.append(f"lanes {list(lanes)} and {list(others)}")
    for number, centre in lanes.items():
        if number in others and abs(centre - others[number]) > SAME_Y:
            found.append(f"centre of lane {number} {centre:.2f} m and {others[number]:.2f} m")
    return found


def write_site(site: Site, path: Path) -> None:
    """Writes a site file, which `load_site` reads; whole or not at all."""
    values = site_to_dict(site)
    for note in values["notes"]:  # TOML has no way to say "nothing"
        if note["erratum"] is None:
            del note["erratum"]
    with write_whole(Path(path)) as partial:
        partial.write_text(PAIR.sub(r"[\1, \2]", tomli_w.dumps(values)), encoding="utf-8")


def _with_text_as_sources(lanes: Any) -> Any:
    """Returns the lanes with numbers among their sources as text: numbers are names as well."""
    if not isinstance(lanes, list | tuple):
        return lanes
    return [
        lane | {"sources": [str(one) if type(one) in (int, float) else one for one in lane["sources"]]}
        if isinstance(lane, dict) and isinstance(lane.get("sources"), list | tuple)
        else lane
        for lane in lanes
    ]


def _check(site: Site) -> None:
    numbers = [lane.number for lane in site.lanes]
    if twice := sorted({number for number in numbers if numbers.count(number) > 1}):
        raise SiteError(f"lanes: the number {twice[0]} is given to {numbers.count(twice[0])} lanes; give each its own")
    if len(site.reference) == 1:
        raise SiteError("reference needs two points [x, y] or more, in the order of travel")
    if site.has_ramp:
        _check_ramp(site, numbers)
    elif not all(_absent(site).values()):
        raise SiteError(f"no lane has the role 'ramp'; give it to one, or leave out {', '.join(RAMP_VALUES)}")
    try:
        site.window_bounds()
    except (ValueError, KeyError) as error:
        raise SiteError(f"a window's time or the time zone cannot be read: {error}") from error


def _absent(site: Site) -> dict[str, bool]:
    """Returns which of the values that tell of the ramp are not given."""
    return {
        "gore": math.isnan(site.gore),
        "ramp_end": math.isinf(site.ramp_end),
        "merge_zone": math.isnan(site.merge_zone[0]),
        "target_lane": site.target_lane == NO_LANE,
        "lane_line": not site.lane_line,
    }


def _check_ramp(site: Site, numbers: list[int]) -> None:
    may_be_absent = ("ramp_end", "merge_zone") if site.ramp_goes_on else ()
    for name, is_absent in _absent(site).items():
        if is_absent and name not in may_be_absent:
            raise SiteError(f"the value '{name}' is missing; a site with a ramp lane needs it")
    if site.merge_zone[0] > site.merge_zone[1]:
        raise SiteError(f"merge_zone: expected [from, to] with from before to, {got(list(site.merge_zone))}")
    if site.target_lane not in numbers or site.target_lane in site.ramp_lanes:
        others = [number for number in numbers if number not in site.ramp_lanes]
        raise SiteError(f"target_lane is {site.target_lane}, which is none of the lanes {others} beside the ramp")
    if not site.gore < min(site.ramp_end, site.length):
        raise SiteError(
            "expected gore < ramp_end and gore < length, got "
            f"gore = {site.gore}, ramp_end = {site.ramp_end}, length = {site.length}"
        )
    xs = [x for x, _ in site.lane_line]
    if xs != sorted(xs):
        raise SiteError(f"lane_line: expected points [x, y] in order of growing x, got x = {xs}")
