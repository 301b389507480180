"""The log of the service: one line of JSON for each event, on the error stream; no secret is ever handed to it."""

import logging
import sys
import time
from typing import Any

import msgspec

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
