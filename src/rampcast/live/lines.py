"""Frames as lines of JSON: from the input stream, or from the output of another program."""

import asyncio
import contextlib
import sys
from dataclasses import dataclass

from rampcast.live.frames import MOST_BYTES, FrameError
from rampcast.live.log import log_wrong
from rampcast.live.service import Service


@dataclass
class Lines:
    """Frames as lines of JSON on the input stream.

    Attributes:
        wrong: lines that held no frame.
    """

    wrong: int = 0

    async def run(self, service: Service) -> None:
        """Reads until the stream ends."""
        reader = asyncio.StreamReader(limit=MOST_BYTES)
        loop = asyncio.get_running_loop()
        transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        try:
            await self.read(reader, service)
        finally:
            transport.close()

    async def read(self, reader: asyncio.StreamReader, service: Service) -> None:
        """Takes the frames of a stream in; a line that is too long is left out."""
        while True:
            try:
                line = await reader.readuntil(b"\n")
            except asyncio.LimitOverrunError as error:
                with contextlib.suppress(asyncio.IncompleteReadError):
                    await reader.readexactly(error.consumed)
                continue
            except asyncio.IncompleteReadError as error:
                if error.partial.strip():
                    self._take(service, error.partial)
                return
            self._take(service, line)

    def _take(self, service: Service, line: bytes) -> None:
        try:
            service.receive(line)
        except FrameError as error:
            self.wrong += 1
            log_wrong(self.wrong, "lines", error)
