"""Keeps the process that forecasts alive: starts it, takes its answers, and starts another one when it is gone."""

import asyncio
import contextlib
import os
import socket
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import msgspec

from rampcast.live.log import log
from rampcast.live.newest import Newest, shared_memory
from rampcast.live.work import SIZE, Answer, Work

LONGEST: Final = 32 << 20  # bytes of an answer
HANGS: Final = 120.0  # [s] without an answer, after which the process is ended: it may be compiling
FIRST: Final = 600.0  # [s] without a word before it is ready: compiling anew takes a minute, many on a busy machine
AGAIN: Final = (0.0, 1.0, 5.0, 15.0)  # [s] until it is started anew, longer with each start that came to nothing


@dataclass
class Supervisor:
    """The process that forecasts, and the memory that it shares with this one.

    Attributes:
        work: what it is told.
        answered: called with each of its answers.
        is_ready: whether it takes snapshots now.
        starts: how often it was started.
        newest: the shared memory.
    """

    work: Work
    answered: Callable[[Answer], None]
    is_ready: bool = False
    starts: int = 0
    newest: Newest = field(init=False)
    process: asyncio.subprocess.Process | None = None
    _memory: int = field(init=False)
    _line: socket.socket | None = None
    _asked: float | None = None
    _began: float = 0.0
    _heard: float = 0.0

    def __post_init__(self) -> None:
        self._memory = shared_memory(len(self.work.sites))
        self.newest = Newest(self._memory, len(self.work.sites))

    def tell(self) -> None:
        """Tells the process that there is a new snapshot."""
        if self._line is None or not self.is_ready:
            return
        if self._asked is None:
            self._asked = time.monotonic()
        with contextlib.suppress(OSError):  # full: it will look anyway; broken: it is being replaced
            self._line.send(b"n", socket.MSG_DONTWAIT)

    async def run(self) -> None:
        """Keeps a process running until it is cancelled."""
        failures = 0
        while True:
            await asyncio.sleep(AGAIN[min(failures, len(AGAIN) - 1)])
            try:
                became_ready = await self._one_life()
            finally:
                self._end()
            failures = 0 if became_ready else failures + 1
            log("forecaster_gone", starts=self.starts)
            self.answered(Answer("gone"))

    async def _one_life(self) -> bool:
        """Returns whether the process was ever ready, when it is gone."""
        reader, writer = await self._begun()
        body = msgspec.msgpack.encode(self.work)
        writer.write(SIZE.pack(len(body)) + body)
        guard = asyncio.create_task(self._guard())
        became_ready = False
        try:
            while True:
                answer = await _next(reader)
                self._asked, self._heard = None, time.monotonic()
                if answer.kind == "warming":
                    continue
                if answer.kind == "ready":
                    self.is_ready = became_ready = True
                    log("forecaster_ready", seconds=round(self._heard - self._began, 2))
                self.answered(answer)
                if answer.kind == "ready":
                    self.tell()
        except (asyncio.IncompleteReadError, OSError, ValueError, msgspec.DecodeError):
            return became_ready
        finally:
            guard.cancel()
            writer.close()

    async def _begun(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Returns the line to a new process."""
        ours, theirs = socket.socketpair()
        self.starts, self._began = self.starts + 1, time.monotonic()
        self._heard = self._began
        try:
            with theirs:
                self.process = await asyncio.create_subprocess_exec(
                    sys.executable, "-m", "rampcast.live.worker", str(self._memory), str(theirs.fileno()),
                    pass_fds=(self._memory, theirs.fileno()), stdin=asyncio.subprocess.DEVNULL, start_new_session=True,
                )  # fmt: skip
            ours.setblocking(False)
            line = await asyncio.open_connection(sock=ours)
        except BaseException:  # as when it is cancelled: nobody else knows of the socket yet
            ours.close()
            raise
        self._line = ours
        return line

    async def _guard(self) -> None:
        """Ends a process that says nothing for too long."""
        while True:
            await asyncio.sleep(1.0)
            if self._hangs(time.monotonic()):
                log("forecaster_hangs")
                self._kill()

    def _hangs(self, now: float) -> bool:
        """Returns whether the process has said nothing for too long."""
        if not self.is_ready:
            return now - self._heard > FIRST
        return self._asked is not None and now - self._asked > HANGS

    def _kill(self) -> None:
        if self.process is not None and self.process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self.process.kill()

    def _end(self) -> None:
        self.is_ready, self._line, self._asked = False, None, None
        self._kill()

    async def close(self) -> None:
        """Ends the process and gives the memory back."""
        self._end()
        if self.process is not None:
            await self.process.wait()
        with contextlib.suppress(OSError):
            os.close(self._memory)


async def _next(reader: asyncio.StreamReader) -> Answer:
    (size,) = struct.unpack("<I", await reader.readexactly(SIZE.size))
    if size > LONGEST:
        raise ValueError(f"an answer of {size} bytes")
    return msgspec.msgpack.decode(await reader.readexactly(size), type=Answer)
