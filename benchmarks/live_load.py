"""Load for the live service: traffic, a service in a process of its own, and viewers that measure what they get."""

import asyncio
import contextlib
import functools
import itertools
import json
import operator
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from websockets.asyncio.client import ClientConnection, connect

RATE = 10  # [1/s]
MAIN, RAMP = 60, 17  # vehicles on the main lanes, and on the ramp
LANES, RAMP_LANE = (2, 3, 4, 5, 6), 7  # of I-80
LENGTH, RAMP_LENGTH = 500.0, 215.0  # [m]
SPEED, RAMP_SPEED = 12.0, 6.0  # [m/s]
OURS = "import sys; from rampcast.cli import main; sys.argv[0] = 'rampcast'; main()"
PLAIN = [sys.executable, str(Path(__file__).parent / "live_plain.py")]


def command(*options: str) -> list[str]:
    """Returns what runs `rampcast serve` with those options at a port that is free."""
    return [sys.executable, "-c", OURS, "serve", "--port", "0", *options]


SERVE = command("--site", "i80")


@dataclass(frozen=True)
class Load:
    """What comes in of one site: vehicles on the main lanes and on the ramp, frames a second."""

    main: int = MAIN
    ramp: int = RAMP
    rate: int = RATE


def frames(begin_ms: int, load: Load) -> Iterator[bytes]:
    """Yields frames for ever from a time on: equal gaps, little noise; who leaves comes in again under a new id."""
    rng = np.random.default_rng(1)
    main, ramp, rate = load.main, load.ramp, load.rate
    lane = np.append(np.array(LANES)[np.arange(main) % len(LANES)], np.full(ramp, RAMP_LANE))
    on_ramp = lane == RAMP_LANE
    last, speed = np.where(on_ramp, RAMP_LENGTH, LENGTH), np.where(on_ramp, RAMP_SPEED, SPEED)
    x = np.where(on_ramp, RAMP_LENGTH / max(ramp, 1) * np.arange(main + ramp), LENGTH / main * np.arange(main + ramp))
    x %= last
    number, fresh = np.arange(main + ramp), itertools.count(main + ramp)
    for tick in itertools.count():
        objects = [
            {"id": one, "x": place, "lane": where, "length": 4.5, "width": 1.8}
            for one, place, where in zip(number.tolist(), np.round(x, 2).tolist(), lane.tolist(), strict=True)
        ]
        yield msgspec.json.encode({"v": 1, "seq": tick, "t_ms": begin_ms + 1000 * tick // rate, "objects": objects})
        x = x + speed / rate + rng.normal(0.0, 0.01, len(x))
        gone = np.flatnonzero(x > last)
        x[gone] -= last[gone]
        number[gone] = [next(fresh) for _ in gone]


class Service:
    """A service in a process of its own; `ready` [s] is how long it took until forecasts could be had."""

    def __init__(self, command: list[str]) -> None:
        began = time.perf_counter()
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        self.address = self._event("listening")["address"]
        self._event("forecaster_ready")
        self.ready = time.perf_counter() - began
        asyncio.get_running_loop().run_in_executor(None, self._drain)

    def _event(self, name: str) -> dict[str, str]:
        for line in self.process.stderr:
            if line.startswith("{") and (event := json.loads(line))["event"] == name:
                return event
        raise RuntimeError(f"the service ended before it was {name}")

    def _drain(self) -> None:
        for _ in self.process.stderr:
            pass

    def status(self, site: str = "i80") -> dict:
        with urllib.request.urlopen(f"{self.address}/v1/sites/{site}/status", timeout=10) as answer:
            return json.load(answer)

    @property
    def children(self) -> list[str]:
        """Returns the numbers of the processes that it started: the one that forecasts."""
        return Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()

    def memory(self) -> float:
        """Returns the resident memory of the service and the process that forecasts [MB]."""
        total = 0
        for one in [str(self.process.pid), *self.children]:
            with contextlib.suppress(OSError):
                lines = Path(f"/proc/{one}/status").read_text().splitlines()
                total += int(next(line for line in lines if line.startswith("VmRSS")).split()[1])
        return total / 1024

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(20)
        self.process.stderr.close()


@dataclass
class Seen:
    """What viewers saw: delays of states [s] from the sending of their frame, ages of forecasts [s], and counts.

    `samples` are the futures of each forecast, `degraded` how many forecasts said that something was left out, `sent`
    all frames and `counted` those after the warming up.
    """

    delays: list[float] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    samples: list[int] = field(default_factory=list)
    sent: int = 0
    counted: int = 0
    forecasts: int = 0
    degraded: int = 0

    def quantile(self, what: str, level: float) -> float:
        """Returns a quantile [ms]; NaN of nothing."""
        values = getattr(self, what)
        return 1e3 * float(np.quantile(values, level)) if values else float("nan")


async def measured(
    address: str,
    seconds: float,
    *,
    viewers: int = 1,
    stalled: int = 0,
    warm: float = 5.0,
    site: str = "i80",
    load: Load = Load(),
    headers: dict[str, str] | None = None,
) -> Seen:
    """Returns what so many viewers see of traffic that is sent for so long, after it has warmed up."""
    seen, times = Seen(), {}
    socket = address.replace("http", "ws") + f"/v1/sites/{site}/"
    begins = time.time() + warm
    async with contextlib.AsyncExitStack() as stack:
        for _ in range(stalled):  # its receive buffer is small, and nobody reads
            await stack.enter_async_context(connected(socket + "live", headers, max_queue=1))
        watching = [
            asyncio.create_task(_watch(connected(socket + "live", headers), times, seen, begins, first=number == 0))
            for number in range(viewers)
        ]
        await asyncio.sleep(0.2)
        source = await stack.enter_async_context(connected(socket + "ingest", headers))
        due = time.time()
        begin_ms = round(1e3 * due)  # so that a second run goes on where the first ended
        for tick, frame in enumerate(frames(begin_ms, load)):
            if due > begins + seconds:
                break
            await asyncio.sleep(max(due - time.time(), 0.0))
            times[begin_ms + 1000 * tick // load.rate] = time.time()
            times.pop(begin_ms + 1000 * (tick - 100) // load.rate, None)
            await source.send(frame.decode())
            seen.sent += 1
            seen.counted += time.time() >= begins
            due += 1.0 / load.rate
        await asyncio.sleep(1.0)
        for task in watching:
            task.cancel()
        await asyncio.gather(*watching, return_exceptions=True)
    return seen


def connected(where: str, headers: dict[str, str] | None = None, **asked: Any) -> connect:
    """Returns a connection to a door of the service."""
    return connect(where, additional_headers=headers, compression=None, max_size=None, **asked)


async def _watch(door: connect, times: dict[int, float], seen: Seen, begins: float, *, first: bool) -> None:
    decoder = msgspec.json.Decoder(_Head)
    async with door as client:
        async for message in client:
            now = time.time()
            told = decoder.decode(message)
            if now < begins:
                continue
            if told.type == "state" and int(told.t_obs_ms) in times:
                seen.delays.append(now - times[int(told.t_obs_ms)])
            elif told.type == "forecast" and first:
                seen.forecasts += 1
                seen.samples.append(told.samples)
                seen.degraded += told.degraded is not None
                seen.ages.append(now - times.get(int(told.t_obs_ms), now))


async def seen_together(runs: list[Coroutine[Any, Any, Seen]]) -> Seen:
    """Returns what was seen of all sites together."""
    parts = await asyncio.gather(*runs)
    names = [one.name for one in fields(Seen)]
    return Seen(*(functools.reduce(operator.add, (getattr(part, name) for part in parts)) for name in names))


async def time_without(service: Service, site: str = "i80") -> tuple[float, float]:
    """Returns after how long [s] viewers are told that the process that forecasts was killed, and forecasts come."""
    sending = asyncio.create_task(measured(service.address, 120.0, viewers=0, warm=0.0, site=site))
    async with connected(f"{service.address.replace('http', 'ws')}/v1/sites/{site}/live") as viewer:
        await _next(viewer, lambda told: told.type == "forecast")
        os.kill(int(service.children[0]), signal.SIGKILL)
        killed = time.time()
        await _next(viewer, lambda told: told.type == "status" and told.stale == "forecaster")
        stale = time.time()
        await _next(viewer, lambda told: told.type == "forecast" and told.t_in_ms > 1e3 * stale)
        back = time.time()
    sending.cancel()
    await asyncio.gather(sending, return_exceptions=True)
    return stale - killed, back - killed


async def _next(viewer: ClientConnection, wanted: Callable[["_Head"], bool]) -> None:
    decoder = msgspec.json.Decoder(_Head)
    async for message in viewer:
        if wanted(decoder.decode(message)):
            return


class _Head(msgspec.Struct):
    """What is read of each message; the rest is skipped."""

    type: str
    t_obs_ms: float = -1.0
    samples: int = 0
    degraded: str | None = None
    stale: str | None = None
    t_in_ms: float = 0.0
