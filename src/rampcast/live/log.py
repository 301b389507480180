"""The log of the service: one line of JSON for each event, on the error stream; no secret is ever handed to it."""

import logging
import sys
import time
from typing import Any, Final

import msgspec

TOLD: Final = 50  # wrong frames of a source that are told of
LONGEST: Final = 300  # letters of what is told

_logger = logging.getLogger("rampcast.live")


def log(event: str, **values: Any) -> None:
    """Writes an event with its values."""
    _logger.info(msgspec.json.encode({"t": round(time.time(), 3), "event": event, **values}).decode())


def write_log() -> None:
    """Lets the log be written to the error stream; a program that has the service inside chooses for itself."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(message)s"))
    _logger.addHandler(handler)
    _logger.setLevel(logging.INFO)
    _logger.propagate = False


def log_wrong(count: int, source: str, error: Exception) -> None:
    """Writes what was wrong with a frame, of the first ones of a source: a broken sensor must not fill the disk."""
    if count <= TOLD:
        log("frame_wrong", source=source, count=count, text=str(error)[:LONGEST])
