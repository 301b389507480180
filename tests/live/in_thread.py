"""A service in a thread of the test, without the process that forecasts: real sockets, and no forecast."""

import asyncio
import json
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from rampcast.live.guard import Buckets, Guard
from rampcast.live.service import Service
from rampcast.live.serving import Address, _listen, _server
from rampcast.live.station import Station
from rampcast.live.web import application
from rampcast.sites import load_site


class Inside:
    """The service, where it listens, and its loop."""

    def __init__(self, service: Service, port: int) -> None:
        self.service, self.port = service, port
        self.station = next(iter(service.stations.values()))
        self.address = f"http://127.0.0.1:{port}"

    def ask(self, path: str, body: object = None, **headers: str) -> tuple[int, dict, dict]:
        """Returns status, headers and body of an answer."""
        data = None if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
        request = urllib.request.Request(self.address + path, data, headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, dict(answer.headers), _read(answer.read())
        except urllib.error.HTTPError as error:
            with error:
                return error.code, dict(error.headers), _read(error.read())

    def forget_buckets(self) -> None:
        """Lets the service count anew how many frames a second come by POST."""
        self.app.state.buckets = Buckets()

    def ask_quietly(self, path: str) -> int:
        """Returns the status of an answer, 0 where there is none."""
        try:
            return self.ask(path)[0]
        except OSError:
            return 0

    def socket(self, site: str = "i80", door: str = "live") -> str:
        return f"ws://127.0.0.1:{self.port}/v1/sites/{site}/{door}"

    def on_loop(self, call) -> None:
        """Calls something where the service runs."""
        done = threading.Event()
        self.loop.call_soon_threadsafe(lambda: (call(), done.set()))
        assert done.wait(10)


def _read(text: bytes) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return text.decode(errors="replace")


class _NoForecasts:
    """Stands for the process that forecasts."""

    async def run(self) -> None:
        await asyncio.Event().wait()


@contextmanager
def serving(
    *, guard: Guard | None = None, sites: tuple[str, ...] = ("i80",), sources=(), port: int = 0
) -> Iterator[Inside]:
    """Serves while the test asks."""
    service = Service({name: Station(name, load_site(name)) for name in sites}, sources=sources)
    service.supervisor.run = _NoForecasts().run
    address = Address(port=port)
    app = application(service, guard=guard or address.guard)
    listening = _listen(address)
    inside = Inside(service, listening.getsockname()[1])
    inside.app = app
    server = _server(app, replace(address, token=guard.token if guard else None), listening)
    inside.open = server.server_state.connections
    started = threading.Event()

    def run() -> None:
        async def go() -> None:
            inside.loop = asyncio.get_running_loop()
            inside.loop.call_later(0.05, started.set)
            await server.serve(sockets=[listening])

        asyncio.run(go())

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert started.wait(20)
    try:
        yield inside
    finally:
        server.should_exit = True
        thread.join(20)
        listening.close()
