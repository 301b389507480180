"""`import rampcast as rc`: light, complete, and the same whatever else was imported before."""

import ast
import pkgutil
import subprocess
import sys
from dataclasses import replace
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import rampcast as rc
from rampcast.arguments import chosen, expected
from rampcast.forecast.forecasts import joined
from rampcast.recording import read_recording
from rampcast.simulate import shipped_sample
from tests.factories import TEST_SITE
from tests.forecast.forecasts_made_up import driving

PACKAGE = Path(rc.__file__).parent
HEAVY = ("equinox", "jax", "jinja2", "matplotlib", "numpy", "optax", "polars", "rich", "scipy", "sklearn", "typer")
HOSTILE = "<script>alert(\"ramp\")</script> & 'co'"


NO_RECORDING = "recording: expected a Recording, got 'i80.csv'; rc.read makes one of files"
WRONG = {  # calls, and what the answer says
    "rc.read('no.csv')": "no.csv: there is no such file",
    "rc.read(3)": "expected the path of a file, a polars or pandas frame, or a list of them",
    "rc.read('no.csv', bad_rows='ignore')": "bad_rows: expected one of 'raise', 'skip', got 'ignore'",
    "rc.inspect('i80.csv')": NO_RECORDING,
    "rc.doctor('i80.csv')": NO_RECORDING,
    "rc.clean('i80.csv')": NO_RECORDING,
    "rc.fit('i80.csv')": NO_RECORDING,
    "object.__new__(forecast.Forecaster).predict('i80.csv')": NO_RECORDING,
    "paper.fit_paper('i80.csv', mode='corrected')": NO_RECORDING,
    "paper.fit_paper(recording, mode='correct')": "mode: expected one of 'paper', 'corrected', got 'correct'",
    "rc.load('no_folder')": "no_folder",
    "rc.load(3)": "folder: expected a Path, got 3; give the path of a model folder",
    "rc.plot('i80.csv')": "expected a Recording, a Site or a Forecast, got a str",
    "rc.simulate(3)": "site: expected a Site, got 3",
    "rc.simulate('i81')": "there is no site 'i81'; is 'i80' meant",
}
ASK = """
import rampcast as rc
from rampcast import forecast, paper
recording = rc.read(rc.shipped_sample()[0])
for call in CALLS:
    try:
        print(eval(call))
    except rc.RampcastError as error:
        print(repr(str(error)))
"""


class Colour(StrEnum):
    """An Enum as public functions take them."""

    RED = "red"
    BLUE = "blue"


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=True)


@pytest.fixture(scope="module")
def recording() -> rc.Recording:
    return read_recording(shipped_sample()[0])


def standing_forecasts(window: str) -> rc.Forecasts:
    """Returns forecasts of vehicles 7 and 8, which stand and never merge, at 4 and 5 s."""
    both = driving(start=[120.0, 130.0], lane=[7, 7], speed=[0.0, 0.0], merge=[None, None])
    moments = [replace(both, vehicle=np.array([7, 8]), t0=t0) for t0 in (4.0, 5.0)]
    return joined([one.reduced(np.array([row]), recording=window) for row, one in enumerate(moments)])


def test_importing_the_package_imports_nothing_heavy():
    loaded = python("-c", "import sys, rampcast; print(*sys.modules)").stdout.split()
    assert [name for name in HEAVY if name in loaded] == []
    assert [name for name in loaded if name.startswith("rampcast.")] == []


def test_importing_the_package_imports_few_modules_and_so_takes_milliseconds():
    """Of time itself a busy machine decides: `python -X importtime -c "import rampcast"` tells it."""
    counted = "import sys; before = len(sys.modules); import rampcast; print(len(sys.modules) - before)"
    assert int(python("-c", counted).stdout) < 50


@pytest.mark.slow
def test_no_module_hides_a_name_of_the_front_door_even_if_every_module_is_imported_first():
    imports = "".join(f"import {one.name}\n" for one in pkgutil.walk_packages(rc.__path__, "rampcast."))
    asked = "import rampcast as rc\nprint([name for name in rc.__all__ if type(getattr(rc, name)) is type(rc)])"
    assert python("-c", f"{imports}{asked}").stdout.strip() == "[]"


def test_the_types_that_checkers_see_are_those_of_the_front_door():
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    imported = {alias.name for one in stub.body if isinstance(one, ast.ImportFrom) for alias in one.names}
    assert imported | {"__version__"} == set(rc.__all__)
    assert (PACKAGE / "py.typed").is_file()


