"""Frames as UDP datagrams."""

import asyncio
from dataclasses import dataclass
from typing import Any

from rampcast.errors import RampcastError
from rampcast.live.frames import FrameError
from rampcast.live.guard import LOOPBACK, TOKEN
from rampcast.live.log import log, log_wrong
from rampcast.live.service import Service


@dataclass
class Datagrams(asyncio.DatagramProtocol):
    """Frames as UDP datagrams, of one or more lines of JSON.

    Attributes:
        host, port: where it listens; off the loopback each frame has to carry the token.
        token: see there.
        wrong: datagrams that held no frame.
    """

    host: str
    port: int
    token: str | None = None
    wrong: int = 0
    _service: Service | None = None

    def __post_init__(self) -> None:
        if self.host not in LOOPBACK and not self.token:
            raise RampcastError(
                f"--source udp://{self.host}: others reach this address; put a token into {TOKEN}, and into each frame"
            )

    async def run(self, service: Service) -> None:
        """Listens until it is cancelled."""
        self._service = service
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=(self.host, self.port))
        log("listening_udp", host=self.host, port=transport.get_extra_info("sockname")[1])
        try:
            await asyncio.Event().wait()
        finally:
            transport.close()

    def datagram_received(self, data: bytes, _: Any) -> None:
        """Takes the frames of a datagram in."""
        assert self._service is not None
        for line in data.splitlines():
            try:
                self._service.receive(line, token=self.token if self.host not in LOOPBACK else None)
            except FrameError as error:
                self.wrong += 1
                log_wrong(self.wrong, "udp", error)
