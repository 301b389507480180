"""The WebSockets: forecasts out, frames in, alarms without loss."""

import asyncio
import contextlib
from collections.abc import Coroutine, Mapping
from typing import Any, Final

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from rampcast.forecast.tables import TIMES
from rampcast.live.frames import FrameError
from rampcast.live.guard import Bucket, Guard
from rampcast.live.messages import BINARY, LEVELS, encoded, head
from rampcast.live.service import Service
from rampcast.live.station import Station
from rampcast.live.viewers import KINDS, Viewer

PATIENCE: Final = 5.0  # [s] in which the first message, with the token, has to come
LOOK: Final = 1.0  # [s] between two looks at who is stalled
NOT_HERE, WRONG, TOO_LONG, POLICY, TRY_LATER = 4404, 1007, 1009, 1008, 1013
MOST_VIEWERS: Final = 200  # of a site
FAULTS: Final = 20  # wrong messages of a source in a row, after which it is let go


class First(msgspec.Struct):
    """The first message of a client: the token, what it wants, and the last alarm that it has."""

    token: str | None = None
    want: list[str] | None = None
    after: int = 0


async def live_socket(socket: WebSocket) -> None:
    """Sends state, forecasts and status of a site to a viewer."""
    entered = await _enter(socket, subprotocol=BINARY if BINARY in socket.scope["subprotocols"] else None)
    if entered is None:
        return
    service, station, first = entered
    if len(station.viewers) >= MOST_VIEWERS:
        await _close(socket, TRY_LATER, f"{MOST_VIEWERS} viewers watch already")
        return
    viewer = Viewer(binary=socket.scope["subprotocols"].count(BINARY) > 0, kinds=_kinds(first))
    station.viewers.add(viewer)
    viewer.put("hello", _hello(station))
    if station.latest is not None:
        viewer.put("forecast", station.latest)
    service.say(station)
    try:
        await _first_to_end(_send(socket, viewer), _ignore(socket), _watch(viewer))
        if viewer.is_stalled:
            socket.scope["extensions"]["rampcast.let_go"]["call"](TRY_LATER, "stalled")
    finally:
        station.viewers.remove(viewer)


def _kinds(first: First) -> frozenset[str]:
    wanted = KINDS if first.want is None else first.want
    return frozenset({*wanted} & {*KINDS} | {"hello"})


def _hello(station: Station) -> Any:
    return encoded(head("hello", station.name, levels=LEVELS, horizons_s=TIMES, epoch=station.clock.epoch))


async def _send(socket: WebSocket, viewer: Viewer) -> None:
    loop = asyncio.get_running_loop()
    while True:
        message = await viewer.next()
        viewer.sending_since = loop.time()
        if viewer.binary:
            await socket.send_bytes(message)
        else:
            await socket.send_text(message.decode())
        viewer.sending_since = None


async def _watch(viewer: Viewer) -> None:
    while not viewer.is_stalled:
        await asyncio.sleep(LOOK)


async def _ignore(socket: WebSocket) -> None:
    """Reads until the viewer goes; what it says is of no interest."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while (await socket.receive())["type"] != "websocket.disconnect":
            pass


async def alarm_socket(socket: WebSocket) -> None:
    """Sends every alarm after the one that a client names, and all that come, none left out."""
    entered = await _enter(socket)
    if entered is None:
        return
    _, station, first = entered
    await _first_to_end(_send_alarms(socket, station, first.after), _ignore(socket))


async def _send_alarms(socket: WebSocket, station: Station, after: int) -> None:
    if lost := max(station.alarms.oldest - 1 - after, 0):
        await socket.send_text(encoded(head("lost", station.name, lost=lost)).json.decode())
    while True:
        for alarm in await station.alarms.wait(after):
            await socket.send_text(encoded(alarm).json.decode())
            after = alarm["number"]


async def ingest_socket(socket: WebSocket) -> None:
    """Takes frames in; answers those that are wrong, and says how many it has every second or so."""
    entered = await _enter(socket)
    if entered is None:
        return
    service, station, _ = entered
    bucket, faults = Bucket(), 0
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if not bucket.takes():
                await _close(socket, TRY_LATER, "too many frames a second")
                return
            try:
                service.receive(_bytes(message), station=station)
                faults = 0
            except FrameError as error:
                faults += 1
                if faults >= FAULTS:
                    await _close(socket, WRONG, "too many wrong frames in a row")
                    return
                await socket.send_text(encoded({"type": "error", "v": 1, "error": str(error)[:500]}).json.decode())


async def _enter(socket: WebSocket, subprotocol: str | None = None) -> tuple[Service, Station, First] | None:
    """Returns whom a client asks for, once it has shown its token; None if it was sent away."""
    service, guard = socket.app.state.service, socket.app.state.guard
    address = socket.client.host if socket.client else ""
    await socket.accept(subprotocol=subprotocol)
    if not guard.may_guess(address):
        await _close(socket, POLICY, "too many wrong tokens; wait a minute")
        return None
    first = await _first(socket, guard)
    if first is None:
        return None
    if not guard.has_token(socket.headers) and not guard.is_token(first.token):
        if first.token is not None or "authorization" in socket.headers:
            guard.guessed_wrong(address)
        await _close(socket, POLICY, "the token is wrong or missing")
        return None
    station = service.stations.get(socket.path_params["site"])
    if station is None:
        await _close(socket, NOT_HERE, "there is no such site")
        return None
    return service, station, first


async def _first(socket: WebSocket, guard: Guard) -> First | None:
    """Returns the first message, which clients send that have a token to show, or say `?first=1`."""
    query = socket.query_params
    if "first" not in query and (guard.token is None or guard.has_token(socket.headers)):
        after = query.get("after", "0")
        return First(after=int(after) if after.isdecimal() and len(after) < 16 else 0)
    try:
        async with asyncio.timeout(PATIENCE):
            return msgspec.json.decode(_bytes(await socket.receive()), type=First)
    except TimeoutError:
        await _close(socket, POLICY, f"the first message did not come within {PATIENCE:g} s")
        return None
    except (msgspec.DecodeError, UnicodeDecodeError, WebSocketDisconnect):
        await _close(socket, WRONG, "the first message is not what was expected")
        return None


async def _first_to_end(*runs: Coroutine[Any, Any, None]) -> None:
    """Runs all until one ends, and then ends the others."""
    tasks = [asyncio.ensure_future(run) for run in runs]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    if socket.application_state is not WebSocketState.DISCONNECTED:
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(code, reason)


def _bytes(message: Mapping[str, Any]) -> bytes:
    """Returns what a message of a client holds."""
    text = message.get("text")
    return text.encode() if isinstance(text, str) else message.get("bytes") or b""
