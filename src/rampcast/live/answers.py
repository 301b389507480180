"""Answers of the web application, and how requests are read: bounded in size and in time."""

import asyncio
import math
from collections.abc import Mapping
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from rampcast.live.frames import MOST_BYTES

MOST_DRAINED: Final = 16 << 20  # bytes of a body that is too long that are still read: else nobody hears the answer
PATIENCE: Final = 10.0  # [s] in which a body has to come


class Refusal(Exception):
    """A request that is answered with an error: its status, and a sentence."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status, self.text = status, text


def answer(
    value: Any, *, status: int = 200, kind: str = "application/json", headers: Mapping[str, str] | None = None
) -> Response:
    """Returns an answer that holds a value as JSON."""
    return Response(msgspec.json.encode(value), status_code=status, media_type=kind, headers=headers)


def refused(refusal: Refusal) -> Response:
    """Returns the answer that tells of a refusal."""
    return answer({"error": refusal.text}, status=refusal.status)


async def error_answer(_: Request, error: Exception) -> Response:
    """Returns the answer to a request in which a `Refusal` was raised."""
    assert isinstance(error, Refusal)
    return refused(error)


async def body_of(request: Request) -> bytes:
    """Returns the body of a request.

    Raises:
        Refusal: it is too long, or does not come.
    """
    parts, size = [], 0
    try:
        async with asyncio.timeout(PATIENCE):
            async for part in request.stream():
                size += len(part)
                if size > MOST_DRAINED:
                    break
                if size <= MOST_BYTES:
                    parts.append(part)
    except TimeoutError:
        raise Refusal(408, f"the body did not come within {PATIENCE:g} s") from None
    if size > MOST_BYTES:
        raise Refusal(413, f"expected a body of at most {MOST_BYTES:,} bytes")
    return b"".join(parts)


def number_of(request: Request, name: str, default: float | None = None, *, least: float = -math.inf) -> float:
    """Returns a number of a query.

    Raises:
        Refusal: it is missing, or none.
    """
    text = request.query_params.get(name)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < least:
        raise Refusal(422, f"{name}: expected a number{f' of at least {least:g}' if least > -math.inf else ''}")
    return value
