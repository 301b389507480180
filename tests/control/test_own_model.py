"""A model of the road of an experiment: what it learns from, and that it is not learned twice."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rampcast as rc
from rampcast.control import own_model as module
from rampcast.control.controller import Controller
from rampcast.control.own_model import model_of, own_model, record, recording_of
from rampcast.control.plan import OWN, Job, read_plan
from rampcast.errors import RampcastError
from rampcast.recording import columns as c
from rampcast.simulate.corridor import Corridor
from tests.control.made_up import RAMP, past
from tests.control.test_plan import TEXT


def plan(**more):
    return replace(read_plan("tiny"), model=OWN, tune_seeds=(7, 8), corridor=Corridor(approach=300.0), **more)


def test_frames_are_a_recording_of_the_same_places_at_the_same_times():
    frames = [(0.2 * k, past((100.0 + 4.0 * k, 2, 20.0), (280.0 + 2.0 * k, RAMP, 10.0)).newest) for k in range(1, 4)]
    job = Job(plan().demands[0], Controller("none"), 7, plan(step=0.2))
    found = recording_of(frames, job)
    assert found.time_step == 0.2
    assert found.site.simulated
    assert found.names == ["busy-7"]
    mine = found.tracks.filter(found.tracks[c.VEHICLE] == 1)
    assert (mine[c.FRAME] * 0.2).to_list() == pytest.approx([0.2, 0.4, 0.6])
    assert mine[c.X].to_list() == pytest.approx([104.0, 108.0, 112.0])
    assert mine[c.KIND].to_list() == ["car"] * 3


def test_a_model_is_learned_from_runs_with_other_seeds_and_only_once(monkeypatch, tmp_path):
    asked, learned = [], []
    monkeypatch.setattr(module, "_recordings", lambda jobs, *rest: asked.extend(jobs) or ["recording"])
    monkeypatch.setattr(module, "_learn", lambda some, folder, tell: learned.append((some, folder)))
    monkeypatch.setattr(module, "_is_whole", lambda folder: bool(learned))
    given = {"target": 12.0}
    for _ in range(2):
        own_model(plan(), given, tmp_path, processes=1, tell=lambda *_: None)
    assert learned == [(["recording"], tmp_path / "model")]
    assert [job.seed for job in asked] == [7]
    assert not {job.seed for job in asked} & set(plan().seeds)
    own_model(plan(minutes=2.0), given, tmp_path, processes=1, tell=lambda *_: None)
    assert len(learned) == 2  # another road, another model


def test_another_model_is_taken_as_it_is(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "_learn", lambda *_: pytest.fail("nothing is to be learned"))
    own_model(replace(plan(), model="pretrained"), {}, tmp_path, processes=1, tell=lambda *_: None)
    assert model_of(replace(plan(), model="pretrained"), tmp_path) == "pretrained"
    assert model_of(plan(), tmp_path) == str(tmp_path / "model")


def test_runs_depend_on_what_their_model_learned_from():
    one = Job(plan().demands[0], Controller("none"), 1, plan())
    assert one.key != replace(one, plan=replace(plan(), tune_seeds=(9,))).key


def test_a_plan_without_seeds_to_learn_from_is_refused(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(TEXT.replace("seeds = [1, 2]", 'seeds = [1, 2]\nmodel = "own"'))
    with pytest.raises(RampcastError, match='model = "own": it learns from runs with tune_seeds, and there are none'):
        read_plan(path)


@pytest.mark.sumo
@pytest.mark.slow
def test_a_run_is_recorded_and_can_be_read(tmp_path):
    pytest.importorskip("libsumo", reason="needs the extra [sumo]")
    path = tmp_path / "run.parquet"
    done = subprocess.run(
        [sys.executable, "-m", "tests.control.test_own_model", str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = rc.read(path)
    on_ramp = found.tracks[c.LANE].is_in(found.site.ramp_lanes)
    assert on_ramp.any()
    assert not on_ramp.all()
    steps = found.tracks.sort(c.VEHICLE, c.FRAME).select(c.VEHICLE, c.FRAME, c.X).to_numpy()
    same = (np.diff(steps[:, 0]) == 0) & (np.diff(steps[:, 1]) == 1)
    assert np.diff(steps[:, 2])[same].max() < 0.2 * 40.0
    rc.traffic(found, at=60.0)


if __name__ == "__main__":
    record(Job(plan().demands[0], Controller("none"), 7, plan(step=0.2)), Path(sys.argv[1]))
