"""The page on formats says what the code does."""

from pathlib import Path

from rampcast.formats import FORMATS
from rampcast.recording import columns as c

PROJECT = Path(__file__).parents[2]
PAGE = (PROJECT / "docs" / "formats.md").read_text(encoding="utf-8")


OWN = (PROJECT / "docs" / "formats" / "rampcast.md").read_text(encoding="utf-8")


def test_every_format_is_on_the_page_and_every_column_of_a_recording_on_its_own():
    assert [name for name in FORMATS if f"`{name}`" not in PAGE] == []
    assert [name for name in c.SMOOTHED_SCHEMA if f"`{name}`" not in OWN] == []


def test_every_format_has_a_page_of_its_own():
    for entry in FORMATS.values():
        assert (PROJECT / entry.page).is_file(), entry.page
