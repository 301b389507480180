"""What may go wrong around the service: the source is gone, the disk is full, it is told to end, it warms up slowly."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator

import msgspec
import pytest
from websockets.sync.client import connect

from rampcast.live import supervisor
from rampcast.live.supervisor import Supervisor
from rampcast.live.work import SIZE, Answer, Work, WorkerSite
from tests.live.in_thread import serving
from tests.live.running import RUN, Running, next_of

FRAME = {"v": 1, "t_ms": 0, "objects": [{"id": 1, "x": 100.0, "y": -23.9}]}


def test_a_source_that_is_gone_is_told_within_a_second_or_so_and_so_is_its_return():
    with serving() as inside, connect(inside.socket()) as viewer:
        assert inside.ask("/v1/sites/i80/tracks", FRAME)[0] == 202
        sent = time.monotonic()
        next_of(viewer, "status", lambda one: one["stale"] != "source")
        next_of(viewer, "status", lambda one: one["stale"] == "source")
        assert time.monotonic() - sent < 3.0  # 1.0 to 1.5 s on an idle machine
        assert inside.ask("/v1/sites/i80/tracks", FRAME | {"t_ms": 2_000})[0] == 202
        next_of(viewer, "status", lambda one: one["stale"] != "source")
        alarms = inside.ask("/v1/sites/i80/alarms?after=0")[2]["alarms"]
        assert [one["state"] for one in alarms if one["kind"] == "source_silent"] == ["raised", "cleared"]


def told_port(process: subprocess.Popen) -> str:
    """Returns the address that a service prints."""
    return process.stdout.readline().split()[-1]


@pytest.mark.slow
def test_a_disk_that_is_full_under_the_log_stops_nothing():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-c", RUN, "serve", "--port", "0", "--site", "i80"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=full, text=True)
    try:
        address = told_port(process)
        with connect(address.replace("http", "ws") + "/v1/sites/i80/live") as viewer:
            for wrong in (b"nonsense", b"{}"):
                with pytest.raises(urllib.error.HTTPError, match="422"):
                    urllib.request.urlopen(f"{address}/v1/sites/i80/tracks", wrong)
            urllib.request.urlopen(f"{address}/v1/sites/i80/tracks", json.dumps(FRAME).encode()).close()
            assert next_of(viewer, "state")["vehicles"][0]["id"] == 1
        assert process.poll() is None
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()


SECRET, PASSWORD = "a-token-of-more-than-16-letters", "a-password-of-the-broker"


@pytest.fixture
def running() -> Iterator[Running]:
    """Gives a service with a token, and with a broker that is not there."""
    secrets = {"RAMPCAST_TOKEN": SECRET, "RAMPCAST_MQTT_PASSWORD": PASSWORD}
    service = Running("--site", "i80", "--source", "mqtt://me@127.0.0.1:9/roads", environment=secrets)
    yield service
    if service.process.poll() is None:
        service.stop()


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT])
def test_the_log_says_when_the_service_ends_and_nothing_of_a_forecaster_that_went(running, ending):
    forecaster = forecaster_of(running.process.pid)
    assert os.getsid(forecaster) == forecaster  # so that what a terminal sends to all reaches the service alone
    for path, header in (("/v1/sites", SECRET), (f"/v1/sites?token={SECRET}", "wrong")):
        running.status(path, headers={"authorization": f"Bearer {header}"})
    running.status("/v1/sites/i80/tracks", data=SECRET.encode(), headers={"authorization": f"Bearer {SECRET}"})
    os.kill(running.process.pid, ending)
    log = running.process.stderr.read()
    events = [json.loads(line)["event"] for line in log.splitlines()]  # every line is an event
    assert SECRET not in log
    assert PASSWORD not in log
    assert "broker_gone" in events
    assert running.process.wait(20) in (0, -ending, 128 + ending)
    assert events[-2:] == ["stopping", "stopped"]
    assert "forecaster_gone" not in events
    for stream in (running.process.stdin, running.process.stdout, running.process.stderr):
        stream.close()


def forecaster_of(service: int) -> int:
    """Returns the process that forecasts, once it is there."""
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        found = subprocess.run(["pgrep", "-P", str(service)], capture_output=True, text=True).stdout.split()
        if found:
            return int(found[0])
        time.sleep(0.05)
    raise AssertionError("there is no process that forecasts")


def test_a_forecaster_that_warms_up_slowly_is_left_alone_as_long_as_it_goes_on(monkeypatch):
    """Its limit counts from its last word: a busy machine may take longer in all than the limit for one forecast."""
    warming, ready = (_framed(kind).hex() for kind in ("warming", "ready"))
    script = (
        "import socket, sys; line = socket.socket(fileno=int(sys.argv[2])); line.recv(65536)\n"
        f"line.sendall(bytes.fromhex('{warming}')); line.sendall(bytes.fromhex('{ready}')); line.recv(10)"
    )
    plain, seen = asyncio.create_subprocess_exec, []

    async def instead(program, *arguments, **kept):
        return await plain(program, "-c", script, *arguments[2:], **kept)

    monkeypatch.setattr(asyncio, "create_subprocess_exec", instead)

    async def run() -> Supervisor:
        watched = Supervisor(
            Work([WorkerSite("none", {}, "", False)]), lambda answer: seen.append((answer.kind, watched._heard))
        )
        began = time.monotonic()
        task = asyncio.create_task(watched.run())
        async with asyncio.timeout(30):
            while not seen:
                await asyncio.sleep(0.02)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await watched.close()
        assert seen[0][0] == "ready"
        assert seen[0][1] > began
        return watched

    watched = asyncio.run(run())
    watched._heard = 1_000.0  # its last word before it is ready
    assert not watched._hangs(1_000.0 + supervisor.FIRST - 1.0)
    assert watched._hangs(1_000.0 + supervisor.FIRST + 1.0)
    watched.is_ready, watched._asked = True, None
    assert not watched._hangs(1e9)
    watched._asked = 1_000.0
    assert watched._hangs(1_000.0 + supervisor.HANGS + 1.0)


def _framed(kind: str) -> bytes:
    body = msgspec.msgpack.encode(Answer(kind))
    return SIZE.pack(len(body)) + body


def test_a_forecaster_that_is_given_up_while_it_begins_leaves_no_line_open(monkeypatch):
    made, plain = [], socket.socketpair

    def pair() -> tuple[socket.socket, socket.socket]:
        made.extend(plain())
        return made[0], made[1]

    async def never(*_: object, **__: object) -> None:
        await asyncio.sleep(60.0)

    async def run() -> None:
        watched = Supervisor(Work([WorkerSite("none", {}, "", False)]), lambda answer: None)
        with monkeypatch.context() as patch:
            patch.setattr(socket, "socketpair", pair)
            patch.setattr(asyncio, "create_subprocess_exec", never)
            task = asyncio.create_task(watched.run())
            while not made:
                await asyncio.sleep(0.01)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        await watched.close()

    asyncio.run(run())
    assert [one.fileno() for one in made] == [-1, -1]
