"""Memory of reading good and hostile files: no file may take more than four times its size, and a little.

Where rows are shorter than those of a recording, as in a table of five columns, what they become counts instead.

Each file is read in a process of its own; its peak is what its resident memory grows by above that of the imports.
What an archive holds counts as its size, up to the 50 times of its own at which it is refused.

    python benchmarks/bench_fuzz_memory.py                  every case, files of 30 MB
    python benchmarks/bench_fuzz_memory.py sumo csv         the cases whose names hold one of these words
    python benchmarks/bench_fuzz_memory.py --megabytes 5    smaller files
"""

import argparse
import gzip
import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

PROJECT = Path(__file__).parents[1]
sys.path[:0] = [str(PROJECT), str(Path(__file__).parent)]

from tests.formats.samples import SITE, samples  # noqa: E402
from tests.formats.writers import WRITERS  # noqa: E402

from measure import how_many, print_ratio  # noqa: E402
from rampcast.formats.files.sources import MOST_PACKED, SMALL  # noqa: E402
from rampcast.recording import Recording, write_recording  # noqa: E402
from rampcast.recording import columns as c  # noqa: E402

MOST_TIMES = 4.0  # the size of a file that reading it may take
ROW = 250.0  # [bytes] of memory that a row may take while it becomes one of a recording, which has some 60
MORE = 120.0  # [MB] that reading any file may take beside: chunks under way, the first use of the libraries
LONGEST = 300.0  # [s]
MEGABYTE = 1 << 20
CHILD = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from measure import peak_memory
from rampcast.errors import RampcastError
from rampcast.formats import BadRows, read_all
found = []
def read():
    try:
        recordings, report = read_all([Path(one) for one in sys.argv[4:]], format=sys.argv[2] or None,
                                      bad_rows=BadRows(sys.argv[3]))
        found.extend([report.rows, f"read {report.rows:,} rows"])
    except RampcastError as error:
        found.extend([0, f"refused: {error}"])
peak = peak_memory(read)
print(peak)
print(*found, sep=chr(10))
"""


class Case(NamedTuple):
    """A file, and how it is read: what writes the files to a folder, the format if it is named, and `bad_rows`."""

    write: Callable[[Path, int], list[Path]]
    format: str = ""
    bad_rows: str = "raise"


class Result(NamedTuple):
    """What reading a file took: its size and the peak [MB], the rows read, and what came of it."""

    megabytes: float
    peak: float
    rows: int
    outcome: str

    @property
    def is_bounded(self) -> bool:
        """Returns whether the peak is within four times the size, and a little."""
        return self.peak <= max(MOST_TIMES * self.megabytes, ROW * self.rows / MEGABYTE) + MORE


def traffic(rows: int) -> Recording:
    """Returns about so many rows of vehicles that keep their lane on a short road."""
    seen = 50
    vehicles = max(rows // seen, 1)
    vehicle, frame = np.repeat(np.arange(1, vehicles + 1), seen), np.tile(np.arange(seen), vehicles)
    lane = vehicle % 3 + 1
    tracks = pl.DataFrame(
        {
            c.RECORDING: pl.repeat("short-1", len(vehicle), eager=True),
            c.VEHICLE: vehicle,
            c.FRAME: frame + 2 * vehicle,
            c.X: np.round(frame + 0.013 * (vehicle % 77), 3),
            c.Y: -1.8 - 3.6 * (lane - 1),
            c.LANE: lane,
            c.LENGTH: 4.0 + 0.1 * (vehicle % 10),
            c.WIDTH: 1.8 + 0.01 * (vehicle % 10),
            c.KIND: np.where(vehicle % 9 == 0, "truck", "car"),
        }
    )
    return Recording(tracks.cast(dict(c.SCHEMA)), SITE, 0.1, "made up")


def good(name: str) -> Callable[[Path, int], list[Path]]:
    """Returns what writes a good file of a format, of about so many bytes."""

    def write(folder: Path, size: int) -> list[Path]:
        few = samples()["ngsim text" if name == "ngsim" else name]
        rows = size * 30 // max(map(len, few.files.values()))
        recording = traffic(rows)
        if name == "rampcast":
            write_recording(recording, folder / "own.parquet")
            return [folder / "own.parquet"]
        if name == "ngsim":
            from tests.formats import ngsim_rows

            lines = [ngsim_rows.row(k // 500, k % 500, Local_Y=f"{100 + k % 500:.3f}") for k in range(rows)]
            (folder / "t.txt").write_bytes(ngsim_rows.text(lines))
            return [folder / "t.txt"]
        return WRITERS[name].write(recording, folder)

    return write


def content(name: str, made: Callable[[int], bytes]) -> Callable[[Path, int], list[Path]]:
    """Returns what writes a file of that name, its content made for a size [bytes]."""

    def write(folder: Path, size: int) -> list[Path]:
        (folder / name).write_bytes(made(size))
        return [folder / name]

    return write


def table(size: int) -> bytes:
    """Returns a plain table of one row again and again."""
    header, row = b"vehicle,time,x,y,lane\n", b"%d,%.1f,%.1f,-1.8,1\n"
    rows = (row % (k // 500, k % 500 / 10, 10 + k % 500) for k in range(size // 18))
    return header + b"".join(rows)


def bomb(name: str, line: bytes, header: bytes) -> Callable[[Path, int], list[Path]]:
    """Returns what writes an archive of a tenth of that many bytes that unpacks to a thousand times as much."""

    def write(folder: Path, size: int) -> list[Path]:
        block = line * (MEGABYTE // len(line))
        path = folder / name
        blocks = size // 10 // 1100  # a megabyte packs to some 1,100 bytes
        if name.endswith(".gz"):
            with gzip.open(path, "wb", compresslevel=6) as stream:
                stream.write(header)
                for _ in range(blocks):
                    stream.write(block)
        else:
            with (
                zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
                archive.open("a.csv", "w", force_zip64=True) as stream,
            ):
                stream.write(header)
                for _ in range(blocks):
                    stream.write(block)
        return [path]

    return write


def vehicle(name: str, size: int) -> bytes:
    """Returns I-24 MOTION's json of one vehicle."""
    values = {
        "_id": name,
        "timestamp": [1_669_125_200.0 + 0.04 * k for k in range(size)],
        "x_position": [316_800.0 - 0.01 * k for k in range(size)],
        "y_position": [30.0] * size,
        "direction": -1,
        "coarse_vehicle_class": 0,
    }
    return json.dumps(values).encode()


