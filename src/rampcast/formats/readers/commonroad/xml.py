"""CommonRoad's xml (2018b, 2020a): lanelets and the states of moving obstacles, one top-level element at a time."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BufferedIOBase
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from rampcast.errors import FormatError
from rampcast.formats.files.sources import open_source, read_start
from rampcast.formats.files.xml_text import expect_root, first_error
from rampcast.formats.steps.believed import FARTHEST_UTM
from rampcast.formats.steps.lanelets import Lanelet
from rampcast.formats.tables.columns import SHOWN, Column, advice, read_cell
from rampcast.recording import columns as c
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows

ROOT = "commonRoad"
BLOCK = 64 << 10  # [bytes] parsed at a time; elements of a block are in memory until they are read
LARGEST = 4 << 20  # [bytes] of one obstacle or lanelet: 10,000 states, a quarter of an hour at 10 Hz
NUMBER = Column("number", (), low=-FARTHEST_UTM, high=FARTHEST_UTM)
SIZE = Column("size", (), low=1e-3, high=100)  # [m]
STEP = Column("step", (), low=1e-3, high=10)  # [s]
TIME = Column("time", (), low=0, high=c.LARGEST)

# Of 2018b and 2020a; None is no vehicle on a road. What moves and is of unknown type is most likely a car.
KINDS: dict[str, str | None] = {
    "unknown": "car",
    "car": "car",
    "taxi": "car",
    "priorityVehicle": "car",
    "parkedVehicle": "car",
    "truck": "truck",
    "bus": "truck",
    "motorcycle": "motorcycle",
    "bicycle": None,
    "pedestrian": None,
    "train": None,
    "constructionZone": None,
    "roadBoundary": None,
    "building": None,
    "pillar": None,
    "median_strip": None,
}
MOVING = ("obstacle", "dynamicObstacle")  # of 2018b, with a role, and of 2020a
STANDING = ("staticObstacle", "environmentObstacle", "phantomObstacle")


@dataclass(frozen=True)
class Box:
    """The box around an obstacle's shape: middle of its front in the obstacle's own axes, length and width [m]."""

    front_x: float
    front_y: float
    length: float
    width: float


@dataclass
class Scenario:
    """What is in a file, filled as it is read.

    Attributes:
        file: its name for messages.
        attributes: of the root.
        tags: what kind of scenario it is, in its author's words.
        lanelets: in the order of the file.
        states: (obstacle, kind, box, time step, x, y, orientation, velocity, acceleration) of every vehicle and time.
        not_vehicles: rows of what stands still or is no vehicle.
        faults: the first 100 bad rows.
        faults_counted: how many there were.
    """

    file: str
    attributes: dict[str, str] = field(default_factory=dict)
    tags: set[str] = field(default_factory=set)
    lanelets: list[Lanelet] = field(default_factory=list)
    states: list[tuple[Any, ...]] = field(default_factory=list)
    not_vehicles: int = 0
    faults: list[BadRow] = field(default_factory=list)
    faults_counted: int = 0


class _Fault(Exception):
    """Something in an element is not as it should be; says what."""


def read_scenario(path: Path, bad_rows: BadRows) -> Scenario:
    """Returns what is in a file (plain, .gz or in a .zip).

    Raises:
        FormatError: it is not CommonRoad's xml, or has a bad state and those are not to be skipped.
    """
    with open_source(path) as (name, stream):
        scenario = Scenario(name)
        for element in _elements(name, stream, scenario):
            if element.tag == "lanelet":
                scenario.lanelets.append(_lanelet(name, element))
            elif element.tag == "scenarioTags":
                scenario.tags |= {str(tag.tag) for tag in element}
            elif element.tag in STANDING or element.findtext("role") == "static":
                scenario.not_vehicles += 1
            else:
                _read_obstacle(scenario, element, bad_rows)
    return scenario


def _parser() -> Any:
    """Returns a parser that loads nothing from elsewhere."""
    return etree.XMLPullParser(
        events=("start", "end"),
        tag=(ROOT, "lanelet", "scenarioTags", *MOVING, *STANDING),
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
    )


def _elements(name: str, stream: BufferedIOBase, scenario: Scenario) -> Iterator[Any]:
    """Yields each top-level element that is of use, and forgets it after."""
    parser = _parser()
    block = read_start(name, stream, size=BLOCK)
    expect_root(name, block, ROOT)
    root, fed = None, 0
    while block:
        fed += len(block)
        try:
            parser.feed(block)
            block = read_start(name, stream, size=BLOCK)
            if not block:
                parser.close()
            events = list(parser.read_events())
        except etree.XMLSyntaxError as error:
            line, reason = first_error(parser, error)
            raise FormatError(
                f"{name}, line {line}: not well-formed xml ({reason}); is it cut off? Get it again"
            ) from error
        for event, element in events:
            if event == "start" and element.getparent() is None:
                root = element
                scenario.attributes |= root.attrib
                scenario.tags |= set(root.get("tags", "").split())
            elif event == "end" and element.getparent() is not None and element.getparent().getparent() is None:
                yield element
                element.clear()
        if root is not None and len(root) > 1:
            del root[:-1]  # also what is of no use, and is whole, since another begins behind it
            fed = 0
        if fed > LARGEST:
            raise FormatError(
                f"{name}: an element of more than {LARGEST:,} bytes; expected obstacles and lanelets of a recording of "
                "minutes. Is this a scenario?"
            )


def _lanelet(name: str, element: Any) -> Lanelet:
    bounds = []
    for side in ("leftBound", "rightBound"):
        try:
            points = [_point(point) for point in element.iterfind(f"{side}/point")]
        except _Fault as fault:
            raise FormatError(
                f"{name}, line {element.sourceline}: lanelet {element.get('id')}, {side}: {fault}"
            ) from None
        if len(points) < 2:
            raise FormatError(
                f"{name}, line {element.sourceline}: lanelet {element.get('id')}: expected two points or more in its "
                f"{side}, found {len(points)}"
            )
        bounds.append(points)
    return Lanelet(str(element.get("id")), np.array(bounds[0] + bounds[1][::-1]))


def _read_obstacle(scenario: Scenario, element: Any, bad_rows: BadRows) -> None:
    """Adds the states of an obstacle to the scenario."""
    states = [*element.iterfind("initialState"), *element.iterfind("trajectory/state")]
    try:
        kind = _kind(element)
        box = _box(element.find("shape")) if kind else None
    except _Fault as fault:
        _add_fault(scenario, element, element, f"{fault}", bad_rows, count=max(len(states), 1))
        return
    if kind is None:
        scenario.not_vehicles += len(states)
        return
    for state in states:
        try:
            scenario.states.append((element.get("id"), kind, box, *_state(state)))
        except _Fault as fault:
            _add_fault(scenario, element, state, f"{fault}", bad_rows, count=1)


def _add_fault(scenario: Scenario, obstacle: Any, element: Any, reason: str, bad_rows: BadRows, *, count: int) -> None:
    shown = str(obstacle.get("id"))[:SHOWN]
    fault = BadRow(scenario.file, element.sourceline, 0, f"obstacle {shown}: {reason}")
    if bad_rows is BadRows.RAISE:
        raise FormatError(advice(fault))
    scenario.faults_counted += count
    if len(scenario.faults) < MOST_LISTED:
        scenario.faults.append(fault)


def _kind(element: Any) -> str | None:
    if not element.get("id"):
        raise _Fault("expected an id, found none")
    name = (element.findtext("type") or "").strip()
    if name not in KINDS:
        raise _Fault(f"type: expected one of {', '.join(KINDS)}, found '{name[:SHOWN]}'")
    return KINDS[name]


def _state(element: Any) -> tuple[float | None, ...]:
    """Returns time step, x, y [m], orientation [rad], velocity [m/s] and acceleration [m/s^2] of a state."""
    parts = {part.tag: part for part in element}
    point = parts["position"].find("point") if "position" in parts else None
    if point is None:
        raise _Fault("position: expected a point; a vehicle in an area or on a lanelet has no known place")
    x, y = _point(point)
    time = _exact(parts, "time", TIME)
    if time != int(time):
        raise _Fault(f"time: expected a whole number of time steps, found '{time}'")
    known = [
        _number(parts[name].findtext("exact"), name) if name in parts else None for name in ("velocity", "acceleration")
    ]
    return time, x, y, _exact(parts, "orientation", NUMBER), *known


def _exact(parts: dict[Any, Any], name: str, column: Column) -> float:
    if name not in parts:
        raise _Fault(f"no {name}")
    text = parts[name].findtext("exact")
    if text is None and parts[name].find("intervalStart") is not None:
        raise _Fault(f"{name}: expected an exact value, found an interval")
    return _read(text, name, column)


def _number(text: str | None, name: str) -> float | None:
    """Returns a value that may be absent or an interval, and then is not known."""
    return None if text is None else _read(text, name, NUMBER)


def _read(text: str | None, name: str, column: Column) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not column.low <= value <= column.high:
        raise _Fault(f"{name}: {read_cell((text or '').strip(), column)[1]}")
    return value


def _point(element: Any) -> tuple[float, float]:
    return _read(element.findtext("x"), "x", NUMBER), _read(element.findtext("y"), "y", NUMBER)


def read_time_step(scenario: Scenario) -> float:
    """Returns the time step [s].

    Raises:
        FormatError: the file has none.
    """
    try:
        return _read(scenario.attributes.get("timeStepSize"), "timeStepSize", STEP)
    except _Fault as fault:
        raise FormatError(f"{scenario.file}: <{ROOT}>: {fault}") from None


def _box(shape: Any) -> Box:
    """Returns the box around rectangles, circles and polygons, whose coordinates are those of the obstacle."""
    points = [point for part in (shape if shape is not None else ()) for point in _outline(part)]
    if not points:
        raise _Fault("shape: expected a rectangle, circle or polygon, found none of them")
    xs, ys = zip(*points, strict=True)
    return Box(max(xs), (max(ys) + min(ys)) / 2, max(xs) - min(xs), max(ys) - min(ys))


def _outline(part: Any) -> list[tuple[float, float]]:
    if part.tag == "polygon":
        points = [_point(point) for point in part.iterfind("point")]
        if len(points) < 3:
            raise _Fault(f"shape: expected three points or more in a polygon, found {len(points)}")
        return points
    if part.tag not in ("rectangle", "circle"):
        return []
    centre = part.find("center")
    x, y = (0.0, 0.0) if centre is None else _point(centre)
    if part.tag == "circle":
        radius = _read(part.findtext("radius"), "radius", SIZE)
        return [(x - radius, y - radius), (x + radius, y + radius)]
    length, width = (_read(part.findtext(name), name, SIZE) for name in ("length", "width"))
    turn = _number(part.findtext("orientation"), "orientation") or 0.0
    return [
        (x + math.cos(turn) * along - math.sin(turn) * left, y + math.sin(turn) * along + math.cos(turn) * left)
        for along in (-length / 2, length / 2)
        for left in (-width / 2, width / 2)
    ]
