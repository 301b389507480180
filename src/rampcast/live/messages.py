"""Messages that go out: JSON, and the same in msgpack with places in decimetres (`rampcast.bin.1`).

docs/live-messages.md says what is in them.
"""

from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np

from rampcast.forecast.tables import BANDS
from rampcast.live.frames import VERSION
from rampcast.recording import columns as c

BINARY: Final = "rampcast.bin.1"  # the subprotocol of a WebSocket
LEVELS: Final = tuple(BANDS.values())
DECIMETRES: Final = 10.0
MILLIMETRES: Final = 3  # decimals of places [m]
BYTE: Final = 255.0

_json = msgspec.json.Encoder()
_packed = msgspec.msgpack.Encoder()


@dataclass(frozen=True)
class Encoded:
    """One message in both forms, encoded once for all who get it."""

    json: bytes
    binary: bytes


def encoded(message: dict[str, Any]) -> Encoded:
    """Returns a message without forecasts in both forms."""
    return Encoded(_json.encode(message), _packed.encode(message))


def encoded_forecast(message: dict[str, Any], vehicles: list[dict[str, Any]]) -> Encoded:
    """Returns the message of a forecast in both forms.

    Args:
        message: all but its vehicles.
        vehicles: what `vehicles_of` gave.
    """
    both = [_two_forms(one) for one in vehicles]
    return Encoded(
        _json.encode(message | {"vehicles": [one for one, _ in both]}),
        _packed.encode(message | {"vehicles": [one for _, one in both]}),
    )


def _two_forms(vehicle: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    q, p = vehicle["q"], vehicle["p_merged"]
    moved = np.clip(np.rint((q - vehicle["x"]) * DECIMETRES), -32768, 32767).astype("<i2").tobytes()
    shares = None if p is None else np.rint(p * BYTE).astype(np.uint8).tobytes()
    plain = vehicle | {
        "q": np.round(q, MILLIMETRES).tolist(),
        "p_merged": None if p is None else np.round(p, 3).tolist(),
    }
    return plain, vehicle | {"q": moved, "p_merged": shares}


def head(kind: str, site: str, **more: Any) -> dict[str, Any]:
    """Returns what every message of a site begins with."""
    return {"type": kind, "v": VERSION, "site": site, **more}


def kind_name(number: int) -> str:
    """Returns the name of a kind of vehicle."""
    return c.KINDS[number]


def known(value: float) -> float | None:
    """Returns a number, or None for one that is not known: JSON has no NaN."""
    return value if value == value else None
