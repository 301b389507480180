"""Memory that two processes share and that holds only the newest snapshot: a reader that is slow misses, nobody waits.

A snapshot is written between two counts that differ while it is being written, and carries a checksum: a reader that
finds either wrong has met the writer and looks again.
"""

import mmap
import os
import struct
import zlib
from tempfile import TemporaryFile
from typing import Final

import msgspec
import numpy as np

from rampcast.live.tracks import ARRAYS, Snapshot
from rampcast.traffic.moments import Rows

SLOT: Final = 4 << 20  # bytes of a site: 500 vehicles at 30 Hz for 4 s are 60,000 rows of 64 bytes
HEAD: Final = struct.Struct("<QQQI")  # count before, count after, size, checksum
TRIES: Final = 20  # until a reader gives up until it is told again


class NewestError(Exception):
    """A snapshot does not fit."""


class Newest:
    """A slot for each site in memory that two processes share."""

    def __init__(self, descriptor: int, sites: int) -> None:
        """Maps the memory that `shared_memory` made."""
        self._memory = mmap.mmap(descriptor, SLOT * sites)
        self._written = [0] * sites

    def write(self, site: int, snapshot: Snapshot, note: dict[str, object]) -> None:
        """Puts a snapshot in the place of the one before.

        Raises:
            NewestError: it is larger than a slot.
        """
        body = _packed(snapshot, note)
        if len(body) > SLOT - HEAD.size:
            raise NewestError(f"a snapshot of {len(snapshot.rows.time):,} rows is larger than a slot")
        start, count = site * SLOT, self._written[site] + 1
        self._written[site] = count
        self._memory[start : start + HEAD.size] = HEAD.pack(count, count - 1, len(body), zlib.crc32(body))
        self._memory[start + HEAD.size : start + HEAD.size + len(body)] = body
        self._memory[start : start + HEAD.size] = HEAD.pack(count, count, len(body), zlib.crc32(body))

    def count(self, site: int) -> int:
        """Returns how many snapshots were written so far."""
        return int(HEAD.unpack_from(self._memory, site * SLOT)[1])

    def read(self, site: int) -> tuple[int, Snapshot, dict[str, object]] | None:
        """Returns the newest snapshot with its count and its note; None if there is none, or it is being written."""
        start = site * SLOT
        for _ in range(TRIES):
            before, after, size, checksum = HEAD.unpack_from(self._memory, start)
            if not before:
                return None
            if before != after or size > SLOT - HEAD.size:
                continue
            body = self._memory[start + HEAD.size : start + HEAD.size + size]
            if zlib.crc32(body) == checksum:
                return (int(after), *_unpacked(body))
        return None


def shared_memory(sites: int) -> int:
    """Returns the descriptor of memory for so many sites, which goes when the last process that has it goes."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("rampcast")
    else:
        with TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, SLOT * sites)
    return descriptor


def _packed(snapshot: Snapshot, note: dict[str, object]) -> bytes:
    rows = snapshot.rows
    head = {"n": len(rows.time), "t0": snapshot.t0, "ids": snapshot.ids, "note": note}
    text = msgspec.msgpack.encode(head)
    padded = text + b"\xc0" * (-len(text) % 8)  # of msgpack, nil: arrays begin at a multiple of 8
    arrays = b"".join(_as_eight(getattr(rows, name)) for name in ARRAYS)
    return struct.pack("<QQ", len(text), len(padded)) + padded + arrays


def _as_eight(values: np.ndarray) -> bytes:
    return values.astype(np.int64 if values.dtype.kind in "iu" else np.float64, copy=False).tobytes()


def _unpacked(body: bytes) -> tuple[Snapshot, dict[str, object]]:
    size, padded = struct.unpack_from("<QQ", body)
    head = msgspec.msgpack.decode(body[16 : 16 + size], type=_Head, strict=False)
    kinds = dict.fromkeys(ARRAYS, np.float64) | dict.fromkeys(("vehicle", "lane", "kind"), np.int64)
    arrays = {
        name: np.frombuffer(body, kind, head.n, 16 + padded + 8 * head.n * place)
        for place, (name, kind) in enumerate(kinds.items())
    }
    return Snapshot(Rows(**arrays), head.t0, head.ids), head.note


class _Head(msgspec.Struct):
    n: int
    t0: float
    ids: dict[int, str]
    note: dict[str, object]
