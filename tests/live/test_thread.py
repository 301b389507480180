"""A recording from its file to the messages of a viewer, through real processes and sockets."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator

import polars as pl
import pytest

import rampcast as rc
from rampcast.recording.recording import write_recording
from tests.live.running import WARM, Running, next_of


@pytest.fixture(scope="module")
def running(tmp_path_factory) -> Iterator[Running]:
    raw = rc.read(rc.shipped_sample()[0])
    few = raw.tracks.filter((pl.col("frame") >= 600) & (pl.col("frame") < 1500) & (pl.col("vehicle") % 4 == 0))
    path = tmp_path_factory.mktemp("live") / "few.parquet"
    write_recording(type(raw)(few, raw.site, raw.time_step, raw.source), path)
    service = Running("--source", str(path), "--repeat")
    service.path = path
    service.wait_for("forecaster_ready")
    yield service
    service.stop()


@pytest.mark.slow
def test_a_viewer_gets_states_forecasts_and_status(running):
    with running.live() as socket:
        hello = json.loads(socket.recv())
        assert (hello["type"], hello["levels"]) == ("hello", [0.05, 0.25, 0.5, 0.75, 0.95])
        state = next_of(socket, "state", lambda one: one["vehicles"])
        assert {"id", "x", "y", "v", "lane"} <= state["vehicles"][0].keys()
        forecast = next_of(socket, "forecast", lambda one: one["vehicles"])
        assert next_of(socket, "status")["replay"]["playing"]
    vehicle = forecast["vehicles"][0]
    assert len(vehicle["q"]) == 16
    assert vehicle["q"][0] == [vehicle["x"]] * 5
    for row in vehicle["q"]:
        assert row == sorted(row)
    name = vehicle["id"]
    alone = running.get(f"/v1/sites/simulated/vehicles/{name}/forecast")
    assert alone["vehicle"]["id"] == name


@pytest.mark.slow
def test_a_replay_is_stopped_stepped_and_moved(running):
    running.post("/v1/replay", {"action": "pause"})
    before = running.get("/v1/replay")
    after = running.post("/v1/replay", {"action": "step"})
    assert after["t_obs_ms"] == before["t_obs_ms"] + 100
    with running.live() as socket:
        assert running.post("/v1/replay", {"action": "seek", "value": 80_000})["t_obs_ms"] == 80_000
        forecast = next_of(socket, "forecast", lambda one: one["t_obs_ms"] == 80_000)
    back = running.post("/v1/replay", {"action": "step", "value": -5})
    assert back["t_obs_ms"] == 79_500
    truth = running.get("/v1/replay/truth?from_ms=80000&to_ms=85000")["vehicles"]
    assert {str(one["id"]) for one in forecast["vehicles"]} <= truth.keys()
    running.post("/v1/replay", {"action": "play"})
    assert running.status("/v1/replay", data=b'{"action":"dance"}') == 422


@pytest.mark.slow
def test_the_forecaster_leaves_signals_that_end_the_service_to_it(running):
    (forecaster,) = forecasters_of(running)
    for ending in (signal.SIGTERM, signal.SIGINT):
        os.kill(forecaster, ending)
    with running.live() as socket:
        next_of(socket, "forecast")
    assert forecasters_of(running) == [forecaster]
    assert running.get("/v1/sites/simulated/status")["starts"] == 1


def forecasters_of(running: Running) -> list[int]:
    """Returns the processes that the service has started."""
    found = subprocess.run(["pgrep", "-P", str(running.process.pid)], capture_output=True, text=True, check=True)
    return [int(one) for one in found.stdout.split()]


@pytest.mark.slow
def test_forecasts_are_back_after_the_forecaster_was_killed(running):
    with running.live() as socket:
        next_of(socket, "forecast")
        os.kill(forecasters_of(running)[0], signal.SIGKILL)
        next_of(socket, "status", lambda one: one["stale"] == "forecaster")
        next_of(socket, "state")
        began = time.monotonic()
        next_of(socket, "forecast")
    assert time.monotonic() - began < WARM
    alarms = running.get("/v1/sites/simulated/alarms?after=0")["alarms"]
    assert [one["state"] for one in alarms if one["kind"] == "forecaster_gone"] == ["raised", "cleared"]
