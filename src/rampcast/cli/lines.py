"""Progress where there is no terminal: a line for each thing done, and of long work the time left."""

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rampcast.forecast.protocol import Progress as Tell

BETWEEN_LINES = 30.0  # [s] of work that is not shown as a bar


def line_by_line(first: str | None, note: Callable[[str], None]) -> Iterator["Tell"]:
    """Gives a function that writes a line for each thing done, and of long ones how long they will take yet.

    What is done when a thing is first told of was done before, and says nothing of how fast the rest is.
    """
    begun: dict[str, tuple[float, int]] = {}
    last: dict[str, float] = {}

    def tell(what: str, done: int, total: int) -> None:
        now = time.monotonic()
        begin, before = begun.setdefault(what, (now, done))
        if done >= total:
            note(f"{what}: done in {now - begin:.0f} s")
        elif done > before and now - last.setdefault(what, begin) > BETWEEN_LINES:
            last[what] = now
            note(f"{what}: {done:,} of {total:,}, about {(now - begin) / (done - before) * (total - done):.0f} s left")

    if first is not None:
        tell(first, 0, 1)
    yield tell
    if first is not None:
        tell(first, 1, 1)
