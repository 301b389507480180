"""Who may come in: tokens, origins, hosts, sizes and rates. All of it is looked at before anything else is done."""

import hmac
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers

TOKEN: Final = "RAMPCAST_TOKEN"  # of the environment: what clients have to know
LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")
RATE: Final = 60.0  # frames a second of one source: twice the 30 Hz that a site may have
BURST: Final = 120.0  # frames at once, as after a pause of a network
GUESSES: Final = 10  # wrong tokens of one address within a minute, after which it has to wait
REMEMBERED: Final = 1_000  # addresses whose guesses, or frames, are counted
CONTENT_SECURITY: Final = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "content-security-policy": CONTENT_SECURITY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


@dataclass
class Guard:
    """Rules of who may come in.

    Attributes:
        token: what a client has to know; None where all who reach the address may come in.
        hosts: names under which the service may be asked for, beside those of the loopback; empty for any.
        origins: of pages elsewhere that may use it.
    """

    token: str | None = None
    hosts: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()
    _guesses: OrderedDict[str, list[float]] = field(default_factory=OrderedDict)

    def knows_host(self, headers: Headers) -> bool:
        """Returns whether the service was asked for by a name of its own: others are pages that rebind a name."""
        if not self.hosts:
            return True
        name = urlsplit(f"//{headers.get('host', '')}").hostname
        return name in LOOPBACK or name in self.hosts

    def knows_origin(self, headers: Headers) -> bool:
        """Returns whether a page that asks is the service's own, or one that was let in; programs send no origin."""
        origin = headers.get("origin")
        if origin is None or origin in self.origins:
            return True
        return urlsplit(origin).netloc == headers.get("host")

    def has_token(self, headers: Headers) -> bool:
        """Returns whether the headers hold the token, or none is needed."""
        if self.token is None:
            return True
        kind, _, given = headers.get("authorization", "").partition(" ")
        return kind.lower() == "bearer" and self.is_token(given)

    def is_token(self, given: object) -> bool:
        """Returns whether that is the token, in a time that does not tell how much of it is right."""
        if self.token is None:
            return True
        return isinstance(given, str) and hmac.compare_digest(given.encode(), self.token.encode())

    def may_guess(self, address: str) -> bool:
        """Returns whether an address has not given too many wrong tokens in the last minute."""
        now = time.monotonic()
        return sum(now - one < 60.0 for one in self._guesses.get(address, ())) < GUESSES

    def guessed_wrong(self, address: str) -> None:
        """Notes that an address gave a wrong token."""
        self._guesses[address] = [*self._guesses.pop(address, [])[-GUESSES:], time.monotonic()]
        while len(self._guesses) > REMEMBERED:
            self._guesses.popitem(last=False)


@dataclass
class Bucket:
    """Lets so many frames a second through, and so many at once."""

    rate: float = RATE
    burst: float = BURST
    _left: float = field(init=False)
    _then: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        self._left = self.burst

    def takes(self) -> bool:
        """Returns whether one more may come now."""
        now = time.monotonic()
        self._left = min(self._left + (now - self._then) * self.rate, self.burst)
        self._then = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass
class Buckets:
    """A bucket for each address that sends frames by POST, of those who came last: who floods costs others none."""

    _all: OrderedDict[tuple[str, str], Bucket] = field(default_factory=OrderedDict)

    def takes(self, site: str, address: str) -> bool:
        """Returns whether one more frame of that address may come to that site now."""
        bucket = self._all.setdefault((site, address), Bucket())
        self._all.move_to_end((site, address))
        while len(self._all) > REMEMBERED:
            self._all.popitem(last=False)
        return bucket.takes()
