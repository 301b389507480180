"""Who watches a site: each has a queue of two messages, so that one who is slow costs the others nothing."""

import asyncio
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from rampcast.live.messages import Encoded, encoded

QUEUE: Final = 2  # messages of a kind that wait for a viewer
STALLED: Final = 5.0  # [s] that one message may take until its viewer is let go
KINDS: Final = ("state", "forecast", "status")


@dataclass(eq=False)
class Viewer:
    """A queue for one viewer.

    Attributes:
        binary: whether it wants `rampcast.bin.1`.
        kinds: of messages that it wants.
        dropped: messages that were thrown away since it was told.
        sending_since: when the message that it is getting was begun [s]; None between two.
    """

    binary: bool
    kinds: frozenset[str] = frozenset(KINDS)
    dropped: int = 0
    sending_since: float | None = None
    _waiting: deque[tuple[str, Encoded]] = field(default_factory=deque)
    _wake: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, kind: str, message: Encoded) -> bool:
        """Adds a message; returns whether one was dropped, the oldest of its kind, for there were two already."""
        if kind not in self.kinds:
            return False
        same = [place for place, (one, _) in enumerate(self._waiting) if one == kind]
        if len(same) >= QUEUE:
            del self._waiting[same[0]]
            self.dropped += 1
        self._waiting.append((kind, message))
        self._wake.set()
        return len(same) >= QUEUE

    @property
    def is_stalled(self) -> bool:
        """Returns whether the message that it is getting has taken too long."""
        return self.sending_since is not None and time.monotonic() - self.sending_since > STALLED

    async def next(self) -> bytes:
        """Returns the next message; if some were dropped, first one that says so."""
        while not self._waiting:
            self._wake.clear()
            await self._wake.wait()
        if self.dropped:
            told, self.dropped = encoded({"type": "dropped", "v": 1, "dropped": self.dropped}), 0
        else:
            _, told = self._waiting.popleft()
        return told.binary if self.binary else told.json


@dataclass
class Viewers:
    """All who watch one site.

    Attributes:
        dropped: messages that some of them missed.
    """

    _all: set[Viewer] = field(default_factory=set)
    dropped: int = 0

    def __len__(self) -> int:
        return len(self._all)

    def __iter__(self) -> Iterator[Viewer]:
        return iter(tuple(self._all))

    def add(self, viewer: Viewer) -> None:
        """Lets a viewer have what comes."""
        self._all.add(viewer)

    def remove(self, viewer: Viewer) -> None:
        """Lets a viewer go."""
        self._all.discard(viewer)

    def publish(self, kind: str, message: Encoded) -> None:
        """Gives a message to all who want its kind."""
        for viewer in self._all:
            self.dropped += viewer.put(kind, message)
