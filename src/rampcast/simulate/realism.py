"""How far a recording resembles real traffic at an on-ramp: the numbers that the simulated sample must meet.

python -m rampcast.simulate realism            prints them for the shipped sample
"""

from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.errors import RecordingError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.simulate.network import full_width_end

CLUSTER = 3.0  # [m] no place that short may hold many of the merges
HARD_BRAKING = 6.0  # [m/s^2]
SPEED_SPAN = 0.5  # [s] over which speeds and accelerations are taken, so that rounded positions do not count as braking
CELL_TIME, CELL_LENGTH = 2.0, 20.0  # [s], [m] cells of the space-time diagram
WAVE_DISTANCE = 100.0  # [m] between the two places whose speeds are correlated
WAVE_LAG = 60.0  # [s] longest time a wave may take between them
WAVE_TREND = 90.0  # [s] slower changes of speed are no waves and are taken out


@dataclass(frozen=True)
class Accepted:
    """A measure and the range of values that count as resembling real traffic."""

    measure: str
    unit: str
    low: float
    high: float


ACCEPTED = (
    Accepted("merge place, 25 %", "share of lane", 0.1, 0.7),
    Accepted("merge place, 50 %", "share of lane", 0.1, 0.7),
    Accepted("merge place, 75 %", "share of lane", 0.1, 0.7),
    Accepted("merge place, 75 % - 25 %", "share of lane", 0.2, 1.0),
    Accepted("merges within any 3 m", "share", 0.0, 0.15),
    Accepted("mean speed in the target lane", "m/s", 5.0, 12.0),
    Accepted("vehicles braking harder than 6 m/s^2", "share", 0.0, 0.01),
    Accepted("speed of waves, upstream", "m/s", 3.0, 7.0),
)


def realism(recording: Recording) -> pl.DataFrame:
    """Returns one row per window and measure: recording, measure, unit, value, low, high, accepted.

    The acceleration lane is counted from the gore to where its taper begins. A merge is a change of lane number from
    the ramp to the target lane.

    Raises:
        RecordingError: a window holds no merge.
    """
    rows = []
    for name in recording.names:
        tracks = recording.window(name).tracks
        shares = _merge_shares(tracks, recording)
        if len(shares) == 0:
            raise RecordingError(f"{name}: no vehicle changes from the ramp to lane {recording.site.target_lane}")
        quartiles = np.quantile(shares, [0.25, 0.5, 0.75])
        metres = shares * (full_width_end(recording.site) - recording.site.gore)
        speeds = space_time(recording.window(name), lane=recording.site.target_lane)
        values = [*quartiles, quartiles[2] - quartiles[0], _fullest(metres, CLUSTER)]
        values += [_mean_speed(tracks, recording), _hard_braking(tracks, recording.time_step), wave_speed(speeds)]
        rows += [
            (name, a.measure, a.unit, float(value), a.low, a.high, bool(a.low <= value <= a.high))
            for a, value in zip(ACCEPTED, values, strict=True)
        ]
    names = [c.RECORDING, "measure", "unit", "value", "low", "high", "accepted"]
    return pl.DataFrame(rows, schema=names, orient="row")


def space_time(recording: Recording, *, lane: int) -> Float[np.ndarray, "time place"]:
    """Returns the mean speed in a lane of one window [m/s], in cells of 2 s and 20 m.

    A cell that no vehicle passed is interpolated in time; a place that none ever passed is NaN.
    """
    site, step = recording.site, recording.time_step
    rows = _with_speed(recording.tracks, step).filter(pl.col(c.LANE) == lane, pl.col("speed").is_not_nan())
    places = int(site.length / CELL_LENGTH)
    times = int(recording.tracks[c.FRAME].max() * step / CELL_TIME) + 1  # type: ignore[operator,arg-type]
    time = (rows[c.FRAME].to_numpy() * step / CELL_TIME).astype(int)
    place = np.minimum((rows[c.X].to_numpy() / CELL_LENGTH).astype(int), places - 1)
    total, count = np.zeros((times, places)), np.zeros((times, places))
    np.add.at(total, (time, place), rows["speed"].to_numpy())
    np.add.at(count, (time, place), 1.0)
    for column in range(places):
        seen = np.flatnonzero(count[:, column])
        speed = total[seen, column] / count[seen, column]
        total[:, column] = np.interp(np.arange(times), seen, speed) if len(seen) else np.nan
    return total


