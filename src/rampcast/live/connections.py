"""Connections of the server: so many at once, none that says nothing, none that takes nothing."""

import asyncio
import contextlib
import math
import resource
import socket
import time
from collections import Counter
from collections.abc import Collection
from typing import Any, Final, cast

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

MOST: Final = 500  # connections at once; each may hold a message of 256 kB
MOST_OF_ONE: Final = 250  # of one address
PATIENCE: Final = 10.0  # [s] in which the head of a request has to come
FAREWELL: Final = 2.0  # [s] that one who was let go has to take what is on its way
BUFFER: Final = 256 * 1024  # bytes that wait in the kernel for one who is slow
SPARE_FILES: Final = 256  # descriptors beside those of connections
AT_ONCE: Final = 64  # connections that are taken, or hung up on, before others have their turn
WAITING: Final = 1024  # connections that wait in the kernel to be taken
RECOUNT: Final = 0.02  # [s] for which a count of those who are in is believed


class Connections(H11Protocol):
    """A connection that is closed where there are too many, or where no request comes."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Takes a connection, or closes it."""
        super().connection_made(cast(asyncio.Transport, transport))
        mine = self.client[0] if self.client else None
        clients = [getattr(one, "client", None) for one in self.connections]
        same = sum(1 for client in clients if client and client[0] == mine)
        if len(self.connections) > MOST or same > MOST_OF_ONE:
            self.transport.abort()
            return
        _bound_buffer(self.transport)
        self.loop.call_later(PATIENCE, self._look)

    def _look(self) -> None:
        """Closes a connection on which no request has come; looks again later at one that is kept open."""
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            return
        waits = self.cycle is None or self.cycle.response_complete
        if waits and self.timeout_keep_alive_task is None:
            self.transport.abort()
            return
        self.loop.call_later(PATIENCE, self._look)


class Listening(socket.socket):
    """A socket that hangs up on who has too many connections, before anything is made for them.

    Ten thousand that come at once would keep the service from all else for seconds, were each taken first.

    Attributes:
        inside: those who are in; they have a `client`.
    """

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.inside: Collection[Any] = ()
        self._clients: Counter[str] = Counter()
        self._counted = -math.inf

    def listen(self, _: int = 0) -> None:
        """Listens; more may wait than are taken at once."""
        super().listen(WAITING)

    def accept(self) -> tuple[socket.socket, Any]:
        """Returns the next connection of one who may have it."""
        if time.monotonic() - self._counted > RECOUNT:
            clients = (getattr(one, "client", None) for one in self.inside)
            self._clients, self._counted = Counter(client[0] for client in clients if client), time.monotonic()
        for _ in range(AT_ONCE):
            connection, address = super().accept()
            self._clients[address[0]] += 1
            if self._clients[address[0]] <= MOST_OF_ONE and self._clients.total() <= MOST:
                return connection, address
            self._clients[address[0]] -= 1
            connection.close()
        raise BlockingIOError("others have their turn")


class WebSockets(WebSocketsSansIOProtocol):
    """A WebSocket whose application can let one go who takes nothing."""

    async def run_asgi(self) -> None:
        """Runs the application."""
        cast(dict[str, Any], self.scope)["extensions"]["rampcast.let_go"] = {"call": self.let_go}
        await super().run_asgi()

    def data_received(self, data: bytes) -> None:
        """Takes what a client sends; nothing more of one that was told why it is sent away."""
        if self.conn.parser_exc is None:
            super().data_received(data)

    def handle_parser_exception(self) -> None:
        """Tells a client why it is sent away, and lets it hear that: to close at once would throw it away."""
        assert self.conn.close_sent is not None
        code, reason = self.conn.close_sent.code, self.conn.close_sent.reason
        self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.transport.resume_reading()
        self.close_timer = self.loop.call_later(FAREWELL, self.transport.abort)

    def let_go(self, code: int, reason: str) -> None:
        """Closes without waiting for what is on its way; after some seconds that is thrown away."""
        if self.close_sent or self.transport.is_closing():
            return
        self.close_sent = True
        self.conn.send_close(code, reason)
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.transport.close()
        self.loop.call_later(FAREWELL, self.transport.abort)


def _bound_buffer(transport: asyncio.Transport) -> None:
    transport.set_write_buffer_limits(high=64 * 1024)
    found = transport.get_extra_info("socket")
    if found is not None:
        with contextlib.suppress(OSError):
            found.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)


def allow_files() -> None:
    """Lets the process have as many descriptors as its connections need, where it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST + SPARE_FILES
    if soft < wanted:
        resource.setrlimit(
            resource.RLIMIT_NOFILE, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard)
        )
