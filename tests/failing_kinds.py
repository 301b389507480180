"""Small files of the kinds that public files failed as, each made anew; and longer ones of the same place."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from tests.ngsim_writer import TXT_COLUMNS as NAMES

SHORT, LONG = 0.3, 60.0  # [s]
Row = Sequence[object]
Makes = Callable[[Path, float], list[Path]]

PLAIN = "vehicle,time,x,y,lane,length,width"
INTERACTION = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
START = 1113433235000  # [ms] frame 1000 of the window of 16:00 on I-80
PERSONS = (
    "timestep_time;vehicle_angle;vehicle_id;vehicle_lane;vehicle_pos;vehicle_speed;vehicle_type;vehicle_x;vehicle_y;"
    "person_id"
)


def times(seconds: float, *, first: float = 0.0) -> Iterator[tuple[int, float]]:
    """Yields numbers and times [s] of frames at 10 Hz."""
    for k in range(round(10 * first), round(10 * seconds)):
        yield k, k / 10


def written(path: Path, head: str, rows: Iterable[Row], separator: str = ",") -> list[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [separator.join(map(str, row)) for row in rows]
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return [path]


def one_lane(folder: Path, seconds: float = SHORT) -> list[Path]:
    rows = [(n, t, 10 + 30 * n + 4 * t, 0.0, 1, 4.5, 1.8) for _, t in times(seconds) for n in (1, 2)]
    return written(folder / "one-lane.csv", PLAIN, rows)


def clip(folder: Path, seconds: float, speeds: Sequence[float]) -> list[Path]:
    rows = [
        (n, k + 1, 100 * (k + 1), "car", 100 + 12 * n + v * t, 50.0, v, 0, 0, 4.5, 1.8)
        for k, t in times(max(seconds, 0.6))
        for n, v in enumerate(speeds)
    ]
    return written(folder / "vehicle_tracks_000.csv", INTERACTION, rows)


def slow_clip(folder: Path, seconds: float = SHORT) -> list[Path]:
    return clip(folder, seconds, (2.0, 6.0, 2.0))


def one_that_moves(folder: Path, seconds: float = SHORT) -> list[Path]:
    return clip(folder, seconds, (0.0, 6.0, 0.0))


def driven(folder: Path, ways: Sequence[tuple[np.ndarray, float]]) -> list[Path]:
    """Writes tracks of vehicles that drive along points at a speed [m/s], in INTERACTION's form, at 5 Hz."""
    rows: list[Row] = []
    for number, (points, speed) in enumerate(ways, start=1):
        along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
        at = np.arange(0.0, along[-1], speed * 0.2)
        x, y = (np.interp(at, along, points[:, axis]) for axis in (0, 1))
        vx, vy = (np.gradient(one, 0.2) for one in (x, y))
        for k, (px, py, u, v) in enumerate(zip(x, y, vx, vy, strict=True), start=1):
            psi = np.arctan2(v, u)
            rows.append((number, k, 200 * k, "car", *(f"{one:.4f}" for one in (px, py, u, v, psi)), 4.5, 1.8))
    return written(folder / "vehicle_tracks_000.csv", INTERACTION, rows)


def way(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, float)


def overbridge(folder: Path, seconds: float = SHORT) -> list[Path]:
    """Three on a road, the last of which merges; one crosses it at right angles."""
    merging = way((0, -7.2), (150, -7.2), (210, -3.6), (300, -3.6))
    mains = [(way((0, 0), (300, 0)), 25.0), (way((40, -3.6), (340, -3.6)), 25.0), (merging, 25.0)]
    return driven(folder, [*mains, (way((150, 40), (150, -50)), 10.0)])


def straight_ramp(folder: Path, seconds: float = SHORT) -> list[Path]:
    """A ramp that is seen for longer than the road."""
    ramp = way((-232, -228), (-12, -8.5), (0, -7.2), (150, -7.2), (210, -3.6), (300, -3.6))
    return driven(folder, [(way((-100, 0), (300, 0)), 25.0), (way((-90, -3.6), (290, -3.6)), 24.0), (ramp, 15.0)])


def loop_ramp(folder: Path, seconds: float = SHORT) -> list[Path]:
    """A ramp that crosses the road, turns right by 270 degrees, and joins it."""
    turn = np.linspace(0.0, 1.5 * np.pi, 60)
    loop = np.stack([15 + 45 * np.cos(turn), -52.2 - 45 * np.sin(turn)], axis=1)
    ramp = np.concatenate([way((60, 80)), loop, way((250, -7.2), (310, -3.6), (400, -3.6))])
    return driven(folder, [(way((-20, 0), (380, 0)), 25.0), (way((-10, -3.6), (370, -3.6)), 24.0), (ramp, 12.0)])


