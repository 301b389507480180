"""The names that `rampcast download` knows."""

import re
from pathlib import Path

import pytest

from rampcast.download import CATALOGUE, data_set
from rampcast.errors import DownloadError
from rampcast.formats import FORMATS
from rampcast.sites import load_site

DOCS = Path(__file__).parents[2] / "docs"
OPEN = [entry for entry in CATALOGUE.values() if not entry.ask]
ASKED = [entry for entry in CATALOGUE.values() if entry.ask]


def names(entry):
    return entry.name


@pytest.mark.parametrize("entry", OPEN, ids=names)
def test_an_open_data_set_is_one_table_or_one_file_and_says_its_licence(entry):
    assert bool(entry.resource) != bool(entry.file)
    assert entry.licence
    assert entry.page.startswith("https://data.transportation.gov/d/")
    if entry.resource:
        assert re.fullmatch(r"[0-9a-z]{4}-[0-9a-z]{4}", entry.resource)
        assert entry.columns
    else:
        assert re.fullmatch(r"[0-9a-f]{64}", entry.sha256)
        assert entry.file_name.endswith(".zip")


@pytest.mark.parametrize("entry", CATALOGUE.values(), ids=names)
def test_the_reader_of_a_data_set_is_one_of_the_formats(entry):
    assert entry.format in (*FORMATS, "")


@pytest.mark.parametrize("entry", OPEN, ids=names)
def test_a_table_of_a_site_asks_for_the_rows_of_that_site(entry):
    if entry.site and entry.resource:
        assert entry.where == f"location='{load_site(entry.site).location}'"


@pytest.mark.parametrize("entry", ASKED, ids=names)
def test_a_data_set_that_has_to_be_asked_for_says_where_and_what_reads_it(entry):
    with pytest.raises(
        DownloadError, match=f"not downloaded.*{re.escape(entry.page)}.*`rampcast (inspect|convert) FILE"
    ):
        data_set(entry.name)


def test_an_unknown_name_is_told_with_the_closest_one():
    with pytest.raises(DownloadError, match=r"no data set 'ngsim-80'; is 'ngsim-i80' meant"):
        data_set("ngsim-80")


@pytest.mark.parametrize("entry", CATALOGUE.values(), ids=names)
def test_the_docs_name_every_data_set_with_its_page(entry):
    page = (DOCS / "downloading.md").read_text(encoding="utf-8")
    assert f"| `{entry.name}` |" in page
    assert entry.page in page
