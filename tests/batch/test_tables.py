"""Tables and the page of a batch, from records worked out by hand."""

import re
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from rampcast.batch import Plan
from rampcast.batch.page import write_page
from rampcast.batch.steps import conflict_counts
from rampcast.batch.tables import MEANS, pooled, tables_of, written_tables

FINDING = {"severity": "warning", "name": "x", "title": "Rows <twice>", "count": 2, "of": 100}


def scores(n: int, error: float, crps: float | None) -> pl.DataFrame:
    values = dict.fromkeys(MEANS, 0.5) | {"mean_error": error, "crps": crps}
    kinds = {"n": pl.UInt32} | dict.fromkeys(MEANS, pl.Float64)
    return pl.DataFrame([{"model": "ours", "horizon": 5.0, "n": n} | values], schema_overrides=kinds)


def part(out: Path, number: int, site: str, *, n: int, error: float, file: str = "a.parquet") -> dict[str, Any]:
    name = f"scores/site={site}/part={number}/scores.parquet"
    (out / name).parent.mkdir(parents=True)
    scores(n, error, 1.0).write_parquet(out / name)
    name_of_counts = f"conflicts/site={site}/part={number}/conflicts.parquet"
    (out / name_of_counts).parent.mkdir(parents=True)
    told = {"measure": ["ttc", "ttc", "drac"], "t": [5.0, 5.0, 5.0], "probability": [0.2, 0.6, 0.0]}
    conflict_counts(pl.LazyFrame(told)).write_parquet(out / name_of_counts)
    road = {"site": site, "simulated": False, "day": "2026-03-02", "vehicles": 10, "rows": 1000, "spoils": False}
    road |= {"findings": 1, "found": [FINDING], "files": [name, name_of_counts]}
    about = {"name": f"{file} {number}", "file": file, "site": site, "part": number, "begin": 0.0, "end": 360.0}
    return about | {"error": None, "peak_mb": 700.0 + number, "seconds": 1.0, "roads": [road], "sources": []}


def file(name: str, site: str, vehicles: int) -> dict[str, Any]:
    window = {"window": "w", "first": 0.0, "last": 720.0, "rows": 2000, "vehicles": vehicles}
    return {"name": name, "file": name, "error": None, "roads": [], "sources": [{"site": site, "windows": [window]}]}


@pytest.fixture
def records(tmp_path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Returns those of two sites: two parts of one, one part of the other, whose other part failed; and a bad file."""
    parts = [part(tmp_path, 0, "north", n=30, error=1.0), part(tmp_path, 1, "north", n=10, error=5.0)]
    parts.append(part(tmp_path, 2, "south<b>", n=40, error=3.0, file="b.parquet"))
    dead = {"name": "b 3", "file": "b.parquet", "site": "south<b>", "part": 3, "begin": 360.0, "end": 720.0}
    parts.append(dead | {"error": "its process was <killed>\ntrace", "roads": [], "sources": [], "peak_mb": None})
    bad = {"name": "c", "file": "c<i>.csv", "error": "no table", "roads": [], "sources": [], "peak_mb": 90.0}
    return [file("a.parquet", "north", 15), file("b.parquet", "south<b>", 8), bad], parts


def test_scores_of_sites_are_weighed_by_how_much_was_forecast(records, tmp_path):
    tables = tables_of(*records, tmp_path)
    by_site = {
        site: (n, error) for site, n, error in tables["site_scores"].select("site", "n", "mean_error").iter_rows()
    }
    assert by_site == {"north": (40, 2.0), "south<b>": (40, 3.0), "all": (80, 2.5)}
    conflicts = tables["site_conflicts"].filter(site="all", measure="ttc").row(0, named=True)
    assert (conflicts["n"], round(conflicts["expected"], 9), conflicts["likely"]) == (6, 2.4, 3)


def test_what_a_model_does_not_give_is_null_and_weighs_nothing():
    found = pooled(pl.concat([scores(10, 1.0, 4.0), scores(30, 1.0, None)]), ["horizon"], MEANS)
    assert (found["crps"][0], found["n"][0]) == (4.0, 40)
    assert pooled(scores(30, 1.0, None), ["horizon"], MEANS)["crps"][0] is None


def test_there_is_one_row_a_site_and_a_vehicle_in_two_parts_is_one(records, tmp_path):
    tables = tables_of(*records, tmp_path)
    sites = tables["sites"].select(
        "site", "parts", "parts_failed", "hours", "vehicles", "rows", "peak_mb", "mean_error_5"
    )
    assert sites.rows() == [
        ("north", 2, 0, 0.2, 15, 2000, 701.0, 2.0),
        ("south<b>", 2, 1, 0.2, 8, 1000, 702.0, 3.0),
    ]
    assert tables["sites"]["ttc_5"].to_list() == pytest.approx([0.4, 0.4])
    summary = tables["summary"].select("file", "site", "error", "vehicles", "parts", "failed").rows()
    assert summary == [
        ("a.parquet", "north", None, 15, 2, 0),
        ("b.parquet", "south<b>", "part 3: its process was <killed>\ntrace", 8, 2, 1),
        ("c<i>.csv", None, "no table", 0, 1, 1),
    ]
    assert tables["findings"].select("part", "count", "of").rows() == [(0, 2, 100), (1, 2, 100), (2, 2, 100)]


def test_the_page_tells_what_failed_first_and_no_name_is_markup(records, tmp_path):
    plan = Plan((Path("a.parquet"),), tmp_path)
    page = write_page(written_tables(*records, tmp_path).tables, plan).read_text()
    assert page.index("2 tasks failed") < page.index("What failed") < page.index("<h2>Sites")
    for name in ("south&lt;b&gt;", "c&lt;i&gt;.csv", "Rows &lt;twice&gt;", "its process was &lt;killed&gt;"):
        assert name in page
    assert not [name for name in ("south<b>", "c<i>", "<twice>", "<killed>") if name in page]
    cells = [re.findall("<td>(.*?)</td>", row) for row in re.findall("<tr>.*?</tr>", page)]
    assert ["all sites", "ours", "80", "", "", "2.50", "", "", ""] in cells  # a mean error at 5 s alone
    assert ["all sites", "6", "40.0%", "3", "", "", "0.0%", "0", "", "", "", ""] in cells  # conflicts within 5 s alone
    assert "default-src 'none'" in page
    assert not re.search(r"https?:|<script|src=", page)
    assert pl.read_csv(tmp_path / "sites.csv").height == 2


def test_a_batch_of_which_nothing_could_be_read_has_a_page_too(records, tmp_path):
    bad = records[0][2:]
    page = write_page(written_tables(bad, [], tmp_path).tables, Plan((Path("c"),), tmp_path)).read_text()
    assert "1 task failed" in page
    assert "Nothing was forecast" in page
