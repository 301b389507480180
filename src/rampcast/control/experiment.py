"""Running the plan of an experiment: processes that each drive one run at a time, and files that outlive them."""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import polars as pl

from rampcast.control.controller import Controller
from rampcast.control.outcome import Done
from rampcast.control.own_model import model_of, own_model
from rampcast.control.plan import Job, Plan, with_values
from rampcast.errors import RampcastError
from rampcast.files import check_folder, write_whole
from rampcast.simulate.programs import program
from rampcast.threads import choosing_threads

Tell = Callable[[str, int, int], None]
FOLDER: Final = "runs"  # one json a run
PICTURES: Final = "tracks"  # one parquet for each run that is drawn
DEATHS: Final = 2  # of its process that a run survives


def experiment(plan: Plan, out: Path, *, processes: int | None = None, progress: Tell | None = None) -> Done:
    """Returns what came of a plan, and writes runs.parquet, runs.csv and report.html; finished runs are not run again.

    Args:
        plan: see there.
        out: folder for all files.
        processes: that run side by side; None for one a core.
        progress: called as (what, done, total).

    Raises:
        RampcastError: a run failed, or its process died again and again.
        MissingExtra: SUMO is not installed.
    """
    from rampcast.control.report import write_report

    check_folder(out)
    program("sumo")  # says what to install if it is not there
    tell, count = progress or (lambda what, done, total: None), processes or os.cpu_count() or 1
    tuning, chosen = _tuned(plan, out, count, tell)
    plan = replace(plan, controllers=tuple(with_values(one, chosen) for one in plan.controllers))
    if any(one.knows in ("model", "shuffled") for one in plan.controllers):
        own_model(plan, with_values(Controller("alinea"), chosen).values, out, processes=count, tell=tell)
    jobs = [Job(demand, one, seed, plan) for seed in plan.seeds for demand in plan.demands for one in plan.controllers]
    runs = _table(jobs, run_all(jobs, out, processes=count, tell=tell, what="runs"))
    files = []
    for name, table in (("runs", runs), ("tuning", tuning)):
        if table.height:
            with write_whole(out / f"{name}.parquet") as path:
                table.write_parquet(path)
            with write_whole(out / f"{name}.csv") as path:
                table.write_csv(path)
            files += [out / f"{name}.parquet", out / f"{name}.csv"]
    done = Done(runs, tuning, chosen, plan, tuple(files))
    return replace(done, files=(*files, write_report(done, out)))


def _tuned(plan: Plan, out: Path, count: int, tell: Tell) -> tuple[pl.DataFrame, dict[str, dict[str, float]]]:
    """Returns the runs with which rules were tuned, and the values with the least total time over all demands."""
    tried = [(rule, values) for rule, several in plan.tune.items() for values in several]
    jobs = [
        Job(demand, Controller(rule, label=f"{rule} {json.dumps(values)}", values=values), seed, plan)
        for rule, values in tried
        for demand in plan.demands
        for seed in plan.tune_seeds
    ]
    if not jobs:
        return pl.DataFrame(), {}
    table = _table(jobs, run_all(jobs, out, processes=count, tell=tell, what="tuning"))
    mean = table.group_by("controller").agg(pl.col("total_time").mean())
    times = dict(mean.iter_rows())
    chosen: dict[str, dict[str, float]] = {}
    for rule, several in plan.tune.items():
        chosen[rule] = min(several, key=lambda values: times[f"{rule} {json.dumps(values)}"])
    return table, chosen


def _table(jobs: Sequence[Job], found: dict[str, dict[str, Any]]) -> pl.DataFrame:
    rows = [
        {"demand": one.demand.name, "controller": one.controller.name, "seed": one.seed, **found[one.key]}
        for one in jobs
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def run_all(jobs: Sequence[Job], out: Path, *, processes: int, tell: Tell, what: str) -> dict[str, dict[str, Any]]:
    """Returns the numbers of all runs by their keys; those that lie in the folder are read, not run."""
    (out / FOLDER).mkdir(parents=True, exist_ok=True)
    found = {job.key: numbers for job in jobs if (numbers := _read(out / FOLDER / f"{job.key}.json")) is not None}
    left = list({job.key: job for job in jobs if job.key not in found}.values())
    tell(what, len(found), len(found) + len(left))
    drawn = _drawn(jobs) if what == "runs" else frozenset()
    for key, numbers in _here(left, out, drawn, processes):
        found[key] = numbers
        tell(what, len(found), len({job.key for job in jobs}))
    return found


def _drawn(jobs: Sequence[Job]) -> frozenset[str]:
    """Returns the keys of the runs that are drawn: of the busiest demand and its first seed."""
    if not jobs or not jobs[0].plan.pictures:
        return frozenset()
    busiest = max((job.demand for job in jobs), key=lambda demand: demand.peak)
    return frozenset(job.key for job in jobs if job.demand == busiest and job.seed == jobs[0].plan.seeds[0])


def _read(path: Path) -> dict[str, Any] | None:
    """Returns the numbers of a finished run; None of one that is not there, or cannot be read."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _here(
    jobs: Sequence[Job], out: Path, drawn: frozenset[str], processes: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields keys and numbers as runs are done, by processes that are started anew where one dies."""
    left, deaths = list(jobs), 0
    while left:
        with ProcessPoolExecutor(min(processes, len(left)), mp_context=get_context("spawn")) as pool:
            waiting: dict[Future[dict[str, Any]], Job] = {
                pool.submit(run_job, job, out, job.key in drawn): job for job in left
            }
            try:
                for future in as_completed(waiting):
                    numbers = future.result()
                    left.remove(waiting[future])
                    yield waiting[future].key, numbers
            except BrokenProcessPool as error:
                deaths += 1
                if deaths > DEATHS:
                    raise RampcastError("a process that ran SUMO died three times; finished runs are kept") from error
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def run_job(job: Job, out: Path, drawn: bool) -> dict[str, Any]:
    """Returns the numbers of one run, and writes them into the folder of all runs."""
    from rampcast.control.run import measured

    keep = out / PICTURES / f"{job.key}.parquet" if drawn else None
    load = lambda: _loaded(model_of(job.plan, out))  # noqa: E731
    with choosing_threads(1):
        numbers = measured(job.scenario, job.controller, load=load, samples=job.plan.samples, peak=job.peak, keep=keep)
    with write_whole(out / FOLDER / f"{job.key}.json") as path:
        path.write_text(json.dumps(numbers), encoding="utf-8")
    return numbers


@cache
def _loaded(model: str) -> Any:
    """Returns a forecaster, loaded once a process."""
    import rampcast as rc

    return rc.load(model)