def holes(size: int) -> bytes:
    """Returns vehicles of two moments each, three days apart: there are six million frames between."""
    one = '{"_id": "%d", "timestamp": [1669125200.0, 1669384400.0], "x_position": [316800, 316700], '
    one += '"y_position": [30, 30], "direction": -1, "coarse_vehicle_class": 0}'
    first = vehicle("first", 50).decode()
    return ("[" + ",".join([first, *(one % k for k in range(size // 170))]) + "]").encode()


FCD = b'<fcd-export>\n<timestep time="0.00">\n'
HEADER = b"vehicle,time,x,y,lane\n"
LAUGHS = b'<!DOCTYPE a [<!ENTITY a "lol">' + b"".join(
    b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(9)
)
CASES = {
    **{f"good {name}": Case(good(name), name) for name in ("rampcast", *WRITERS)},
    "good five columns": Case(content("t.csv", table)),
    "bad rows in all of a csv": Case(
        content("t.csv", lambda size: table(size).replace(b"-1.8", b"-1.x")), "plain", "skip"
    ),
    "bad rows in a tenth of a csv": Case(
        content("t.csv", lambda size: table(size).replace(b"7.0,-1.8", b"7,x")), "plain", "skip"
    ),
    "csv of 100,000 columns": Case(
        content(
            "t.csv", lambda size: HEADER.strip() + b",c" * 100_000 + b"\n" + b"1,0.1,1,1,1" + b",1" * 100_000 + b"\n"
        )
    ),
    "csv of 100,000 named columns": Case(
        content("t.csv", lambda size: b",".join(b"c%d" % k for k in range(100_000)) + b"\n" + b"1,2" * (size // 3)),
    ),
    "csv of 5,000 columns": Case(
        content(
            "t.csv",
            lambda size: (
                HEADER.strip() + b",c" * 4995 + b"\n" + (b"1,0.1,1,1,1" + b",1" * 4995 + b"\n") * (size // 10_000)
            ),
        ),
        "plain",
        "skip",
    ),
    "a quote never closed": Case(content("t.csv", lambda size: HEADER + b'"' + table(size)), "plain", "skip"),
    "quotes in every cell": Case(
        content("t.csv", lambda size: HEADER + b'"1","0.1","1","1","1"\n' * (size // 22)), "plain", "skip"
    ),
    "NULs": Case(content("t.csv", lambda size: HEADER + bytes(size)), "plain", "skip"),
    "blank lines": Case(content("t.csv", lambda size: HEADER + b"\n" * size + table(100)), "plain", "skip"),
    "separators": Case(content("t.csv", lambda size: HEADER + b"," * size), "plain", "skip"),
    "one line without an end": Case(content("t.csv", lambda size: HEADER + b"1" * size), "plain", "skip"),
    "one line and no format": Case(content("t.csv", lambda size: b"1" * size)),
    "zeros and no format": Case(content("t.csv", lambda size: bytes(size))),
    "random bytes": Case(content("t.csv", lambda size: np.random.default_rng(1).bytes(size))),
    "random bytes as NGSIM": Case(content("t.txt", lambda size: np.random.default_rng(1).bytes(size)), "ngsim", "skip"),
    "NGSIM in one line": Case(content("t.txt", lambda size: b"1 " * (size // 2)), "ngsim", "skip"),
    "a zip bomb of rows": Case(bomb("t.zip", b"1,0.1,1,1,1\n", HEADER), "plain", "skip"),
    "a zip bomb of zeros": Case(bomb("t.zip", b"\0" * 4096, HEADER), "plain", "skip"),
    "a gzip bomb of rows": Case(bomb("t.csv.gz", b"1,0.1,1,1,1\n", HEADER), "plain", "skip"),
    "a gzip bomb of zeros": Case(bomb("t.csv.gz", b"\0" * 4096, b"")),
    "a gzip bomb of vehicles": Case(
        bomb("t.json.gz", b'{"_id": 1, "timestamp": [1]},', b'[{"trajectory": "timestamp"},'), "i24", "skip"
    ),
    "a gzip bomb of xml": Case(bomb("t.xml.gz", b'<vehicle id="a" x="1" y="1"/>\n', FCD), "sumo", "skip"),
    "json of one vehicle": Case(content("t.json", lambda size: b"[" + vehicle("a", size // 40) + b"]"), "i24"),
    "json of numbers": Case(content("t.json", lambda size: b"[" + b"1," * (size // 2) + b"1]"), "i24", "skip"),
    "json of one text": Case(content("t.json", lambda size: b'["' + b"a" * size + b'"]'), "i24", "skip"),
    "json of one endless array": Case(content("t.json", lambda size: b"[[" + b"1," * (size // 2)), "i24", "skip"),
    "json of empty objects": Case(content("t.json", lambda size: b"[" + b"{}," * (size // 3) + b"{}]"), "i24", "skip"),
    "json nested": Case(content("t.json", lambda size: b"[" * size), "i24", "skip"),
    "json of holes of days": Case(content("t.json", lambda size: holes(min(size, MEGABYTE))), "i24", "skip"),
    "json of blanks": Case(content("t.json", lambda size: b"[" + b" " * size + b"]"), "i24", "skip"),
    "xml of one attribute": Case(
        content(
            "t.xml", lambda size: FCD + b'<vehicle id="' + b"a" * size + b'" x="1" y="1"/></timestep></fcd-export>'
        ),
        "sumo",
        "skip",
    ),
    "xml of many attributes": Case(
        content(
            "t.xml", lambda size: FCD + b"<vehicle " + b" ".join(b'a%d="1"' % k for k in range(size // 12)) + b"/>"
        ),
        "sumo",
        "skip",
    ),
    "xml nested": Case(content("t.xml", lambda size: FCD + b"<a>" * (size // 3)), "sumo", "skip"),
    "xml of comments": Case(content("t.xml", lambda size: FCD + b"<!-- a -->" * (size // 10)), "sumo", "skip"),
    "xml of one comment": Case(content("t.xml", lambda size: FCD + b"<!--" + b"a" * size), "sumo", "skip"),
    "xml of text": Case(content("t.xml", lambda size: FCD + b"a" * size), "sumo", "skip"),
    "xml in one line": Case(
        content(
            "t.xml", lambda size: FCD.replace(b"\n", b"") + b'<vehicle id="a" x="1" y="1" speed="1"/>' * (size // 40)
        ),
        "sumo",
        "skip",
    ),
    "xml of bad vehicles": Case(
        content(
            "t.xml", lambda size: FCD + b'<vehicle id="a" x="x" y="1"/>\n' * (size // 30) + b"</timestep></fcd-export>"
        ),
        "sumo",
        "skip",
    ),
    "a billion laughs": Case(content("t.xml", lambda size: LAUGHS + b"]><fcd-export>&j;</fcd-export>"), "sumo", "skip"),
    "a billion laughs as CommonRoad": Case(
        content("t.xml", lambda size: LAUGHS + b"]><commonRoad>&j;</commonRoad>"), "commonroad", "skip"
    ),
    "CommonRoad of one obstacle": Case(
        content(
            "t.xml", lambda size: b'<commonRoad timeStepSize="0.1"><dynamicObstacle id="1">' + b"<a/>" * (size // 4)
        ),
        "commonroad",
        "skip",
    ),
    "CommonRoad of one attribute": Case(
        content("t.xml", lambda size: b'<commonRoad a="' + b"a" * size + b'"/>'), "commonroad", "skip"
    ),
    "CommonRoad of tiny lanelets": Case(
        content("t.xml", lambda size: b'<commonRoad timeStepSize="0.1">' + b"<lanelet/>\n" * (size // 11)),
        "commonroad",
        "skip",
    ),
    "CommonRoad of what is nothing": Case(
        content("t.xml", lambda size: b'<commonRoad timeStepSize="0.1">' + b"<what/>\n" * (size // 8)),
        "commonroad",
        "skip",
    ),
    "parquet of a billion rows": Case(lambda folder, size: billion(folder)),
}


def billion(folder: Path) -> list[Path]:
    """Returns a parquet file of a few kilobytes that holds a hundred million equal rows."""
    columns = {
        name: pl.repeat(1, 100_000_000, dtype=pl.Int8, eager=True) for name in ("vehicle", "time", "x", "y", "lane")
    }
    path = folder / "t.parquet"
    pl.DataFrame(columns).write_parquet(path, compression="zstd", row_group_size=100_000_000)
    return [path]


def measured(case: Case, size: int) -> Result:
    """Returns what reading a case's files of about so many bytes takes."""
    with tempfile.TemporaryDirectory(prefix="rampcast-memory-") as folder:
        paths = case.write(Path(folder), size)
        command = [
            sys.executable,
            "-c",
            CHILD,
            str(Path(__file__).parent),
            case.format,
            case.bad_rows,
            *map(str, paths),
        ]
        held = sum(_unpacked(path) for path in paths) / MEGABYTE
        try:
            found = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=True)
        except subprocess.TimeoutExpired:
            return Result(held, float("inf"), 0, f"NOT DONE after {LONGEST:g} s")
        except subprocess.CalledProcessError as error:
            return Result(held, float("inf"), 0, f"FAILED: {error.stderr[-300:]}")
    peak, rows, outcome = found.stdout.split("\n", 2)
    return Result(held, float(peak), int(rows), " ".join(outcome.replace(folder + "/", "").split())[:110])


def _unpacked(path: Path) -> int:
    size = path.stat().st_size
    return max(SMALL, MOST_PACKED * size) if path.suffix in (".gz", ".zip") else size


def main() -> None:
    """Prints what each case takes; the exit code is 1 if one takes too much."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", help="cases: those whose names hold one of these; none for all")
    parser.add_argument("--megabytes", type=float, default=how_many(30, tiny=1), help="size of the files")
    arguments = parser.parse_args()
    words = arguments.words or [""]
    chosen = {name: case for name, case in CASES.items() if any(word in name for word in words)}
    chosen = dict(list(chosen.items())[: how_many(len(CASES), tiny=1)])
    print(f"{'case':32} {'file':>9} {'peak':>9} {'ratio':>6}  (at most {MOST_TIMES:g} times and {MORE:g} MB)")
    too_much, ratios = 0, []
    for name, case in chosen.items():
        result = measured(case, int(arguments.megabytes * MEGABYTE))
        too_much += not result.is_bounded
        mark = " " if result.is_bounded else "!"
        ratio = result.peak / result.megabytes
        ratios.append(ratio)
        print(
            f"{name:32} {result.megabytes:6.1f} MB {result.peak:6.0f} MB {ratio:6.1f}{mark} {result.outcome}",
            flush=True,
        )
    print_ratio("largest peak memory over the size of the file", max(ratios))
    sys.exit(1 if too_much else 0)


if __name__ == "__main__":
    main()
