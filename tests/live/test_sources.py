"""Where frames come from, as the command line names it."""

from pathlib import Path

import pytest

from rampcast.cli.live import only_site, parts_of
from rampcast.cli.reading import Reading
from rampcast.errors import RampcastError
from rampcast.live.replay import Replay
from tests.formats.readers.test_mapping import DATA, ONE


def parts(*sources: str, sites: tuple[str, ...] = (), mapping: Path | None = None):
    reading = Reading(only_site([*sites]), None, mapping, False)
    return parts_of([*sites], [*sources], [], reading, speed=1.0, repeats=False)


def test_a_recording_in_any_form_that_rampcast_reads_is_a_source(tmp_path):
    (tmp_path / "my.toml").write_text(ONE)
    (tmp_path / "data.csv").write_text(DATA)
    (station,), (source,) = parts(str(tmp_path / "data.csv"), mapping=tmp_path / "my.toml")
    assert isinstance(source, Replay)
    assert source.station == station.name
    assert source.state["last_ms"] > source.state["first_ms"]


def test_what_is_no_source_is_answered_with_what_could_be_one(tmp_path):
    with pytest.raises(RampcastError, match=r"nowhere\.csv: there is no such file"):
        parts("nowhere.csv", sites=("i80",))
    with pytest.raises(RampcastError, match="expected udp://, mqtt://, mqtts://, sumo://, - for lines, or a recording"):
        parts("http://somewhere/frames", sites=("i80",))
    with pytest.raises(RampcastError, match="no site was given"):
        parts("-")
    (tmp_path / "words.txt").write_text("no table at all\n")
    with pytest.raises(RampcastError, match="none of the formats that rampcast knows"):
        parts(str(tmp_path / "words.txt"))
