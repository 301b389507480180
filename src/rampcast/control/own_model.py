"""A forecaster of the road of an experiment, learned from runs with the seeds that rules are tuned with.

Who forecasts a road has seen it before: a model of other roads, which merge and queue otherwise, is worth no more on
this one than constant speeds (docs/control.md). The runs that are judged are never learned from.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from rampcast.control.controller import Controller
from rampcast.control.loop import Loop
from rampcast.control.plan import OWN, Job, Plan
from rampcast.errors import ModelError, RampcastError
from rampcast.files import write_whole
from rampcast.recording import Recording, clean
from rampcast.recording import columns as c
from rampcast.recording.columns import KINDS
from rampcast.recording.recording import concatenate, write_recording
from rampcast.simulate.plant import driving

Tell = Callable[[str, int, int], None]
FOLDER: Final = "model"
LEARNED_FROM: Final = "learned_from"  # folder of the recordings
MADE_OF: Final = "made_of.txt"  # beside the folder: the keys of the runs that it learned from
TIME_STEP: Final = 0.2  # [s] of these runs


def model_of(plan: Plan, out: Path) -> str:
    """Returns the name, or the folder, of a plan's model."""
    return str(out / FOLDER) if plan.model == OWN else plan.model


def own_model(plan: Plan, values: Mapping[str, float], out: Path, *, processes: int, tell: Tell) -> None:
    """Learns the model of a plan from its own road, where it asks for that, and it was not learned before.

    Args:
        plan: see there.
        values: of ALINEA, under which every second run is driven.
        out: folder for the model.
        processes: that run side by side.
        tell: called as (what, done, total).

    Raises:
        RampcastError: too few follow or merge in these runs to learn from.
    """
    if plan.model != OWN:
        return
    jobs, folder, made_of = _jobs(plan, values), out / FOLDER, out / MADE_OF
    keys = "\n".join(job.key for job in jobs)
    if not (made_of.exists() and made_of.read_text("utf-8") == keys and _is_whole(folder)):
        _learn(_recordings(jobs, out, processes, tell), folder, tell)
        with write_whole(made_of) as path:
            path.write_text(keys, encoding="utf-8")


def _jobs(plan: Plan, values: Mapping[str, float]) -> list[Job]:
    """Returns a run of each demand: the first without control, the next with ALINEA, and so on."""
    rules = (Controller("none"), Controller("alinea", values=dict(values)))
    finer = replace(plan, step=TIME_STEP)
    seeds = plan.tune_seeds
    return [Job(one, rules[k % 2], seeds[k % len(seeds)], finer) for k, one in enumerate(plan.demands)]


def _is_whole(folder: Path) -> bool:
    from rampcast.forecast.storage import load

    try:
        load(folder)
    except ModelError:
        return False
    return True


def _recordings(jobs: Sequence[Job], out: Path, processes: int, tell: Tell) -> list[Recording]:
    """Returns the recordings of runs, each driven in a process of its own, for the sake of libsumo."""
    from rampcast.formats import read

    paths = [out / LEARNED_FROM / f"{job.key}.parquet" for job in jobs]
    left = [(job, path) for job, path in zip(jobs, paths, strict=True) if not path.exists()]
    try:
        with ProcessPoolExecutor(max(1, min(processes, len(left))), mp_context=get_context("spawn")) as pool:
            for done, _ in enumerate(pool.map(record, *zip(*left, strict=True)) if left else (), start=1):
                tell("recording this road", done, len(left))
    except BrokenProcessPool as error:
        told = "a process that ran SUMO died; what was recorded is kept: call the same command again"
        raise RampcastError(told) from error
    return [read(path) for path in paths]


def record(job: Job, path: Path) -> None:
    """Writes what is seen of a run as a recording."""
    with driving(job.scenario) as plant:
        frames = [(moment.time, moment.frame) for moment in Loop(plant, job.controller, seed=job.seed)]
    recording = recording_of(frames, job)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_recording(recording, path)


def recording_of(frames: Sequence[tuple[float, Mapping[str, np.ndarray]]], job: Job) -> Recording:
    """Returns the frames of a run, by time [s], as a recording."""
    names = (c.VEHICLE, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH, c.KIND)
    columns = {name: np.concatenate([frame[name] for _, frame in frames]) for name in names}
    counts = [len(frame[c.X]) for _, frame in frames]
    columns[c.FRAME] = np.repeat([round(time / job.plan.step) for time, _ in frames], counts)
    columns[c.KIND] = np.array(KINDS)[columns[c.KIND]]
    window = pl.lit(f"{job.demand.name}-{job.seed}").alias(c.RECORDING)
    tracks = pl.DataFrame(columns).with_columns(window).select(list(c.SCHEMA)).cast(pl.Schema(c.SCHEMA))
    site = job.scenario.corridor.site
    return Recording(tracks.sort(c.RECORDING, c.VEHICLE, c.FRAME), site, job.plan.step, source="simulated")


def _learn(recordings: Sequence[Recording], folder: Path, tell: Tell) -> None:
    from rampcast.forecast.forecaster import fit
    from rampcast.forecast.storage import save

    told = lambda what, done, total: tell(f"learning this road: {what}", done, total)  # noqa: E731
    save(fit(clean(concatenate(recordings))[0], progress=told), folder)
