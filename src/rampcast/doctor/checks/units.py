"""Suspicions about units: lengths, lanes, speeds and the time step that look as if they were in another unit."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.doctor.checks.recorded import FEWEST, compared_speeds, speed_ratio, unit_of_speed
from rampcast.doctor.finding import Faults, NotAssessed
from rampcast.doctor.places import VALUE, moments, no_places
from rampcast.doctor.subject import Subject
from rampcast.formats.steps.units import FOOT
from rampcast.recording import columns as c
from rampcast.recording.cutting import FASTEST
from rampcast.recording.invariants import RATIO

CAR_LENGTHS = (3.3, 6.5)  # [m] of the median car: small cars are 3.5 m long, the largest pick-up trucks 6.4 m
LANE_SPACINGS = (2.5, 5.0)  # [m] of the median lane: lanes of roadworks are 2.6 m, ramp lanes 4.9 m (16 ft) wide
LEAST_SHARE = 0.01  # of all rows: a lane of fewer may be no more than wrong labels
PARTS = {1000: "thousandths", 100: "hundredths"}  # in which sources give feet
WRONG_FEET = (
    0.3084,
    0.3408,
    0.305,
    0.304,
    0.3049,
    0.3047,
    0.308,
    0.3,
    0.31,
)  # [m] slips of the pen for 0.3048, and roundings
MOST_WHOLE = 0.95  # of values that are whole thousandths of a foot: by chance a tenth is
WHOLE = 0.05  # of a thousandth: metres rounded to a tenth of a millimetre are still told
FINEST = 10  # thousandths of a foot that positions may be apart; in a coarser grid they are pixels
COARSEST = 1000  # likewise: pixels of a foot, and their multiples
NEAR = 3.0  # [m] nearer to 0 one foot is as good as another
MOST_FEET = 20_000  # positions that are looked at
# What a value must be multiplied with if it was taken for metres and is in that unit.
LENGTH_UNITS = {"feet": FOOT, "centimetres": 0.01, "feet, converted to metres twice": 1 / FOOT}


@dataclass(frozen=True)
class _Measured:
    """A quantity that tells the unit: its name, its value, the usual values, and what it seems to be beyond them."""

    what: str
    value: float
    usual: tuple[float, float]
    seems: str

    @property
    def is_suspicious(self) -> bool:
        return not self.usual[0] <= self.value <= self.usual[1]


def units(subject: Subject) -> Faults | NotAssessed:
    """Returns the quantities that no road has in the units that a recording should be in; the value is the quantity."""
    measured = [*_car_length(subject), *_lane_spacing(subject), *_speed(subject), *_time_step(subject)]
    if not measured:
        return NotAssessed("there are no cars with lengths of their own, no two lanes, and nothing moves")
    suspicious = [one for one in measured if one.is_suspicious]
    detail = "; ".join(
        f"{one.what} is {one.value:.3g}, expected {one.usual[0]:g} to {one.usual[1]:g}: {one.seems}"
        for one in suspicious
    )
    return Faults(moments({VALUE: [one.value for one in suspicious]}), of=len(measured), detail=detail)


def feet(subject: Subject) -> Faults | NotAssessed:
    """Returns one if the positions are whole thousandths of a foot that is not 0.3048 m; the value is that foot [m].

    NGSIM writes feet with three decimals. Whoever turned them into metres with a wrong factor left them whole in it.
    """
    if subject.recording.is_smoothed:
        return NotAssessed("the recording is smoothed already")
    x = np.unique(subject.x[:: max(len(subject.x) // MOST_FEET, 1)])
    x = x[np.abs(x) > NEAR]
    if len(x) < FEWEST:
        return NotAssessed("there are too few positions")
    whole = {(foot, parts): _share_whole(x / foot, parts) for foot in WRONG_FEET for parts in PARTS}
    foot, parts = max(whole, key=lambda one: whole[one])
    if whole[foot, parts] < MOST_WHOLE or any(_share_whole(x / unit, parts) >= MOST_WHOLE for unit in (FOOT, 1.0)):
        return Faults(no_places(), of=1, count=0)
    if _is_of_pixels(x / foot):
        return Faults(no_places(), of=1, count=0)
    off = 100 * (foot / FOOT - 1)
    detail = (
        f"{whole[foot, parts]:.1%} of x are whole {PARTS[parts]} of a foot of {foot:g} m: all positions are "
        f"{off:+.2f} % off"
    )
    return Faults(moments({VALUE: [foot]}), of=1, detail=detail)


def _share_whole(values: Float[np.ndarray, "position"], parts: int) -> float:
    """Returns which share of values are whole parts, as thousandths, as far as a tenth of them tells."""
    counts = values * parts
    return float(np.mean(np.abs(counts - np.rint(counts)) < WHOLE))


def _is_of_pixels(values: Float[np.ndarray, "position"]) -> bool:
    """Returns whether nearly all values are whole steps of more thousandths than positions in feet lie apart."""
    counts = np.rint(1000 * values).astype(np.int64)
    return any(np.mean(counts % step == 0) >= MOST_WHOLE for step in range(FINEST + 1, COARSEST + 1))


def _car_length(subject: Subject) -> Iterator[_Measured]:
    filled = subject.report.sizes_filled if subject.report else 0
    if filled > len(subject.step) / 2:
        return  # these lengths are rampcast's own
    vehicles = subject.tracks[subject.starts]
    lengths = vehicles.filter((pl.col(c.KIND) == "car") & (pl.col(c.LENGTH) > 0))[c.LENGTH]
    if lengths.len():
        value = float(np.median(lengths.to_numpy()))
        yield _Measured("the median length of a car [m]", value, CAR_LENGTHS, _length_unit(value, CAR_LENGTHS))


def _lane_spacing(subject: Subject) -> Iterator[_Measured]:
    roles = {lane.number: lane.role for lane in subject.recording.site.lanes}
    main = [number for number, role in roles.items() if role == "main"]
    lanes = subject.tracks.filter(pl.col(c.LANE).is_in(main)).group_by(c.LANE)
    fewest = max(FEWEST, LEAST_SHARE * len(subject.step))
    found = lanes.agg(pl.col(c.Y).median(), pl.len()).filter(pl.col("len") >= fewest).sort(c.LANE)
    number, y = found[c.LANE].to_numpy().astype(np.float64), found[c.Y].to_numpy()
    if len(y) < 2 or np.ptp(y) == 0:
        return
    value = float(np.median(np.abs(np.diff(y)) / np.diff(number)))
    yield _Measured("the distance from lane to lane [m]", value, LANE_SPACINGS, _length_unit(value, LANE_SPACINGS))


def _speed(subject: Subject) -> Iterator[_Measured]:
    known = np.abs(subject.speed[np.isfinite(subject.speed)])
    if len(known):
        value = float(np.median(known))
        seems = "positions look like feet or centimetres, or the time step is too short"
        yield _Measured("the median speed [m/s]", value, (0.0, FASTEST), seems)


def _time_step(subject: Subject) -> Iterator[_Measured]:
    compared = compared_speeds(subject)
    if isinstance(compared, NotAssessed):
        return
    ratio = speed_ratio(*compared[1:])
    if math.isfinite(ratio) and not unit_of_speed(ratio):  # another unit of a recorded speed spoils nothing
        seems = f"positions or time step are off by a factor of {1 / ratio:.3g}" if ratio else "nothing moved"
        yield _Measured("recorded speed over derived speed", ratio, RATIO, seems)


def _length_unit(value: float, usual: tuple[float, float]) -> str:
    fitting = [name for name, factor in LENGTH_UNITS.items() if usual[0] <= value * factor <= usual[1]]
    return f"looks like {fitting[0]}" if fitting else "fits no unit that is known here"
