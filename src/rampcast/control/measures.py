"""What a run was worth: time, delay, waiting, safety at merges, fuel, and how evenly delay is spread.

docs/control.md defines each column and names its source.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from rampcast.compute import computing
from rampcast.physics.safety import (
    LEAST_POST_ENCROACHMENT,
    LEAST_TIME_TO_COLLISION,
    MOST_DECELERATION,
    deceleration_to_avoid_crash,
    post_encroachment_time,
    time_to_collision,
)
from rampcast.recording import columns as c
from rampcast.sites import Site

AFTER: Final = 5.0  # [s] after a merge in which a conflict is one of that merge, as in `live.near_misses`
HARD: Final = 4.0  # [m/s^2] beyond comfort: 3.4 m/s^2 is the comfortable limit of AASHTO 2018, section 3.2.2
ROWS: Final = 4096  # arrays are padded to multiples of it, so that a new number of rows compiles nothing anew
PETROL: Final = 742.0  # [g/l] density by which SUMO turns mass into litres (HBEFA)


def trip_measures(path: Path, ramp_routes: Collection[str], route_of: Mapping[str, str]) -> dict[str, float]:
    """Returns delays [s], fuel [l] and CO2 [kg] from what SUMO tells of each vehicle.

    Args:
        path: SUMO's file of trips.
        ramp_routes: names of the routes that begin on a ramp.
        route_of: the route of each vehicle by its id.
    """
    delay: dict[bool, list[float]] = {True: [], False: []}
    fuel = carbon = 0.0
    for _, trip in ElementTree.iterparse(path):
        if trip.tag == "tripinfo":
            on_ramp = route_of[trip.get("id", "")] in ramp_routes
            delay[on_ramp].append(float(trip.get("departDelay", 0.0)) + max(0.0, float(trip.get("timeLoss", 0.0))))
            for told in trip.findall("emissions"):
                fuel += float(told.get("fuel_abs", 0.0))
                carbon += float(told.get("CO2_abs", 0.0))
    return {
        "main_delay": float(np.mean(delay[False])) if delay[False] else 0.0,
        "ramp_delay": float(np.mean(delay[True])) if delay[True] else 0.0,
        "gini": gini(np.array(delay[True] + delay[False])),
        "fuel": fuel / 1000.0 / PETROL,
        "co2": carbon / 1e6,
    }


def gini(values: Float[np.ndarray, "vehicle"]) -> float:
    """Returns Gini's coefficient: 0 if all have the same, towards 1 if one has all; 0 if nobody has anything.

    Source: Gini 1912; as sum_i (2 i - n - 1) x_i / (n sum x) of ordered values.
    """
    ordered, n = np.sort(np.maximum(values, 0.0)), len(values)
    if not n or not ordered.sum():
        return 0.0
    return float(((2 * np.arange(1, n + 1) - n - 1) * ordered).sum() / (n * ordered.sum()))


def joined(frames: Sequence[tuple[float, Mapping[str, np.ndarray]]]) -> dict[str, np.ndarray]:
    """Returns the frames of a run as columns, with "time" [s], by time, lane and place."""
    columns = {name: np.concatenate([frame[name] for _, frame in frames]) for name in frames[0][1]}
    columns["time"] = np.concatenate([np.full(len(frame[c.X]), time) for time, frame in frames])
    order = np.lexsort((columns[c.X], columns[c.LANE], columns["time"]))
    return {name: values[order] for name, values in columns.items()}


def safety_measures(rows: Mapping[str, np.ndarray], site: Site) -> dict[str, float]:
    """Returns merges, the share of them with a conflict by each measure, and hard brakings for 1,000 vehicles.

    Args:
        rows: as `joined` returns them.
        site: of the section.
    """
    merged = merges(rows, site)
    found = {"merges": float(len(merged["row"])), "hard_brakings": hard_brakings(rows)}
    if not len(merged["row"]):
        return found | dict.fromkeys(("ttc", "drac", "pet", "conflicts"), 0.0)
    who = rows[c.VEHICLE][merged["row"]]
    close, hard = _conflicts_after(rows, who, rows["time"][merged["row"]])
    soon = _encroachments(rows, merged) < LEAST_POST_ENCROACHMENT
    shares = {"ttc": close, "drac": hard, "pet": soon, "conflicts": close | hard}
    return found | {name: float(values.mean()) for name, values in shares.items()}


def merges(rows: Mapping[str, np.ndarray], site: Site) -> dict[str, np.ndarray]:
    """Returns the first row of each vehicle in the target lane that came from the ramp: row, and rows ahead and behind.

    -1 stands for nobody ahead or behind.
    """
    order = np.lexsort((rows["time"], rows[c.VEHICLE]))
    vehicle, lane = rows[c.VEHICLE][order], rows[c.LANE][order]
    came = site.on_ramp(lane[:-1]) & (lane[1:] == site.target_lane) & (vehicle[1:] == vehicle[:-1])
    row = order[np.flatnonzero(came) + 1]
    return {"row": row, "ahead": _beside(rows, row, 1), "behind": _beside(rows, row, -1)}


def _beside(rows: Mapping[str, np.ndarray], row: np.ndarray, off: int) -> np.ndarray:
    """Returns the rows next to some in the same lane at the same time."""
    other = np.clip(row + off, 0, len(rows[c.X]) - 1)
    same = (rows["time"][other] == rows["time"][row]) & (rows[c.LANE][other] == rows[c.LANE][row]) & (other != row)
    return np.where(same, other, -1)


def _conflicts_after(
    rows: Mapping[str, np.ndarray], who: np.ndarray, when: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns of each merge whether TTC fell below 3 s, and DRAC rose above 3 m/s^2, within 5 s after it."""
    every = np.arange(len(rows[c.X]))
    ahead = _beside(rows, every, 1)
    pair = np.flatnonzero(ahead >= 0)
    number = np.full(int(rows[c.VEHICLE].max()) + 1, -1)
    number[who] = np.arange(len(who))
    close, hard = np.zeros(len(who), bool), np.zeros(len(who), bool)
    for side in (pair, ahead[pair]):  # the one who merged is behind, or ahead
        merge = number[rows[c.VEHICLE][side]]
        since = rows["time"][side] - when[merge]
        some = np.flatnonzero((merge >= 0) & (since >= 0.0) & (since <= AFTER))
        follower, leader = pair[some], ahead[pair[some]]
        gap = rows[c.X][leader] - rows[c.LENGTH][leader] - rows[c.X][follower]
        ttc, drac = _measured(gap, rows[c.V][follower], rows[c.V][leader])
        np.logical_or.at(close, merge[some], ttc < LEAST_TIME_TO_COLLISION)
        np.logical_or.at(hard, merge[some], drac > MOST_DECELERATION)
    return close, hard


