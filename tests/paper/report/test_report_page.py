"""The html page and the files beside it."""

import csv
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import polars as pl
import pytest

from rampcast.paper.report import report
from rampcast.paper.report.report import fill_report
from rampcast.sites import Site, load_site
from tests.plots import tidy_tables

pytestmark = pytest.mark.slow

PAPER = {"parameters": {"ghr": {"alpha": {"mean": 2.84, "median": 2.14, "standard_deviation": 4.77}}}}
FIGURES = [*map(str, range(1, 12)), "A1", "A2", "A3", "A4", "A5", "A6"]
TABLES = ["1", "2", "3", "4", "A1", "A2", "A3", "A4", "A5"]


class Links(HTMLParser):
    """Collects the ids of a page and everything that it would load or link to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "srcset", "action", "data"):
                self.links.append(value or "")
            if name == "id":
                self.ids.append(value or "")


@pytest.fixture(scope="module")
def simulated_site() -> Site:
    return replace(load_site("i80"), simulated=True, title="A <simulated> site")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, simulated_site: Site) -> Path:
    out = tmp_path_factory.mktemp("report")
    (out / "run.json").write_text("{}")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "PNG_DPI", 30)  # nobody looks at them here
        fill_report(tidy_tables.tables(), site=simulated_site, run=tidy_tables.run(), paper=PAPER, folder=out)
    return out


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def test_every_figure_and_table_of_the_paper_is_there_once_under_its_number(page: str) -> None:
    ids = [name for name in Links(page).ids if name.startswith(("figure-", "table-"))]
    assert sorted(ids) == sorted([f"figure-{n}" for n in FIGURES] + [f"table-{n}" for n in TABLES])


def test_the_papers_order_is_kept_but_for_drawings_from_textbooks_which_come_last(page: str) -> None:
    order = [name for name in Links(page).ids if re.fullmatch(r"(figure|table)-\d+", name)]
    assert [name for name in order if name.startswith("figure")] == [f"figure-{n}" for n in (1, 2, *range(5, 12), 3, 4)]
    assert order.index("figure-6") < order.index("table-2") < order.index("table-4") < order.index("figure-7")


def test_the_page_loads_nothing_and_runs_nothing(page: str) -> None:
    links = Links(page)
    assert not [link for link in links.links if not link.startswith(("data:image/svg+xml", "#", "figures/", "tables/"))]
    assert "script" not in links.tags
    assert "url(" not in re.sub(r"data:[^\"]*", "", page)
    assert "default-src 'none'" in page


def test_every_link_leads_to_a_file_or_a_place_on_the_page(page: str, folder: Path) -> None:
    links = Links(page)
    for link in links.links:
        if link.startswith("#"):
            assert link[1:] in links.ids
        elif not link.startswith("data:"):
            assert (folder / link).is_file(), link


def test_pictures_lie_beside_the_page_as_svg_and_png(folder: Path) -> None:
    names = {path.stem for path in (folder / "figures").glob("*.svg")}
    drawings = {f"figure-{number}" for number in range(1, 5)}  # they ship as svg
    assert names - drawings == {path.stem for path in (folder / "figures").glob("*.png")}
    assert {"figure-1", "figure-5", "figure-6a-paper", "figure-11d-corrected"} <= names
    assert not [path for path in folder.rglob("*") if "partial" in path.name]


def test_other_files_in_the_folder_are_left_alone(folder: Path) -> None:
    assert (folder / "run.json").read_text() == "{}"


def test_the_page_stays_small(folder: Path) -> None:
    assert (folder / "report.html").stat().st_size < 6_000_000


def test_simulated_data_are_called_simulated_at_the_top(page: str) -> None:
    assert "SIMULATED DATA" in page[: page.index("<main>")]


def test_text_from_outside_is_escaped(page: str) -> None:
    assert "A &lt;simulated&gt; site" in page
    assert "<simulated>" not in page
    assert "--data &lt;data&gt;" in page


def test_the_summary_names_windows_seed_versions_and_data(page: str) -> None:
    top = page[: page.index("<main>")]
    for text in ("i80-1, i80-3", "i80-2", "rampcast 0.1.0", "0123456789abcdef", "2025-01-02"):
        assert text in top


def test_a_parameter_table_has_both_modes_and_the_printed_values(page: str, folder: Path) -> None:
    part = page[page.index('id="table-4"') : page.index('id="table-A2"')]
    for text in ("paper mode", "corrected mode", "printed in the paper", "2.84", "4.77"):
        assert text in part
    with (folder / "tables" / "table-4.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["parameter"] == "alpha"]
    assert [row["mode"] for row in rows] == ["paper", "corrected", "printed in the paper"]
    assert rows[2]["mean"] == "2.84"


def test_a_parameter_table_without_printed_values_leaves_the_column_out(page: str) -> None:
    part = page[page.index('id="table-2"') : page.index('id="table-3"')]
    assert "printed in the paper" not in part


def test_every_erratum_is_on_the_page_with_the_sites_own_note(page: str) -> None:
    part = page[page.index('id="errata"') :]
    assert all(f"<dt>{number}. " in part for number in range(1, 8))
    assert "133 of 175" in part


def test_captions_state_the_number_of_cases(page: str) -> None:
    part = page[page.index('id="figure-7"') : page.index('id="figure-8"')]
    assert "Paper mode: n = 258; corrected mode: n = 1,000 to 3,800." in part


def test_every_picture_has_a_text_for_those_who_cannot_see_it(page: str) -> None:
    assert page.count("<img ") == len(re.findall(r'<img [^>]*alt="Figure [^"]+"', page)) > 40


def test_missing_tables_modes_and_numbers_are_named_and_the_rest_is_drawn(tmp_path: Path) -> None:
    tables = tidy_tables.tables()
    few = tables["longitudinal"].filter(
        pl.col("mode") == "corrected", pl.col("horizon") <= 3, pl.col("model").is_in(["idm", "lstm"])
    )
    few = few.with_columns(n=pl.lit(4), mean_error=pl.lit(None, pl.Float64))
    scene = tables["examples"].filter(pl.col("mode") == "corrected", pl.col("example") == "good_2")
    path = fill_report({"longitudinal": few, "examples": scene}, site=load_site("us101"), run={}, folder=tmp_path)
    page = path.read_text(encoding="utf-8")
    assert "There is no table “importance”" in page
    assert "Not drawn: (a) the table &#39;examples&#39; has no such rows for corrected mode." in page
    assert "Not made: there is no table &#39;parameters&#39; with rows for the law &#39;idm&#39;." in page
    assert "Fewer than 30 cases" in page
    assert "not recorded" in page
    assert "SIMULATED" not in page
    assert (tmp_path / "figures" / "figure-7a-corrected.svg").is_file()


def test_the_same_tables_give_the_same_page(tmp_path: Path) -> None:
    pages = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        path = fill_report({"outcomes": tidy_tables.outcomes()}, site=load_site("i80"), run={}, folder=tmp_path / name)
        pages.append(path.read_bytes())
    assert pages[0] == pages[1]
