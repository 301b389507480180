"""A recording from its file to the messages of a viewer, through real processes and sockets."""

import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator

import pytest
from websockets.sync.client import connect

import rampcast as rc
from rampcast.recording.recording import write_recording

RUN = "import sys; from rampcast.cli import main; sys.argv[0] = 'rampcast'; main()"
WARM = 120.0  # [s] of patience with a machine that is busy and compiles


class Running:
    """A service in a process of its own."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-c", RUN, "serve", "--port", "0", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.events: list[dict] = []
        event = self.wait_for("listening")
        self.address = event["address"]

    def wait_for(self, name: str) -> dict:
        for line in self.process.stderr:
            if line.startswith("{"):
                self.events.append(json.loads(line))
                if self.events[-1]["event"] == name:
                    return self.events[-1]
        raise AssertionError(f"the service ended: {self.events} {self.process.stdout.read()}")

    def get(self, path: str) -> dict:
        with urllib.request.urlopen(self.address + path, timeout=10) as answer:
            return json.load(answer)

    def status(self, path: str, **asked) -> int:
        try:
            with urllib.request.urlopen(urllib.request.Request(self.address + path, **asked), timeout=10) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            error.close()
            return error.code

    def post(self, path: str, value: object) -> dict:
        request = urllib.request.Request(self.address + path, json.dumps(value).encode(), method="POST")
        with urllib.request.urlopen(request, timeout=10) as answer:
            return json.load(answer)

    def live(self, **asked):
        return connect(self.address.replace("http", "ws") + "/v1/sites/simulated/live", **asked)

    def stop(self) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(20)
        self.process.stdout.close()
        self.process.stderr.close()


def next_of(socket, kind: str, ready=lambda message: True) -> dict:
    deadline = time.monotonic() + WARM
    while time.monotonic() < deadline:
        message = json.loads(socket.recv(timeout=WARM))
        if message["type"] == kind and ready(message):
            return message
    raise AssertionError(f"no {kind} came")


@pytest.fixture(scope="module")
def running(tmp_path_factory) -> Iterator[Running]:
    raw = rc.read(rc.shipped_sample()[0])
    few = raw.tracks.filter((rc_frame() >= 600) & (rc_frame() < 1500) & (rc_vehicle() % 4 == 0))
    path = tmp_path_factory.mktemp("live") / "few.parquet"
    write_recording(type(raw)(few, raw.site, raw.time_step, raw.source), path)
    service = Running("--source", str(path), "--repeat")
    service.path = path
    service.wait_for("forecaster_ready")
    yield service
    service.stop()


def rc_frame():
    import polars as pl

    return pl.col("frame")


def rc_vehicle():
    import polars as pl

    return pl.col("vehicle")


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
def test_forecasts_are_back_after_the_forecaster_was_killed(running):
    with running.live() as socket:
        next_of(socket, "forecast")
        worker = subprocess.run(
            ["pgrep", "-P", str(running.process.pid)], capture_output=True, text=True, check=True
        ).stdout.split()
        os.kill(int(worker[0]), signal.SIGKILL)
        next_of(socket, "status", lambda one: one["stale"] == "forecaster")
        next_of(socket, "state")
        began = time.monotonic()
        next_of(socket, "forecast")
    assert time.monotonic() - began < WARM
    alarms = running.get("/v1/sites/simulated/alarms?after=0")["alarms"]
    assert [one["state"] for one in alarms if one["kind"] == "forecaster_gone"] == ["raised", "cleared"]