def ngsim_rows(seconds: float, vehicles: Sequence[tuple[int, float, float, int]]) -> Iterator[list[str]]:
    """Yields rows of vehicles at 40 ft/s, each as (id, local x, local y at first [ft], lane)."""
    for number, x, y, lane in vehicles:
        for k, t in times(seconds):
            values = (number, 1000 + k, 120, START + 100 * k, x, round(y + 40 * t, 3), 6042000.0, 2133000.0, 14.5, 6.4)
            yield [*map(str, (*values, 2, 40.0, 0.0, lane, 0, 0, 0.0, 0.0))]


FOLLOWED = ((11, 70.5, 60.0, 6), (12, 82.0, 100.0, 7), (13, 70.1, 130.0, 6))


def without_frames(folder: Path, seconds: float = SHORT) -> list[Path]:
    rows = [row[:1] + row[2:] for row in ngsim_rows(min(seconds, 12.0), FOLLOWED[:1])]
    return written(folder / "hint.csv", ",".join(name for name in NAMES if name != "Frame_ID"), rows)


def portal_json(folder: Path, seconds: float = SHORT) -> list[Path]:
    names = [name.lower() for name in NAMES]
    rows = [
        dict(zip(names, row, strict=True)) | {"location": "i-80"}
        for row in ngsim_rows(min(seconds, 40.0), FOLLOWED[:1])
    ]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "soda.json").write_text(json.dumps(rows), encoding="utf-8")
    return [folder / "soda.json"]


def persons(folder: Path, seconds: float = SHORT) -> list[Path]:
    rows: list[Row] = []
    for _, t in times(seconds):
        at = 5 + 15 * t
        rows += [(t, 90.0, "v0", "e_0", at, 15.0, "passenger", 95 + at, 10.0, ""), (t, *[""] * 8, "p0")]
    return written(folder / "persons.csv", PERSONS, rows, ";")


def teleport(folder: Path, seconds: float = SHORT) -> list[Path]:
    """Four on the road; one in the lane beside stands at 100 m, vanishes for 3 s, and is back 250 m on."""
    steps = []
    for _, t in times(22.0):
        here = [(f"m.{n}", 20 + 40 * n + 15 * t, 0.0, 15.0, 0) for n in range(4)]
        if not 12.0 <= t < 15.0:
            x = min(10 * t, 100.0) if t < 12 else 350 + 10 * (t - 15)
            here.append(("t.1", x, 3.2, 10.0, 1))
        text = "".join(
            f'<vehicle id="{one}" x="{x:.2f}" y="{y}" angle="90" type="car" speed="{v}" pos="{x:.2f}" '
            f'lane="main_{lane}" slope="0"/>'
            for one, x, y, v, lane in here
        )
        steps.append(f'<timestep time="{t:.2f}">{text}</timestep>\n')
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fcd.xml").write_text(f"<fcd-export>\n{''.join(steps)}</fcd-export>\n", encoding="utf-8")
    return [folder / "fcd.xml"]


def auxiliary_lane(folder: Path, seconds: float = SHORT) -> list[Path]:
    """Two lanes, and a third that goes on to the end of the section: some leave it, some stay."""
    rows: list[Row] = []
    for number in range(16):
        lane, begin, speed = (3, 1, 2)[number % 3], 2.0 * number, 20.0 + number % 4
        leaves = lane == 3 and number % 2
        for _, t in times(begin + 400 / speed, first=begin):
            x = speed * (t - begin)
            share = min(max((x - 150) / 40, 0.0), 1.0) if leaves else 0.0
            y = -3.6 * (lane - 1) + 3.6 * share
            rows.append((number, t, f"{x:.2f}", f"{y:.3f}", 2 if share > 0.5 else lane, 4.5, 1.8))
    return written(folder / "lane.csv", PLAIN, rows)


def twelve_seconds(folder: Path, seconds: float = SHORT) -> list[Path]:
    """A minute of it is as short of vehicles, but one of them merges."""
    rows = ngsim_rows(12.0, FOLLOWED)
    if seconds < LONG:
        return written(folder / "twelve.csv", ",".join(NAMES), rows)
    later = [row for n in range(5) for row in ngsim_rows(12.0, [(20 + n, 82.0, 100.0, 7), (30 + n, 70.0, 20.0, 6)])]
    for index, row in enumerate(later):
        shift = 120 * (index // (2 * 120) + 1)
        row[1], row[3] = str(int(row[1]) + shift), str(int(row[3]) + 100 * shift)
        if row[13] == "7" and float(row[5]) > 300.0:
            row[13], row[4] = "6", "70.5"
    return written(folder / "minute.csv", ",".join(NAMES), [*rows, *later])


KINDS: dict[str, Makes] = {
    one.__name__: one
    for one in (
        one_lane, slow_clip, one_that_moves, overbridge, straight_ramp, loop_ramp, without_frames, portal_json, persons,
        teleport, auxiliary_lane, twelve_seconds,
    )
}  # fmt: skip
