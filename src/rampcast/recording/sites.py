"""Sites: the geometry of a road section, the recorded windows, and where each value came from.

A site is a TOML file. The shipped ones lie in ``site_data``; a user's own is given by its path, no code is touched.
"""

import tomllib
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
from jaxtyping import Float

from rampcast.errors import SiteError

SITE_FOLDER = Path(__file__).parent / "site_data"


@dataclass(frozen=True)
class Lane:
    """A lane: its number in the recording, its role, and the lateral position of its centre [m]."""

    number: int
    role: str  # "main", "ramp", "exit" or "shoulder"
    centre: float


@dataclass(frozen=True)
class Window:
    """A recorded window: its name and its start and end as local wall-clock times."""

    name: str
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
    """The geometry of an on-ramp section. Longitudinal values are x [m], lateral values y [m, grows to the left]."""

    name: str
    title: str
    simulated: bool
    length: float  # [m]
    speed_limit: float  # [m/s]
    gore: float  # x where the ramp lane begins to run beside the target lane [m]
    ramp_end: float  # x where the ramp lane ends: x_end of the paper [m]
    merge_zone: tuple[float, float]  # [m, m]
    target_lane: int
    lane_line: tuple[tuple[float, float], ...]  # (x, y) of the line between ramp lane and target lane
    lanes: tuple[Lane, ...]
    timezone: str = "UTC"
    location: str = ""  # the value of the portal's Location column
    windows: tuple[Window, ...] = ()
    notes: tuple[Note, ...] = field(default=())

    @property
    def ramp_lanes(self) -> tuple[int, ...]:
        """Returns the numbers of the lanes from which vehicles merge."""
        return tuple(lane.number for lane in self.lanes if lane.role == "ramp")

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

    def _milliseconds(self, local: str) -> int:
        moment = datetime.fromisoformat(local).replace(tzinfo=ZoneInfo(self.timezone))
        return round(moment.timestamp() * 1000)


def site_names() -> list[str]:
    """Returns the names of the shipped sites."""
    return sorted(path.stem for path in SITE_FOLDER.glob("*.toml"))


def load_site(name: str | Path) -> Site:
    """Returns the site of that name, or the one described by the TOML file at that path.

    Raises:
        SiteError: there is no such site, or its file lacks a value or has one of the wrong kind.
    """
    path = Path(name) if str(name).endswith(".toml") else SITE_FOLDER / f"{name}.toml"
    if not path.is_file():
        raise SiteError(
            f"there is no site '{name}'. Shipped sites: {', '.join(site_names())}; "
            "or give the path of a site file that ends in .toml (see docs/formats.md, 'A site of your own')"
        )
    try:
        return site_from_dict(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SiteError(f"{path}: not a TOML file: {error}") from error
    except SiteError as error:
        raise SiteError(f"{path}: {error}") from error


def site_from_dict(values: dict[str, Any]) -> Site:
    """Returns the site that a site file's values describe.

    Raises:
        SiteError: a value is missing, unknown, or of the wrong kind.
    """
    values = dict(values)
    try:
        site = Site(
            lanes=tuple(Lane(**lane) for lane in values.pop("lanes")),
            windows=tuple(Window(**window) for window in values.pop("windows", ())),
            notes=tuple(Note(**note) for note in values.pop("notes", ())),
            lane_line=tuple((float(x), float(y)) for x, y in values.pop("lane_line")),
            merge_zone=(float(values["merge_zone"][0]), float(values.pop("merge_zone")[1])),
            **values,
        )
    except KeyError as error:
        raise SiteError(f"the value {error} is missing") from error
    except (TypeError, ValueError, IndexError) as error:
        raise SiteError(f"a value is missing, unknown, or of the wrong kind: {error}") from error
    _check(site)
    return site


def site_to_dict(site: Site) -> dict[str, Any]:
    """Returns the values of a site file; the inverse of `site_from_dict`."""
    return asdict(site)


def _check(site: Site) -> None:
    numbers = [lane.number for lane in site.lanes]
    if not site.ramp_lanes:
        raise SiteError("no lane has the role 'ramp'")
    if site.target_lane not in numbers:
        raise SiteError(f"target_lane is {site.target_lane}, which is none of the lanes {numbers}")
    if not site.gore < site.ramp_end <= site.length:
        raise SiteError(f"expected gore < ramp_end <= length, got {site.gore}, {site.ramp_end}, {site.length}")
    xs = [x for x, _ in site.lane_line]
    if len(xs) < 1 or xs != sorted(xs):
        raise SiteError("lane_line needs at least one point [x, y], in order of growing x")
    try:
        site.window_bounds()
    except (ValueError, KeyError) as error:
        raise SiteError(f"a window's time or the time zone cannot be read: {error}") from error
