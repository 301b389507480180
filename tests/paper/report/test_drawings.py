"""The drawings that need no results."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from matplotlib.axes import Axes

from rampcast.paper.report.drawings import framework, neighbour_geometry
from rampcast.paper.report.drawings_of_models import forest_decision, lstm_cell
from rampcast.plots.site_geometry import site_geometry
from rampcast.sites import load_site, site_names
from tests.plots.looking import assert_readable, draw, texts


@pytest.mark.parametrize(
    ("drawing", "words"),
    [
        (neighbour_geometry, {"i", "l", "f", "l1", "l2", "f1", "f2", "m", "actual leader", "travel, x grows [m]"}),
        (framework, {"observed", "predicted", "result", "x of the next 15 s"}),
        (lstm_cell, {"forget", "input", "candidate", "output", "$c_t$", "$h_t$"}),
        (forest_decision, {"tree 1", "tree N", "yes", "no", "42 features at t = 0"}),
    ],
)
def test_a_drawing_names_its_parts_and_is_readable(drawing: Callable[[], Axes], words: set[str]) -> None:
    ax = drawing()
    draw(ax)
    assert words <= {text.get_text() for text in texts(ax)}
    assert_readable(ax)


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
