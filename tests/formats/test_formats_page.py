"""The page on formats says what the code does."""

import runpy
from pathlib import Path

from rampcast.formats import FORMATS
from rampcast.recording import columns as c

PROJECT = Path(__file__).parents[2]
PAGE = (PROJECT / "docs" / "formats.md").read_text(encoding="utf-8")


OWN = (PROJECT / "docs" / "formats" / "rampcast.md").read_text(encoding="utf-8")


def test_every_format_is_on_the_page_and_every_column_of_a_recording_on_its_own():
    assert [name for name in FORMATS if f"`{name}`" not in PAGE] == []
    assert [name for name in c.SMOOTHED_SCHEMA if f"`{name}`" not in OWN] == []


def test_the_table_and_the_menu_are_those_of_the_list():
    script = runpy.run_path(str(PROJECT / "docs" / "scripts" / "formats_pages.py"))
    settings = (PROJECT / "mkdocs.yml").read_text(encoding="utf-8")
    changed = [name for name, text in {"table": PAGE, "menu": settings}.items() if script[f"with_{name}"](text) != text]
    assert changed == [], "run: python docs/scripts/formats_pages.py"


def test_every_format_has_a_page_of_its_own():
    for entry in FORMATS.values():
        assert (PROJECT / entry.page).is_file(), entry.page
