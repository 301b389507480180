"""What hostile clients do to the live service, and to those who use it meanwhile.

Run: python benchmarks/attack_live.py [--only NAME ...]

A service with a token takes 10 frames a second of 77 vehicles; three viewers note how long after its frame a state
comes. One attack after another comes from another address of the loopback, in a process of its own. Printed is what the
attackers were answered, the memory of the service before and after, and what the viewers saw. It fails if viewers
missed a fifth of the states, or if memory grew by over 100 MB.
"""

import argparse
import asyncio
import collections
import contextlib
import json
import os
import random
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from live_load import Service, command, measured
from measure import how_many

TOKEN = "a-token-of-more-than-16-letters"
HEADERS = {"authorization": f"Bearer {TOKEN}"}
FROM = "127.0.0.2"  # the attackers' address
SECONDS = 5.0
CONNECTIONS = how_many(10_000, tiny=100)
MOST_GROWN = 100.0  # [MB]
MOST_MISSED = 0.2  # of the states: on a busy machine some are left out for a viewer that is slow itself
NAMED = '"v": 1, "t_ms": 1000, "objects"'

Told = collections.Counter[str]


def main() -> None:
    """Prints a line for each attack."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", choices=[*ATTACKS], nargs="*")
    parser.add_argument("--attack", choices=[*ATTACKS], help=argparse.SUPPRESS)
    parser.add_argument("--address", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.attack:
        print(json.dumps(ATTACKS[chosen.attack](chosen.address)))
    else:
        asyncio.run(all_of(chosen.only or [*ATTACKS]))


async def all_of(names: list[str]) -> None:
    """Runs the attacks, and exits with 1 if something gave way."""
    os.environ["RAMPCAST_TOKEN"] = TOKEN
    service, faults = Service(command("--site", "i80")), []
    calm = await measured(service.address, SECONDS, viewers=3, headers=HEADERS)
    print(f"calm: state out [ms] half, 99 %: {calm.quantile('delays', 0.5):.1f}, {calm.quantile('delays', 0.99):.1f}")
    for name in names:
        before = service.memory()
        attack = asyncio.create_task(attacked(name, service.address))
        seen = await measured(service.address, SECONDS, viewers=3, headers=HEADERS, warm=1.0)
        answers = await attack
        grown, missing = service.memory() - before, 3 * seen.counted - len(seen.delays)
        if grown > MOST_GROWN or missing > MOST_MISSED * 3 * seen.counted:
            faults.append(name)
        delays = ", ".join(f"{seen.quantile('delays', level):.1f}" for level in (0.5, 0.99))
        print(
            f"{name}: answered {answers}; others: state out [ms] half, 99 %: {delays}, {missing} states missing; "
            f"memory {before:.0f} {grown:+.0f} MB",
            flush=True,
        )
    service.stop()
    if faults:
        sys.exit(f"gave way to: {', '.join(faults)}")


async def attacked(name: str, address: str) -> str:
    """Runs an attack in a process of its own; returns what it was answered."""
    run = [sys.executable, __file__, "--attack", name, "--address", address]
    process = await asyncio.create_subprocess_exec(*run, stdout=subprocess.PIPE)
    told, _ = await process.communicate()
    found = json.loads(told)
    return ", ".join(f"{what} x {count}" for what, count in found.items())


def until(seconds: float, act: Callable[[random.Random], str]) -> Told:
    """Returns what became of doing something again and again."""
    ends, chance, told = time.monotonic() + seconds, random.Random(1), Told()
    while time.monotonic() < ends:
        told[act(chance)] += 1
    return told


def closed_with(address: str, *messages: str | bytes, door: str = "ingest", **asked: object) -> str:
    """Returns how the service closes a WebSocket that sends those messages."""
    where = address.replace("http", "ws") + f"/v1/sites/i80/{door}"
    asked = {"additional_headers": HEADERS, **asked}
    try:
        with connect(where, source_address=(FROM, 0), compression=None, close_timeout=1, **asked) as client:
            for message in messages:
                client.send(message)
            while True:
                client.recv(timeout=2)
    except InvalidStatus as refused:
        return f"HTTP {refused.response.status_code}"
    except ConnectionClosed as closed:
        return f"close {closed.rcvd.code if closed.rcvd else 'without a word'}"
    except (TimeoutError, OSError) as error:
        return type(error).__name__


def posted(address: str, body: bytes, path: str = "/v1/sites/i80/tracks", **headers: str) -> str:
    """Returns the status of an answer to a POST, or a GET without a body."""
    where = urlsplit(address)
    request = urllib.request.Request(f"{address}{path}", body or None, {**HEADERS, **headers})
    try:
        with _from_elsewhere(), urllib.request.urlopen(request, timeout=15) as answer:
            return f"HTTP {answer.status}"
    except urllib.error.HTTPError as error:
        with error:
            return f"HTTP {error.code}"
    except OSError as error:
        return f"{type(error).__name__} at {where.hostname}"


@contextlib.contextmanager
def _from_elsewhere():
    """Lets urllib call from the attackers' address."""
    plain = socket.create_connection
    socket.create_connection = lambda address, timeout=None, source_address=None: plain(address, timeout, (FROM, 0))
    try:
        yield
    finally:
        socket.create_connection = plain