def wave_speed(speeds: Float[np.ndarray, "time place"]) -> float:
    """Returns how fast changes of speed travel upstream [m/s]; negative if downstream, NaN if it cannot be told.

    The speeds at all pairs of places 100 m apart are correlated at every lag; the lag of the highest mean correlation
    is the travel time of the waves.

    Args:
        speeds: as `space_time` returns them [m/s].
    """
    from scipy.ndimage import uniform_filter1d  # heavy; reading the sample does not need it

    change = speeds - uniform_filter1d(speeds, round(WAVE_TREND / CELL_TIME), axis=0, mode="nearest")
    change = change / (change.std(axis=0) + 1e-9)  # a place where nothing changes correlates with nothing
    apart = round(WAVE_DISTANCE / CELL_LENGTH)
    known = ~np.isnan(change[:, :-apart] + change[:, apart:]).any(axis=0)
    if not known.any():
        return float("nan")
    upstream, downstream = change[:, :-apart][:, known], change[:, apart:][:, known]
    n = len(change)
    most = min(round(WAVE_LAG / CELL_TIME), n // 2)
    lags = [lag for lag in range(-most, most + 1) if lag != 0]
    # A wave is seen downstream first and `lag` cells later upstream.
    similar = [
        float((downstream[max(0, -lag) : n - max(0, lag)] * upstream[max(0, lag) : n - max(0, -lag)]).mean())
        for lag in lags
    ]
    return float(WAVE_DISTANCE / (lags[int(np.argmax(similar))] * CELL_TIME))


def _merge_shares(tracks: pl.DataFrame, recording: Recording) -> Float[np.ndarray, "merge"]:
    """Returns where vehicles left the ramp lane, as shares of the acceleration lane."""
    site = recording.site
    following = pl.col(c.LANE).shift(-1).over(c.VEHICLE)
    merges = tracks.filter(pl.col(c.LANE).is_in(site.ramp_lanes) & (following == site.target_lane))
    place: Float[np.ndarray, "merge"] = merges[c.X].to_numpy()
    return (place - site.gore) / (full_width_end(site) - site.gore)


def _fullest(places: Float[np.ndarray, "merge"], width: float) -> float:
    """Returns the largest share of places that one stretch of that width holds."""
    ordered = np.sort(places)
    inside = np.searchsorted(ordered, ordered + width, side="right") - np.arange(len(ordered))
    return float(inside.max() / len(ordered))


def _with_speed(tracks: pl.DataFrame, time_step: float) -> pl.DataFrame:
    """Returns the rows at which a vehicle is seen half a second before and after, with its mean speed between."""
    reach = round(SPEED_SPAN / time_step)
    change = pl.col(c.X).shift(-reach).over(c.VEHICLE) - pl.col(c.X).shift(reach).over(c.VEHICLE)
    return tracks.with_columns((change / (2 * reach * time_step)).alias("speed")).drop_nulls("speed")


def _mean_speed(tracks: pl.DataFrame, recording: Recording) -> float:
    in_target = _with_speed(tracks, recording.time_step).filter(pl.col(c.LANE) == recording.site.target_lane)
    return float(in_target["speed"].mean())  # type: ignore[arg-type]


def _hard_braking(tracks: pl.DataFrame, time_step: float) -> float:
    """Returns the share of vehicles that ever brake harder than 6 m/s^2."""
    reach = round(SPEED_SPAN / time_step)
    ahead, behind = (pl.col(c.X).shift(k).over(c.VEHICLE) for k in (-reach, reach))
    braking = (2 * pl.col(c.X) - ahead - behind) / (reach * time_step) ** 2
    worst = tracks.select(c.VEHICLE, braking.alias("braking")).group_by(c.VEHICLE).agg(pl.col("braking").max())
    return float((worst["braking"] > HARD_BRAKING).sum() / len(worst))
