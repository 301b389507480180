"""The process that forecasts: takes the newest snapshot of each site in turn, and gives messages back.

It is started by `supervisor`, as `python -m rampcast.live.worker`, with two descriptors: the shared memory, and a
socket over which it is told that there is something new, and over which it answers. It ends when that is closed; a
signal that ends the service, and that systemd sends to both, is left to the other one.
"""

import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from select import select as wait_for
from typing import Any, Final

import msgspec
import numpy as np

from rampcast.forecast.forecaster import Forecaster
from rampcast.forecast.storage import load
from rampcast.live.degrading import Degrading
from rampcast.live.frames import VERSION
from rampcast.live.newest import Newest
from rampcast.live.tick import Tick
from rampcast.live.tracks import Snapshot
from rampcast.live.work import SIZE, Answer, Work, WorkerSite
from rampcast.sites import Site
from rampcast.sites.site import NO_LANE, site_from_dict
from rampcast.threads import choosing_threads
from rampcast.traffic.moments import Rows, select

POLITE: Final = 5  # by which it gives way to the process that takes frames in and serves viewers


def main(memory: int, descriptor: int) -> None:
    """Forecasts until the socket is closed."""
    os.nice(POLITE)
    for ending in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ending, signal.SIG_IGN)
    line = socket.socket(fileno=descriptor)
    work = msgspec.msgpack.decode(_exactly(line, SIZE.unpack(_exactly(line, SIZE.size))[0]), type=Work)
    newest = Newest(memory, len(work.sites))
    with choosing_threads(work.threads):
        ticks = _ticks(work)
        for tick in ticks:
            for _ in warm(tick):
                _answer(line, Answer("warming"))
        _answer(line, Answer("ready"))
        _forecast_for_ever(line, newest, ticks)


def _ticks(work: Work) -> list[Tick]:
    """Returns the ticks of all sites: they share their time, and so what is left out where there is too little."""
    forecasters = {name: _forecaster(name) for name in {site.model for site in work.sites}}
    degrading = Degrading(is_on=work.degrades)
    return [_tick(site, forecasters[site.model], degrading) for site in work.sites]


def _forecaster(model: str) -> Forecaster:
    found = load(model if model == "pretrained" else Path(model))
    assert isinstance(found, Forecaster)  # `serve` has looked
    return found


def _tick(site: WorkerSite, forecaster: Forecaster, degrading: Degrading) -> Tick:
    return Tick(site.name, site_from_dict(site.site), forecaster, site.recalibrates, degrading)


def _forecast_for_ever(line: socket.socket, newest: Newest, ticks: list[Tick]) -> None:
    done, again = [0] * len(ticks), [0.0] * len(ticks)
    while True:
        waiting = [place for place in range(len(ticks)) if newest.count(place) != done[place]]
        now = time.monotonic()
        due = [place for place in waiting if again[place] <= now]
        pause = None if not waiting else max(min(again[place] for place in waiting) - now, 0.0)
        if wait_for([line], [], [], 0.0 if due else pause)[0] and not line.recv(4096):
            return
        for place in due:
            found = newest.read(place)
            if found is None:
                continue
            done[place], snapshot, note = found
            again[place] = now + ticks[place].degrading.pause
            _answer(line, _forecast(place, ticks[place], snapshot, note))


def _forecast(place: int, tick: Tick, snapshot: Snapshot, note: dict[str, Any]) -> Answer:
    try:
        message, kept = tick.forecast(snapshot, note)
    except Exception as error:  # one moment that cannot be forecast is no reason to stop
        return Answer("failed", place, note=note, text=f"{type(error).__name__}: {error}")
    tick.degrading.published(time.time() - note["t_in_ms"] / 1e3, time.monotonic())
    return Answer(
        "forecast", place, message.json, message.binary, note, kept["took"], kept["risks"], tick.degrading.told
    )


def warm(tick: Tick) -> Iterator[None]:
    """Forecasts made-up traffic of every sort, so that no real forecast waits for the compiler; yields after each.

    It compiles anew where arrays are of another layout, as they are of a vehicle alone.
    """
    note = {"seq": 0, "epoch": -1, "t_obs_ms": 0.0, "t_in_ms": 1e3 * time.time(), "v": VERSION}
    whole = _made_up(tick.site)
    for there in ((1, 2, 3), (1,), (2,), (2, 3)):
        rows = select(whole.rows, np.flatnonzero(np.isin(whole.rows.vehicle, there)))
        tick.forecast(Snapshot(rows, whole.t0, {}), note)
        yield


def _made_up(site: Site) -> Snapshot:
    """Returns three vehicles that drive at 10 m/s for a second, where the site has a ramp two of them beside it."""
    ramp = site.ramp_lanes or (site.lanes[0].number,)
    target = site.target_lane if site.target_lane != NO_LANE else site.lanes[0].number
    begin = site.gore if site.has_ramp else 0.2 * site.length
    lane = np.repeat([ramp[0], target, target], 11)
    since = np.tile(np.arange(11) / 10, 3)
    rows = Rows(
        vehicle=np.repeat([1, 2, 3], 11),
        time=since,
        x=np.repeat([begin, begin + 20.0, begin - 20.0], 11) + 10.0 * since,
        y=np.array([site.lane_centre(int(one)) for one in lane]),
        lane=lane,
        length=np.full(33, 4.5),
        width=np.full(33, 1.8),
        kind=np.full(33, 1),
    )
    return Snapshot(rows, 1.0, {})


def _exactly(line: socket.socket, size: int) -> bytes:
    parts = b""
    while len(parts) < size:
        part = line.recv(size - len(parts))
        if not part:
            sys.exit(0)
        parts += part
    return parts


def _answer(line: socket.socket, answer: Answer) -> None:
    body = msgspec.msgpack.encode(answer)
    try:
        line.sendall(SIZE.pack(len(body)) + body)
    except (BrokenPipeError, ConnectionResetError):
        sys.exit(0)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
