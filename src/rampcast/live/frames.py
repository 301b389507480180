"""Messages that come in: a frame of a site as its sensors saw it, checked before anything else is done with it."""

import math
from typing import Annotated, Final

import msgspec

from rampcast.errors import RampcastError

VERSION: Final = 1
MOST_OBJECTS: Final = 500  # of a frame
MOST_BYTES: Final = 256 * 1024  # of a message
FARTHEST: Final = 1e6  # [m] of a place, by which a number is nonsense
LATEST: Final = 1 << 53  # [ms], and of whole numbers as ids: beyond, JSON is no longer exact

Id = int | Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
Place = Annotated[float, msgspec.Meta(ge=-FARTHEST, le=FARTHEST)]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=32)]
Told = Annotated[str, msgspec.Meta(max_length=100)] | int | float | bool | None
Few = msgspec.Meta(max_length=20)
Size = Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]


class FrameError(RampcastError):
    """A frame is not what docs/live-messages.md says."""


class Seen(msgspec.Struct):
    """A vehicle as a sensor saw it: on the road (`x`, `y` [m]), or on the earth (`lat`, `lon` [degrees])."""

    id: Id
    x: Place | None = None
    y: Place | None = None
    lat: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)] | None = None
    lon: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)] | None = None
    speed: Annotated[float, msgspec.Meta(ge=-200.0, le=200.0)] | None = None  # [m/s]
    heading: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] | None = None  # [degrees], clockwise from north
    length: Size | None = None
    width: Size | None = None
    class_: Annotated[str, msgspec.Meta(max_length=32)] | None = msgspec.field(name="class", default=None)
    lane: Annotated[int, msgspec.Meta(ge=0, le=999)] | None = None
    advice: Annotated[str, msgspec.Meta(max_length=64)] | None = None  # that it was given


class Frame(msgspec.Struct):
    """All that one sensor, or all of them, saw at one moment.

    Attributes:
        v: version of the message, 1.
        t_ms: the moment, on one clock for the site [ms].
        objects: vehicles.
        site: id of the site; left out where the address names it.
        seq: number of the frame, which its source counts.
        control: what a controller of the site does, in names and values that the page shows; see docs/live-messages.md.
        token: where it comes by UDP from another machine, which has no other place for it.
    """

    v: int
    t_ms: Annotated[int, msgspec.Meta(ge=-LATEST, le=LATEST)] | Annotated[float, msgspec.Meta(ge=-LATEST, le=LATEST)]
    objects: Annotated[list[Seen], msgspec.Meta(max_length=MOST_OBJECTS)]
    site: Annotated[str, msgspec.Meta(max_length=64)] | None = None
    seq: Annotated[int, msgspec.Meta(ge=0, le=LATEST)] | None = None
    control: Annotated[dict[Name, Told | Annotated[dict[Name, Told], Few]], Few] | None = None
    token: Annotated[str, msgspec.Meta(max_length=256)] | None = None


_decoder = msgspec.json.Decoder(Frame)


def frame_of(message: bytes | str) -> Frame:
    """Returns the frame that a message holds.

    Raises:
        FrameError: it is too long, no JSON, or lacks or holds what it may not.
    """
    if len(message) > MOST_BYTES:
        raise FrameError(f"expected a message of at most {MOST_BYTES:,} bytes, got {len(message):,}")
    try:
        return checked(_decoder.decode(message))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:  # a ValidationError is a DecodeError
        raise FrameError(f"the message is no frame of version {VERSION}: {error}") from error


def checked(frame: Frame) -> Frame:
    """Returns a frame whose values fit each other.

    Raises:
        FrameError: they do not.
    """
    if frame.v != VERSION:
        raise FrameError(f"v: expected version {VERSION}, got {frame.v}")
    if not math.isfinite(frame.t_ms):
        raise FrameError(f"t_ms: expected a finite number of milliseconds, got {frame.t_ms}")
    seen = set()
    for number, one in enumerate(frame.objects):
        if one.id in seen:
            raise FrameError(f"objects[{number}].id: {one.id!r} occurs twice in the frame")
        seen.add(one.id)
        if isinstance(one.id, int) and abs(one.id) > LATEST:
            raise FrameError(f"objects[{number}].id: expected a whole number within 2^53, or a text")
        if one.x is None and (one.lat is None or one.lon is None):
            raise FrameError(f"objects[{number}]: expected x and maybe y [m], or lat and lon [degrees]")
    return frame
