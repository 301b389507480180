"""The drawings that need no results."""

import itertools
import re
from dataclasses import replace
from importlib import resources
from xml.etree import ElementTree

import pytest

from rampcast.paper.report.figures import setting_figures
from rampcast.plots.site_geometry import site_geometry
from rampcast.sites import load_site, site_names
from tests.plots.looking import assert_readable

WORDS = {
    "neighbours.svg": {"i", "l", "f", "l1", "l2", "f1", "f2", "m", "actual leader", "travel, x grows [m]"},
    "framework.svg": {"observed", "predicted", "result", "x of the next 15 s"},
    "lstm_cell.svg": {"forget", "input", "candidate", "output", "$c_t$", "$h_t$"},
    "forest.svg": {"tree 1", "tree N", "yes", "no", "42 features at t = 0"},
}


def test_the_first_four_figures_are_drawings_that_ship_with_the_package() -> None:
    entries = list(itertools.islice(setting_figures(load_site("i80")), 4))
    assert [entry.drawing for entry in entries] == list(WORDS)


@pytest.mark.parametrize(("name", "words"), WORDS.items())
def test_a_drawing_names_its_parts_and_needs_nothing_else(name: str, words: set[str]) -> None:
    svg = (resources.files("rampcast.paper.report") / "drawings" / name).read_text(encoding="utf-8")
    drawn = ElementTree.XML(svg)
    assert words <= set(re.findall(r"<!-- (.*?) -->", svg))  # letters are paths; the text stands beside them
    assert all(value.startswith("#") for part in drawn.iter() for name, value in part.items() if "href" in name)
    assert not re.search(r"<script|<image|@import|url\((?!#)", svg)


@pytest.mark.parametrize("name", site_names())
def test_every_shipped_site_is_drawn_with_its_own_numbers(name: str) -> None:
    site = load_site(name)
    ax = site_geometry(site)
    shown = [text.get_text() for text in ax.texts]
    assert f"gore {site.gore:.0f} m " in shown
    assert f" ramp ends {site.ramp_end:.0f} m" in shown
    assert f"{site.target_lane}  target lane" in shown
    assert ax.get_xlabel().endswith("[m]")
    assert ax.get_ylabel().endswith("[m]")
    assert_readable(ax)


def test_a_site_of_two_lanes_is_drawn() -> None:
    site = load_site("i80")
    lanes = tuple(lane for lane in site.lanes if lane.number in (6, 7))
    assert_readable(site_geometry(replace(site, lanes=lanes)))