def _measured(gap: np.ndarray, speed: np.ndarray, leader_speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = len(gap)
    padded = [np.pad(one, (0, -count % ROWS)) for one in (gap, speed, leader_speed)]
    with computing():
        values = [
            law(padded[0], speed=padded[1], leader_speed=padded[2])
            for law in (time_to_collision, deceleration_to_avoid_crash)
        ]
    return np.asarray(values[0])[:count], np.asarray(values[1])[:count]


def _encroachments(rows: Mapping[str, np.ndarray], merged: Mapping[str, np.ndarray]) -> np.ndarray:
    """Returns the smaller post-encroachment time of each merge [s], to the vehicle ahead and to the one behind."""
    tracks = _tracks(rows)
    found = np.full(len(merged["row"]), np.inf)
    for k, (row, ahead, behind) in enumerate(
        zip(*(merged[one].tolist() for one in ("row", "ahead", "behind")), strict=True)
    ):
        place, now = rows[c.X][row], rows["time"][row]
        pairs = []
        if ahead >= 0:
            pairs.append((_passes(tracks, rows, ahead, place, rear=True), now))
        if behind >= 0:
            arrives = _passes(tracks, rows, behind, place, rear=False)
            pairs.append((_passes(tracks, rows, row, place, rear=True), arrives))
        left, arrived = np.array([one for one in pairs if np.isfinite(one[0])]).reshape(-1, 2).T
        if len(left):
            found[k] = float(np.min(np.asarray(post_encroachment_time(*_padded(left, arrived)))[: len(left)]))
    return found


def _padded(left: np.ndarray, arrived: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.resize(left, 2), np.resize(arrived, 2)


def _tracks(rows: Mapping[str, np.ndarray]) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Returns times [s] and fronts [m] of each vehicle."""
    order = np.lexsort((rows["time"], rows[c.VEHICLE]))
    vehicle = rows[c.VEHICLE][order]
    first = np.flatnonzero(np.append(True, vehicle[1:] != vehicle[:-1]))
    parts = np.split(order, first[1:])
    return {int(vehicle[k]): (rows["time"][part], rows[c.X][part]) for k, part in zip(first, parts, strict=True)}


def _passes(
    tracks: Mapping[int, tuple[np.ndarray, np.ndarray]], rows: Mapping[str, Any], row: int, place: float, *, rear: bool
) -> float:
    """Returns when the front, or the rear, of a row's vehicle comes past a place [s]; infinite if never seen to."""
    time, x = tracks[int(rows[c.VEHICLE][row])]
    x = x - rows[c.LENGTH][row] * rear
    k = int(np.searchsorted(x, place, side="right"))
    if k == 0:
        return float(time[0])
    if k == len(x):
        return float("inf")
    return float(np.interp(place, x[k - 1 : k + 1], time[k - 1 : k + 1]))


def hard_brakings(rows: Mapping[str, np.ndarray]) -> float:
    """Returns how often vehicles begin to brake harder than 4 m/s^2, for 1,000 vehicles."""
    order = np.lexsort((rows["time"], rows[c.VEHICLE]))
    vehicle, hard = rows[c.VEHICLE][order], rows[c.A][order] < -HARD
    begins = hard & np.append(True, ~hard[:-1] | (vehicle[1:] != vehicle[:-1]))
    return 1000.0 * float(begins.sum()) / len(np.unique(vehicle))
