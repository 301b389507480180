"""Any bytes give recordings or a RampcastError: never another error, a hang, or a row that is not accounted for.

RAMPCAST_FUZZ=thorough pytest tests/formats/test_fuzz.py      tries 300 files where a run of all tests tries 20
RAMPCAST_FUZZ=5000 pytest tests/formats/test_fuzz.py          so many
"""

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from rampcast.errors import RampcastError
from rampcast.formats import FORMATS, BadRows, read_all
from rampcast.recording import read_recording
from tests.formats.reading import check_recordings, converts, damaged_files, read_or_refuse
from tests.formats.samples import samples

pytestmark = pytest.mark.slow

ASKED = os.environ.get("RAMPCAST_FUZZ", "20")
FUZZ = settings(
    max_examples=300 if ASKED == "thorough" else int(ASKED),
    deadline=None if ASKED != "20" else 20_000,  # [ms] some 1000 times what one takes: the machine may be busy
    suppress_health_check=list(HealthCheck),
    database=None,
)
SEEDS = st.integers(0, 2**63)  # of the damage: the damage itself is plain code that a fuzzer uses as well


def refused(call: Callable[[], object]) -> str:
    """Returns why a call refuses what it is given; "" if it does not."""
    try:
        call()
    except RampcastError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("form", samples())
def test_the_good_file_of_every_form_is_read_whole(form, tmp_path):
    sample = samples()[form]
    mapping = tmp_path / sample.mapping if sample.mapping else None
    for site in {sample.site, None}:
        recordings, report = read_all(sample.write(tmp_path), site=site, mapping=mapping)
        check_recordings(recordings, report)
        assert report.rows == report.rows_read


def test_there_are_files_of_every_format():
    assert {sample.format for sample in samples().values()} == set(FORMATS)


@pytest.mark.parametrize("form", samples())
@FUZZ
@given(seed=SEEDS)
def test_a_damaged_file_of_any_form_is_read_or_refused(form, seed):
    random = Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        sample = samples()[form]
        read_or_refuse(sample, Path(folder), damaged_files(sample, random), random)


@pytest.mark.parametrize("form", [form for form, sample in samples().items() if form == sample.format])
@FUZZ
@given(content=st.binary(max_size=300), seed=SEEDS)
@example(content=b"", seed=1)
@example(content=b"PAR1", seed=1)
@example(content=b"PK\x03\x04", seed=1)
@example(content=b"\x1f\x8b", seed=1)
@example(content=b"[", seed=1)
@example(content=b"<", seed=1)
@example(content=b"\xef\xbb\xbf", seed=1)
def test_any_bytes_are_read_or_refused(form, content, seed):
    with tempfile.TemporaryDirectory() as folder:
        sample = samples()[form]
        read_or_refuse(sample, Path(folder), dict.fromkeys(sample.given, content), Random(seed))


@FUZZ
@given(names=st.lists(st.sampled_from(sorted(samples())), min_size=2, max_size=3), seed=SEEDS)
def test_several_files_together_are_read_or_refused(names, seed):
    random = Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for number, name in enumerate(names):
            place = Path(folder) / f"{number}"
            place.mkdir()
            paths += samples()[name].write(
                place, damaged_files(samples()[name], random) if random.random() < 0.3 else {}
            )
        refusal = refused(lambda: check_recordings(*read_all(paths, bad_rows=random.choice(list(BadRows)))))
        assert not refusal or folder in refusal or "given twice" in refusal or "cannot be joined" in refusal


@pytest.mark.parametrize("form", [form for form, sample in samples().items() if FORMATS[sample.format].convert])
@FUZZ
@given(seed=SEEDS)
def test_converting_part_by_part_reads_or_refuses_the_same_files(form, seed):
    random = Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        sample, bad_rows = samples()[form], random.choice(list(BadRows))
        converted = converts(sample.format)
        paths = sample.write(Path(folder), damaged_files(sample, random))
        out = Path(folder) / "out" / "recording.parquet"
        refusal = refused(lambda: read_all(paths, format=sample.format, bad_rows=bad_rows))
        if refusal:
            assert refused(lambda: converted(paths, out, bad_rows=bad_rows)) == refusal
            assert not list(Path(folder).rglob("out/*"))
            return
        recordings, report = read_all(paths, format=sample.format, bad_rows=bad_rows)
        written, same = converted(paths, out, bad_rows=bad_rows)
        assert replace(same, breaches=()) == report
        for recording, path in zip(recordings, written, strict=True):
            assert read_recording(path).tracks.equals(recording.tracks)
