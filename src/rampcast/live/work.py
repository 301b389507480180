"""What the process that forecasts is told, and what it answers; light to import, so that the other one stays small."""

import struct
from typing import Any, Final

import msgspec

SIZE: Final = struct.Struct("<I")  # before each answer


class WorkerSite(msgspec.Struct):
    """A site that the process forecasts."""

    name: str
    site: dict[str, Any]
    model: str
    recalibrates: bool


class Work(msgspec.Struct):
    """All that the process is told at its beginning."""

    sites: list[WorkerSite]
    degrades: bool = True
    threads: int | None = None


class Answer(msgspec.Struct):
    """What the process gives back.

    Attributes:
        kind: "warming" (a forecast of made-up traffic is done), "ready", "forecast" or "failed".
        site: place of the site in the list.
        json, binary: the message.
        note: seq, epoch, t_obs_ms and t_in_ms of the frame that it is of.
        took: [s].
        risks: see `tick.risks`.
        degraded: what is left out.
        text: of a failure.
    """

    kind: str
    site: int = 0
    json: bytes = b""
    binary: bytes = b""
    note: dict[str, Any] = {}
    took: float = 0.0
    risks: list[Any] = []
    degraded: str | None = None
    text: str = ""
