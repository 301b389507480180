"""The page on formats says what the code does."""

from pathlib import Path

from rampcast.formats import FORMATS
from rampcast.recording import columns as c

PROJECT = Path(__file__).parents[2]
PAGE = (PROJECT / "docs" / "formats.md").read_text(encoding="utf-8")


def test_every_format_and_every_column_of_a_recording_is_on_the_page():
    for name in [*FORMATS, *c.SMOOTHED_SCHEMA]:
        assert f"`{name}`" in PAGE


def test_every_format_has_a_page_of_its_own():
    for entry in FORMATS.values():
        assert (PROJECT / entry.page).is_file(), entry.page
