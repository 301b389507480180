"""Hundreds of files with one thing wrong in each, of every format, and the message that each must bring.

Most faults stand beside the truth of their reader, in the tables of the other tests here; those that several readers
share, and those of archives, parquet files and recordings of rampcast's own, stand in this one.
"""

import gzip
import io
import json
import re
import zipfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec

import polars as pl
import pytest

from rampcast.errors import RampcastError
from rampcast.formats import FORMATS, read_all
from rampcast.recording import columns as c
from rampcast.recording.recording import METADATA_KEY
from rampcast.sites import Site, load_site
from tests.formats.readers import (
    commonroad_faults,
    sumo_faults,
    test_citysim,
    test_commonroad,
    test_exid,
    test_highd,
    test_i24,
    test_i24_mvt,
    test_interaction,
    test_mapping,
    test_ngsim_faults,
    test_plain,
    test_sumo,
    test_tgsim,
)
from tests.formats.samples import MAPPED, MAPPING, samples

LEAST = 200  # distinct faults
LONGEST = 2500  # letters of a message that anybody would read
# What a message says to do, in one way or another: it must hold one of these.
ADVICE = re.compile(
    r"again|[Mm]end|--[a-z]|docs/|[Cc]onvert|[Gg]ive |[Ee]xpected|unpack|Unpack|[Uu]se |meant\?|Was |was |is it |"
    r"[Ss]ay |remove|run SUMO|with_|leave|name its column|Close|[Ll]ist",
)


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        format: whose file it is.
        what: is wrong, in words.
        files: contents by names; a large one is made on use.
        message: a pattern to find in the message.
        given: the files named to the reader; () names all.
        site: to read with.
        is_named: whether the reader is told the format; else it tells it by the content.
        mapping: name of the mapping file; "" where there is none.
    """

    format: str
    what: str
    files: dict[str, bytes | Callable[[], bytes]] = field(repr=False)
    message: str
    given: tuple[str, ...] = ()
    site: Site | None = field(default=None, repr=False)
    is_named: bool = True
    mapping: str = ""

    def __str__(self) -> str:
        return f"{self.format}: {self.what}"


def encoded(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


def described(format: str, module, site: Site | None) -> list[Fault]:
    """Returns the faults of formats whose tracks are described by files beside them."""
    tracks = tuple(name for name in module.FILES if name.endswith("_tracks.csv"))
    faults = []
    for what, (name, old, new, message) in module.FAULTS.items():
        assert old in module.FILES[name], what
        files = module.FILES | {name: module.FILES[name].replace(old, new, 1)}
        contents = {name: text.encode() for name, text in files.items() if text}
        pattern = re.escape(message.removeprefix("no file: "))
        faults.append(Fault(format, what, contents, pattern, tracks, site))
    return faults


def interaction() -> list[Fault]:
    module, faults = test_interaction, []
    for what, (old, new, message) in module.FAULTS.items():
        assert old in module.TRACKS, what
        count = -1 if what == "one moment only" else 1
        content = module.TRACKS.replace(old, new, count).encode()
        faults.append(Fault("interaction", what, {module.NAME: content}, re.escape(message)))
    return faults


def tables(format: str, name: str, faults, site: Site | None = None, *, escape: bool = True, named: bool = True):
    """Returns the faults of a table of (content, message)."""
    return [
        Fault(format, what, {name: encoded(content)}, re.escape(message) if escape else message, (), site, named)
        for what, (content, message) in faults.items()
    ]


def of_readers() -> list[Fault]:
    """Returns the faults of each reader whose test says in FILE what its tables of (content, message) are called."""
    modules = {name: f"tests.formats.readers.test_{name}" for name in FORMATS}
    tests = {name: import_module(module) for name, module in modules.items() if find_spec(module)}
    found = [(name, test) for name, test in tests.items() if hasattr(test, "FILE")]
    return [fault for name, test in found for fault in tables(name, test.FILE, test.FAULTS, test.SITE)]


def i24() -> list[Fault]:
    good = test_i24.vehicle
    vehicles = {
        what: (json.dumps([good("a"), value, good("c")]), message) for what, (value, message) in test_i24.FAULTS.items()
    }
    whole = tables("i24", "i24.json", test_i24.WHOLE_FILES, escape=False)
    return tables("i24", "i24.json", vehicles) + whole


def mapped() -> list[Fault]:
    return [
        Fault(
            "plain",
            f"mapping: {what}",
            {"data.csv": encoded(content), "my.toml": encoded(mapping)},
            re.escape(message).replace(r"\{mapping\}", r".*my\.toml"),
            ("data.csv",),
            is_named=False,
            mapping="my.toml",
        )
        for what, (mapping, content, message) in test_mapping.FAULTS.items()
    ]


def sumo() -> list[Fault]:
    return [
        Fault("sumo", what, {name: content}, message, (), test_sumo.SITE)
        for what, name, content, message in sumo_faults.BAD_ROWS + sumo_faults.FAULTS
    ]


def commonroad() -> list[Fault]:
    return [
        Fault("commonroad", what, {"s.xml": content}, message, (), test_commonroad.SITE)
        for what, content, message, *_ in [*commonroad_faults.BAD_ROWS, *commonroad_faults.FAULTS]
    ]


# What can be wrong with a recording of rampcast's own, as what becomes of its rows and metadata.
OWN_ROWS: dict[str, tuple[Callable[[pl.DataFrame], pl.DataFrame], str]] = {
    "no column of places": (lambda rows: rows.drop(c.X), "expected a column 'x' of type Float64, found none"),
    "no lanes": (lambda rows: rows.drop(c.LANE), "expected a column 'lane' of type Int16, found none"),
    "lanes in words": (lambda rows: rows.cast({c.LANE: pl.String}), "'lane' of type Int16, found String"),
    "frames that are fractions": (
        lambda rows: rows.cast({c.FRAME: pl.Float64}),
        "'frame' of type Int32, found Float64",
    ),
    "kinds that are any words": (lambda rows: rows.cast({c.KIND: pl.String}), "'kind' of type Enum.*found String"),
    "a speed in words": (lambda rows: rows.with_columns(v=pl.lit("fast")), "'v' of type Float64, found String"),
    "a place that is missing": (
        lambda rows: rows.with_columns(pl.lit(None, pl.Float64).alias(c.X)),
        "'x' has cells wit",
    ),
    "a lane that is missing": (
        lambda rows: rows.with_columns(pl.lit(None, pl.Int16).alias(c.LANE)),
        "'lane' has cells",
    ),
    "a place that is no number": (lambda rows: rows.with_columns(pl.lit(float("nan")).alias(c.Y)), "'y' has .*finite"),
    "an endless vehicle": (
        lambda rows: rows.with_columns(pl.lit(float("inf"), pl.Float32).alias(c.LENGTH)),
        "'length' has cells without a finite number",
    ),
    "no rows": (lambda rows: rows.clear(), "a recording without rows"),
}
OWN_METADATA = {
    "metadata that are no json": ("{", "its metadata 'rampcast' is damaged"),
    "metadata that are a list": ("[]", "its metadata 'rampcast' is damaged"),
    "no version": ('{"site": {}}', "its metadata 'rampcast' is damaged .*file_version"),
    "another version": ('{"file_version": 99}', "written in version 99 .* reads version 1; convert the original again"),
    "no site": ('{"file_version": 1}', "its metadata 'rampcast' is damaged .*site"),
    "a site that is not whole": ('{"file_version": 1, "site": {"name": "a"}}', "the value 'title' is missing"),
    "brackets in brackets": ("[" * 5000, "its metadata 'rampcast' is damaged"),
    "no time step": (lambda text: text.replace('"time_step"', '"time"'), "damaged .*time_step"),
    "a time step of zero": (lambda text: text.replace('"time_step": 0.1', '"time_step": 0'), "the time step is 0.0 s"),
    "a time step in words": (lambda text: text.replace('"time_step": 0.1', '"time_step": "x"'), "damaged .*convert"),
}


def own() -> list[Fault]:
    (name, good) = next(iter(samples()["rampcast"].files.items()))
    rows, metadata = pl.read_parquet(io.BytesIO(good)), pl.read_parquet_metadata(io.BytesIO(good))

    def written(table: pl.DataFrame, text: str) -> dict[str, bytes]:
        buffer = io.BytesIO()
        table.write_parquet(buffer, metadata={METADATA_KEY: text})
        return {name: buffer.getvalue()}

    faults = [
        Fault("rampcast", what, written(change(rows), metadata[METADATA_KEY]), message)
        for what, (change, message) in OWN_ROWS.items()
    ]
    for what, (text, message) in OWN_METADATA.items():
        new = text if isinstance(text, str) else text(metadata[METADATA_KEY])
        faults.append(Fault("rampcast", what, written(rows, new), message))
    faults.append(Fault("rampcast", "cut off", {name: good[:-300]}, "a damaged parquet file"))
    faults.append(Fault("rampcast", "a text", {name: b"x,y\n1,2\n"}, "not a parquet file|a damaged parquet file"))
    buffer = io.BytesIO()
    rows.write_parquet(buffer)
    faults.append(Fault("rampcast", "another's parquet", {name: buffer.getvalue()}, "not a rampcast recording; make"))
    return faults


def zipped(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def endless() -> bytes:
    """Returns a table that packs a thousand times."""
    return MAPPED + MAPPED.splitlines(keepends=True)[-1] * 5_000_000


GZ, ZIP = gzip.compress(MAPPED * 50), zipped({"t.csv": MAPPED})
ARCHIVES = {
    "a gzip cut off": (GZ[: len(GZ) // 2], "the archive is damaged or cut off"),
    "a gzip with another checksum": (GZ[:-8] + b"\0\0\0\0" + GZ[-4:], "the archive is damaged or cut off .*CRC"),
    "a gzip of nothing but its head": (GZ[:10], "the archive is damaged or cut off"),
    "a gzip that unpacks without end": (
        lambda: gzip.compress(endless(), 1),
        "more than 50 times as large as its archive",
    ),
    "a zip cut off": (ZIP[:-30], "a damaged zip archive"),
    "a zip of no data": (zipped({"readme.md": b"read me"}), "expected one .* file in the archive, found none"),
    "a zip of nothing": (zipped({}), "expected one .* file in the archive, found none"),
    "a zip of two files": (zipped({"a.csv": MAPPED, "b.csv": MAPPED}), r"found 2: a\.csv, b\.csv\. Unpack it"),
    "a zip whose file is damaged": (ZIP.replace(ZIP[60:90], bytes(30)), "cannot be unpacked|damaged or cut off"),
    "a zip with a password": (
        ZIP.replace(b"PK\x01\x02\x14\x03\x14\x00\x00", b"PK\x01\x02\x14\x03\x14\x00\x01"),
        "password",
    ),
    "a zip that unpacks without end": (
        lambda: zipped({"a.csv": endless()}),
        "more than 50 times as large as its archive",
    ),
}


def archives() -> list[Fault]:
    """Returns the faults of archives, all with one table in them."""
    beside = {"my.toml": MAPPING}
    return [
        Fault("plain", what, {"t.csv": content} | beside, message, ("t.csv",), None, False, "my.toml")
        for what, (content, message) in ARCHIVES.items()
    ]


PAGE = b"<!DOCTYPE html>\n<html><head><title>Sign in</title></head>\n<body>Please sign in.</body></html>\n"
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a2146\nsize 12345\n"
# What can become of a file of any format; the format is told by its content.
ANYWHERE: dict[str, Callable[[bytes], bytes]] = {
    "an empty file": lambda content: b"",
    "blank lines": lambda content: b"\n\n \n",
    "a page to sign in": lambda content: PAGE,
    "a pointer to the file": lambda content: POINTER,
    "in UTF-16": lambda content: content.decode("latin-1").encode("utf-16"),
    "all zeros": lambda content: bytes(len(content)),
    "packed, and that cut off": lambda content: gzip.compress(content)[:-12],
}


TOLD = (  # what is said of them
    r"Tried, the nearest first: |bytes that no text has|UTF-16|the file is empty|cut off|a web page|a pointer to it"
)


def anywhere() -> list[Fault]:
    faults = []
    for form, sample in samples().items():
        name = sample.given[0]
        for what, change in ANYWHERE.items():
            if form == sample.format:  # one form of each is enough
                files = sample.files | {name: change(sample.files[name])}
                faults.append(
                    Fault(
                        form,
                        f"told by content: {what}",
                        files,
                        TOLD,
                        (name,),
                        None,
                        False,
                    )
                )
    return faults


def parquet() -> list[Fault]:
    """Returns the faults of parquet files of the formats whose tables may be such."""
    faults = []
    for form, sample in samples().items():
        if not form.endswith(" parquet"):
            continue
        (name,) = sample.given
        good = sample.files[name]
        rows = pl.read_parquet(io.BytesIO(good))
        place = next(one for one in rows.columns if one in PLACES)
        changes = {
            "parquet: cut off": (good[:-200], "a damaged parquet file .*; get the file again"),
            "parquet: only its name": (b"PAR1", "a damaged parquet file"),
            "parquet: no places": (_parquet(rows.drop(place)), "no column .*(the columns are|docs.formats.plain)"),
            "parquet: places in words": (
                _parquet(rows.with_columns(pl.lit("far").alias(place))),
                f"row 1: {place}: expected a number.*found 'far'",
            ),
            "parquet: lists of places": (
                _parquet(rows.with_columns(pl.concat_list(place, place).alias(place))),
                f"row 1: {place}: expected a number, found the type List",
            ),
            "parquet: a place missing": (
                _parquet(rows.with_columns(_third(place, None))),
                f"row 3: {place}: expected a number.*found 'nothing'",
            ),
            "parquet: an endless place": (
                _parquet(rows.with_columns(_third(place, float("inf")))),
                f"row 3: {place}: expected a number.*found 'inf'",
            ),
            "parquet: no rows": (_parquet(rows.clear()), "a header but no rows"),
        }
        for what, (content, message) in changes.items():
            files = sample.files | {name: content}
            faults.append(Fault(sample.format, what, files, message, (name,), sample.site))
    return faults


PLACES = ("x", "xCenter", "xloc-kf", "headXft", "x_position_meters", "vehicle_x")  # in parquet files of each format


def _third(name: str, value: float | None) -> pl.Expr:
    row = pl.int_range(pl.len())
    return pl.when(row == 2).then(pl.lit(value, pl.Float64)).otherwise(pl.col(name).cast(pl.Float64)).alias(name)


def _parquet(rows: pl.DataFrame) -> bytes:
    buffer = io.BytesIO()
    rows.write_parquet(buffer)
    return buffer.getvalue()


I80 = load_site("i80")
FAULTS = [
    *tables("ngsim", "trajectories.txt", test_ngsim_faults.BAD_ROWS, I80),
    *tables("ngsim", "trajectories.txt", test_ngsim_faults.WHOLE_FILES, I80, escape=False),
    *described("highd", test_highd, None),
    *described("exid", test_exid, test_exid.EASTBOUND),
    *interaction(),
    *of_readers(),
    *tables("tgsim", "tgsim.csv", test_tgsim.FAULTS, test_tgsim.site()),
    *tables("tgsim", "tgsim.csv", test_tgsim.WHOLE_FILES, test_tgsim.site()),
    *tables("plain", "table.csv", test_plain.FAULTS, named=False),
    *tables("citysim", "FreewayC-01.csv", test_citysim.FAULTS, test_citysim.SITE, escape=False),
    *tables("i24_mvt", "mvt.csv", test_i24_mvt.FAULTS),
    *mapped(),
    *i24(),
    *sumo(),
    *commonroad(),
    *own(),
    *archives(),
    *anywhere(),
    *parquet(),
]


def test_there_are_more_than_two_hundred_distinct_faults_and_some_of_every_format():
    distinct = {(fault.format, *sorted(fault.files.items()), fault.mapping) for fault in FAULTS}
    counts = Counter(key[0] for key in distinct)
    assert len(distinct) >= LEAST
    assert set(counts) == set(FORMATS)
    assert min(counts.values()) >= 20, counts
    names = Counter(map(str, FAULTS))
    assert max(names.values()) == 1, names.most_common(3)


@pytest.mark.parametrize("fault", FAULTS, ids=str)
def test_a_fault_is_an_error_that_says_where_what_and_what_to_do(fault, tmp_path):
    for name, content in fault.files.items():
        (tmp_path / name).write_bytes(content() if callable(content) else content)
    paths = [tmp_path / name for name in fault.given or fault.files]
    mapping = tmp_path / fault.mapping if fault.mapping else None
    named = fault.format if fault.is_named else None
    with pytest.raises(RampcastError) as caught:
        read_all(paths, site=fault.site, format=named, mapping=mapping)
    message = str(caught.value)
    assert re.search(f"(?s){fault.message}", message), message
    assert any(str(tmp_path / name) in message for name in fault.files), message
    assert ADVICE.search(message), message
    assert len(message) < LONGEST, message
