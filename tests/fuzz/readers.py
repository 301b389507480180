"""A fuzzer that is led by the code it reaches, beside the blind one of `tests/formats/test_fuzz.py`.

pip install "rampcast[fuzz]"
python -m tests.fuzz.readers csv -max_total_time=1200      or json, or xml; the options are libFuzzer's

An input that is neither read nor refused ends it with a traceback, and is kept as crash-... in the working folder.
"""

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["rampcast.formats", "rampcast.roads", "rampcast.recording"]):
    from rampcast.errors import RampcastError
    from rampcast.formats import BadRows, read_all

from tests.formats.reading import check_recordings
from tests.formats.samples import samples

LARGEST = 20_000  # bytes of an input
TIMEOUT, MEMORY = 60, 4096  # [s, MB] of one input


def seeds(suffix: str, folder: Path) -> None:
    """Writes the small good files of a suffix."""
    for form, sample in samples().items():
        for name in sample.given:
            if name.endswith(suffix):
                (folder / f"{form.replace(' ', '-')}-{name}").write_bytes(sample.files[name])


def fuzz(suffix: str, options: list[str]) -> None:
    """Fuzzes whatever is read from files of a suffix, until libFuzzer's options end it."""
    with tempfile.TemporaryDirectory() as folder:
        corpus, path = Path(folder) / "corpus", Path(folder) / f"data{suffix}"
        corpus.mkdir()
        seeds(suffix, corpus)

        def once(content: bytes) -> None:
            path.write_bytes(content)
            bad_rows = BadRows.SKIP if len(content) % 2 else BadRows.RAISE
            try:
                check_recordings(*read_all([path], bad_rows=bad_rows))
            except RampcastError as error:
                assert str(path) in str(error), error  # noqa: PT017

        limits = [f"-max_len={LARGEST}", f"-timeout={TIMEOUT}", f"-rss_limit_mb={MEMORY}"]
        atheris.Setup([sys.argv[0], *limits, *options, str(corpus)], once)
        atheris.Fuzz()


if __name__ == "__main__":
    fuzz(f".{sys.argv[1]}", sys.argv[2:])