def test_an_enum_is_given_by_its_member_or_by_its_value():
    assert chosen(Colour, "red", name="colour") is chosen(Colour, Colour.RED, name="colour") is Colour.RED


@pytest.mark.parametrize("value", ["green", "RED", ""])
def test_a_value_that_is_no_choice_is_answered_with_the_choices(value):
    with pytest.raises(rc.RampcastError, match=f"colour: expected one of 'red', 'blue', got {value!r}"):
        chosen(Colour, value, name="colour")


def test_a_long_value_is_not_shown_in_an_error():
    with pytest.raises(rc.RampcastError, match=r"^site: expected a Site, got a str; load one$"):
        expected(rc.Site, "x" * 1000, name="site", advice="load one")


@pytest.mark.slow
def test_a_wrong_argument_is_answered_with_a_sentence():
    """In a process of its own: here the checker of types would be first to complain."""
    answers = python("-c", ASK.replace("CALLS", repr(list(WRONG)))).stdout.splitlines()
    missed = [line for line, told in zip(answers, WRONG.values(), strict=True) if told not in ast.literal_eval(line)]
    assert missed == []


@pytest.mark.slow
def test_the_doctor_takes_the_report_that_reading_left_with_the_recording():
    read = rc.read(shipped_sample()[0])
    assert rc.doctor(read).report is read.report is not None


def test_a_recording_and_a_site_are_tables_in_a_notebook(recording):
    shown = recording._repr_html_()
    assert "<td>simulated-1</td>" in shown
    assert "<td>363,022</td>" in shown
    assert "<td>gore at 118 m, ends at 230 m, into lane 6</td>" in recording.site._repr_html_()


def test_a_forecast_is_told_in_a_line_and_not_by_its_samples():
    assert repr(standing_forecasts("noon")) == "<Forecasts of noon: 2 vehicles at a moment>"


def test_names_from_files_stay_text_in_a_notebook(recording):
    site = replace(TEST_SITE, name=HOSTILE, title=HOSTILE)
    shown_of_recording = replace(recording, site=site, source=HOSTILE)._repr_html_()
    for shown in (site._repr_html_(), shown_of_recording, standing_forecasts(HOSTILE)._repr_html_()):
        assert "<script" not in shown
        assert "&lt;script&gt;alert(&quot;ramp&quot;)&lt;/script&gt; &amp; &#x27;co&#x27;" in shown


def test_a_picture_shows_what_is_given(recording):
    tracks = rc.plot(recording.site), rc.plot(recording), rc.plot(rc.clean(recording)[0], lane=[6, 7])
    assert all(isinstance(one, Figure) for one in tracks)
    titles = [one.axes[0].get_title(loc="left") for one in tracks]
    name = recording.site.title
    assert titles == [
        name,
        f"{name}: 150 of 500 vehicles, simulated, coloured by lane",
        f"{name}, simulated-1, lane 6, 7",
    ]


def test_a_picture_of_a_forecast_shows_the_vehicle_and_moment_that_are_asked_for():
    forecast = standing_forecasts("noon")
    drawn = {key: rc.plot(forecast, vehicle=key).axes[0] for key in (None, 8)}
    titles = {key: ax.get_title(loc="left") for key, ax in drawn.items()}
    assert titles == {None: "Vehicle 7 of noon at 4 s", 8: "Vehicle 8 of noon at 5 s"}
    (median,) = (line for line in drawn[8].lines if line.get_label() == "rampcast, median")
    assert not np.any(median.get_ydata())  # displacements, not positions


def test_of_many_moments_one_vehicle_is_drawn_at_a_time():
    with pytest.raises(rc.RampcastError, match=r"one vehicle is drawn at a time, got \[7, 8\]"):
        rc.plot(standing_forecasts("noon"), vehicle=[7, 8])


@pytest.mark.parametrize("asked", [{"vehicle": 9}, {"t0": 4.5}, {"window": "night"}, {"vehicle": 7, "t0": 5.0}])
def test_a_forecast_that_is_not_there_is_answered_with_one_that_is(asked):
    with pytest.raises(rc.RampcastError, match=r"there are 2, the first of vehicle 7 at 4\.0 s"):
        rc.plot(standing_forecasts("noon"), **asked)
