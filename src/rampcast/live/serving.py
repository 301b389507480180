"""Serves: puts sites, sources and the web application together, and runs them."""

import asyncio
import contextlib
import ipaddress
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rampcast.errors import MissingExtra, RampcastError
from rampcast.live.frames import MOST_BYTES
from rampcast.live.guard import Guard
from rampcast.live.log import log, write_log
from rampcast.live.service import Choices, Service, Source
from rampcast.live.station import Station

PORT: Final = 8480
HOST: Final = "127.0.0.1"
LEAST_TOKEN: Final = 16  # letters


@dataclass(frozen=True)
class Address:
    """Where the service listens, and who may come in.

    Attributes:
        host, port: of the socket; port 0 takes one that is free.
        certificate, key: files of TLS.
        behind_proxy: whether a proxy in front of it does TLS.
        token: what clients have to know; needed off the loopback.
        hosts: names under which the service may be asked for; those of the loopback always are.
        origins: of pages elsewhere that may use it.
    """

    host: str = HOST
    port: int = PORT
    certificate: Path | None = None
    key: Path | None = None
    behind_proxy: bool = False
    token: str | None = field(default=None, repr=False)
    hosts: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()

    @property
    def guard(self) -> Guard:
        """Returns the rules of who may come in."""
        names = self.hosts or ((self.host,) if self.is_loopback else ())
        return Guard(self.token, names, self.origins)

    @property
    def is_loopback(self) -> bool:
        """Returns whether only programs of this machine reach it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def check(self) -> None:
        """Checks that what others reach asks for a token, and is not read on its way.

        Raises:
            RampcastError: it does not.
        """
        if self.is_loopback:
            return
        if not self.token:
            raise RampcastError(
                f"--host {self.host}: others reach this address, so a token is needed; put one into a file and name it "
                "with --token-file, or into RAMPCAST_TOKEN"
            )
        if len(self.token) < LEAST_TOKEN:
            raise RampcastError(
                f"the token has {len(self.token)} letters; give one of {LEAST_TOKEN} or more, drawn at random"
            )
        if not (self.certificate and self.key) and not self.behind_proxy:
            raise RampcastError(
                f"--host {self.host}: others could read along; give --certificate and --key, or say --behind-proxy if "
                "a proxy in front does TLS"
            )


def serve(
    stations: Sequence[Station],
    *,
    sources: Sequence[Source] = (),
    choices: Choices = Choices(),
    address: Address = Address(),
    page: Path | None = None,
    announce: Callable[[str], None] | None = None,
    logs: bool = True,
) -> None:
    """Serves sites until it is interrupted.

    Args:
        stations: the sites.
        sources: where frames come from, beside clients.
        choices: how it forecasts.
        address: where it listens, and who may come in.
        page: folder of the page; None for the one that comes along.
        announce: called with the address when it listens.
        logs: whether events are written to the error stream.

    Raises:
        RampcastError: the address is not safe, or taken.
        MissingExtra: the extra [live] is not installed.
    """
    address.check()
    try:
        from rampcast.live.web import PAGE, application
    except ImportError as error:
        raise MissingExtra('serving needs more packages; run: pip install "rampcast[live]"') from error
    if logs:
        write_log()
    service = Service({station.name: station for station in stations}, choices, sources)
    app = application(service, guard=address.guard, page=page or PAGE)
    listening = _listen(address)
    where = f"http{'s' if address.certificate else ''}://{_shown(address.host)}:{listening.getsockname()[1]}"
    log("listening", address=where, sites=[*service.stations])
    if announce is not None:
        announce(where)
    _run(_server(app, address, listening), listening)


def _run(server: Any, listening: socket.socket) -> None:
    """Runs a server to its end; Ctrl-C is how one ends it, and no mistake."""
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(server.serve(sockets=[listening]))


def _server(app: Any, address: Address, listening: Any) -> Any:
    """Returns the server of an application, with bounds on all that clients can ask for."""
    import uvicorn

    from rampcast.live.connections import AT_ONCE, Connections, WebSockets, allow_files

    allow_files()
    config = uvicorn.Config(
        app,
        http=Connections,
        ws=WebSockets,
        log_level="warning",
        access_log=False,
        ws_max_size=MOST_BYTES,
        ws_ping_interval=20.0,
        ws_ping_timeout=20.0,
        ws_per_message_deflate=False,  # it ruins the fan-out: 4.7 messages a second to 50 viewers
        server_header=False,
        backlog=AT_ONCE,
        timeout_graceful_shutdown=2,
        ssl_certfile=address.certificate,
        ssl_keyfile=address.key,
        proxy_headers=address.behind_proxy,
    )
    server = uvicorn.Server(config)
    listening.inside = server.server_state.connections
    return server


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _listen(address: Address) -> socket.socket:
    from rampcast.live.connections import Listening

    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    made = Listening(family, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((address.host, address.port))
    except OSError as error:
        made.close()
        raise RampcastError(
            f"{address.host}:{address.port} cannot be listened at: {error.strerror}; another --port?"
        ) from error
    made.listen()
    return made
