"""How much the smoothing's look ahead helps: forecasts from histories smoothed with, and without, what came after them.

Run: python benchmarks/history_only.py
The protocol smooths whole recordings, so a state at t = 0 knows of 1 s after it. Here the simulated test window is also
cut off at each anchor and smoothed again, as a program on the road would have to; the truth is the same in both.
"""

from dataclasses import fields, replace
from functools import partial

import numpy as np
import polars as pl

from rampcast.forecasters import positions
from rampcast.horizon import FUTURE, STEP
from rampcast.paper.errors import central_errors
from rampcast.paper.inputs import Inputs
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.predict import continue_at_constant_speed
from rampcast.paper.scenes import Scenes, build_scenes
from rampcast.recording import Recording, clean, read_recording
from rampcast.simulate import shipped_sample

EVERY = 20.0  # [s] between the anchors
SHOWN = (1.0, 2.0, 3.0, 5.0, 10.0, 15.0)  # [s]


def main() -> None:
    """Prints mean absolute errors [m] both ways."""
    raw = read_recording(shipped_sample()[1])
    offline = build_scenes(clean(raw)[0], every=EVERY)
    parts = [cut_off(raw, moment) for moment in np.unique(np.round(offline.t0 / STEP).astype(int))]
    online = join([part for part in parts if part is not None])
    known = {key: row for row, key in enumerate(keys(offline))}
    rows = np.array([known.get(key, -1) for key in keys(online)])
    online, offline = online.select(rows >= 0), offline.select(rows[rows >= 0])
    online = replace(online, future=offline.future, future_valid=offline.future_valid)
    print(f"{len(online)} scenes of simulated window 2; neighbours at constant speed; mean absolute error [m]")
    print(f"{'':<36}{'smoothed with':<18}" + "".join(f"{h:>7.0f} s" for h in SHOWN))
    for label, scenes in (("all of the recording", offline), ("history only", online)):
        errors = central_errors(scenes, forecasts(scenes)).filter(pl.col("horizon").is_in(SHOWN))
        for (model,), found in errors.group_by("model", maintain_order=True):
            print(f"{model:<36}{label:<22}" + "".join(f"{e:>9.2f}" for e in found["mean_error"]))


def cut_off(raw: Recording, moment: int) -> Scenes | None:
    """Returns the scenes at one anchor time, built from what was recorded until then."""
    step = round(STEP / raw.time_step)
    early = (moment - 200) * step, moment * step  # 40 s of history are more than the filter and a scene need
    tracks = raw.tracks.filter(pl.col("frame").is_between(*early))
    smoothed, _ = clean(replace(raw, tracks=tracks))
    scenes = build_scenes(smoothed, every=STEP, future=0)
    scenes = scenes.select(np.round(scenes.t0 / STEP).astype(int) == moment)
    return scenes if len(scenes) else None


def join(parts: list[Scenes]) -> Scenes:
    """Returns the scenes of all parts as one."""
    names = [field.name for field in fields(Scenes) if field.name != "site"]
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def keys(scenes: Scenes) -> list[tuple[int, int]]:
    """Returns vehicle and anchor of each scene."""
    return list(zip(scenes.vehicle[:, 0].tolist(), np.round(scenes.t0 / STEP).astype(int).tolist(), strict=True))


def forecasts(scenes: Scenes) -> dict[str, np.ndarray]:
    """Returns what the models without an LSTM forecast."""

    def no_lane_changes():
        raise NotImplementedError("no model here asks for lane changes")

    neighbours = partial(continue_at_constant_speed, scenes, steps=FUTURE)
    inputs = Inputs(scenes, Mode.CORRECTED, FUTURE, neighbours, no_lane_changes)
    return {name: positions()[name](inputs) for name in ("constant_velocity", *LAWS)}


if __name__ == "__main__":
    main()