def fuzzed_frames(address: str) -> Told:
    """Sends bytes of all sorts, and frames with a letter or two changed."""
    whole = f'{{{NAMED}: [{{"id": 7, "x": 101.2, "y": -23.9, "lane": 7}}]}}'.encode()

    def one(chance: random.Random) -> str:
        messages = []
        for _ in range(20):
            text = bytearray(whole if chance.random() < 0.7 else chance.randbytes(chance.randrange(400)))
            for _ in range(chance.randrange(1, 4)):
                text[chance.randrange(len(text)) if text else 0 : 1] = chance.randbytes(1)
            messages.append(bytes(text))
        return closed_with(address, *messages) if chance.random() < 0.5 else posted(address, messages[0])

    return until(SECONDS, one)


def wrong_values(address: str) -> Told:
    """Sends NaN, infinities, numbers beyond all belief, ids that are lists, names that are none."""
    values = [
        '[{"id": 1, "x": NaN, "y": 0}]', '[{"id": 1, "x": 1e999, "y": 0}]', '[{"id": [1], "x": 1, "y": 0}]',
        '[{"id": {"a": 1}, "x": 1, "y": 0}]', f'[{{"id": {2**70}, "x": 1, "y": 0}}]', '[{"id": 1, "x": "1", "y": 0}]',
        '[{"id": 1, "lat": 91, "lon": 0}]', f'[{{"id": "{"i" * 1000}", "x": 1, "y": 0}}]', "[[[[]]]]", "null",
        "[" + '{"id": 1, "x": 1, "y": 0},' * 600 + '{"id": 2, "x": 1, "y": 0}]', "[" * 100_000,
    ]  # fmt: skip
    return until(SECONDS, lambda chance: posted(address, f"{{{NAMED}: {chance.choice(values)}}}".encode()))


def long_messages(address: str) -> Told:
    """Sends messages of 10 MB."""

    def one(chance: random.Random) -> str:
        return closed_with(address, "x" * 10_000_000) if chance.random() < 0.5 else posted(address, b" " * 10_000_000)

    return until(SECONDS, one)


def slow_loris(address: str) -> Told:
    """Begins 200 requests and says no more."""
    where, told = urlsplit(address), Told()
    slow = [socket.create_connection((where.hostname, where.port), 5, (FROM, 0)) for _ in range(200)]
    for one in slow:
        one.sendall(b"GET /v1/sites HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ")
    for one in slow:
        one.settimeout(20)
        with contextlib.suppress(ConnectionResetError):
            one.recv(100)
        told["hung up"] += 1
        one.close()
    return told


def wrong_origin(address: str) -> Told:
    """Asks as the page of somebody else."""

    def one(chance: random.Random) -> str:
        evil = "https://evil.example"
        if chance.random() < 0.5:
            return closed_with(address, door="live", origin=evil)
        return posted(address, b"{}", origin=evil)

    return until(SECONDS, one)


def many_connections(address: str) -> Told:
    """Tries 10,000 connections, and keeps all that it gets."""
    where, told, kept = urlsplit(address), Told(), []
    for _ in range(CONNECTIONS):
        try:
            kept.append(socket.create_connection((where.hostname, where.port), 5, (FROM, 0)))
        except OSError as error:
            told[type(error).__name__] += 1
            time.sleep(0.001)
        if len(kept) > 5_000:
            kept.pop(0).close()
    told["begun"] = CONNECTIONS - told.total()
    open_now = 0
    for one in kept:
        one.setblocking(False)
        with contextlib.suppress(OSError):
            try:
                open_now += bool(one.recv(1))
            except BlockingIOError:
                open_now += 1
        one.close()
    told["still open at the end"] = open_now
    return told


def stalled_viewers(address: str) -> Told:
    """Watches 50 times, and reads nothing."""
    where = urlsplit(address)
    key = (
        "GET /v1/sites/i80/live HTTP/1.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    )
    key += f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nAuthorization: Bearer {TOKEN}\r\nHost: 127.0.0.1\r\n\r\n"
    stalled = []
    for _ in range(50):
        one = socket.socket()
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.bind((FROM, 0))
        one.connect((where.hostname, where.port))
        one.sendall(key.encode())
        stalled.append(one)
    time.sleep(2 * SECONDS)
    told = Told()
    for one in stalled:
        one.settimeout(2)
        try:
            while one.recv(65_536):
                pass
            told["closed"] += 1
        except ConnectionResetError:
            told["closed"] += 1
        except TimeoutError:
            told["still open"] += 1
        one.close()
    return told


def guessed_tokens(address: str) -> Told:
    """Guesses tokens."""
    return until(
        SECONDS, lambda chance: posted(address, b"", "/v1/sites", authorization=f"Bearer {chance.randbytes(16).hex()}")
    )


ATTACKS = {
    one.__name__: one
    for one in (
        fuzzed_frames,
        wrong_values,
        long_messages,
        slow_loris,
        wrong_origin,
        many_connections,
        stalled_viewers,
        guessed_tokens,
    )
}

if __name__ == "__main__":
    main()
