"""A controlled ramp to look at: its frames are frames of the live service, and tell what comes of the rule."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rampcast.cli.live import controlled
from rampcast.control.showing import Shown, job_of
from rampcast.errors import RampcastError
from rampcast.live.frames import frame_of


def test_a_rule_that_there_is_not_is_refused_before_anything_is_driven():
    with pytest.raises(RampcastError, match="expected one of none, fixed, alinea"):
        controlled("alinae", speed=1.0, model=None)


def test_a_rule_has_the_values_that_the_shipped_plan_tries_first():
    assert job_of("alinea", 1).controller.values == {"target": 11.0}
    assert job_of("gap_advice", 1).controller.knows == "model"
    station, source = controlled("alinea", speed=2.0, model=Path("folder"))
    assert station.site.has_ramp
    assert source.program[:3] == ["rampcast.control.showing", "alinea", "2.0"]


def test_an_advice_is_shown_as_long_as_it_holds():
    shown = Shown(job_of("gap_advice", 1), "pretrained", told={7: (105.0, 15.0)})
    assert shown.advice(7, 104.5) == {"advice": "54 km/h"}
    assert shown.advice(7, 105.0) == {}
    assert shown.advice(8, 104.5) == {}


@contextlib.contextmanager
def lines_of(rule: str) -> Iterator[Iterator[str]]:
    command = [sys.executable, "-m", "rampcast.control.showing", rule, "1000", "1", "pretrained"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield iter(process.stdout)
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.sumo
def test_frames_tell_the_rule_and_what_comes_of_it_beside_what_happens_without():
    pytest.importorskip("libsumo")
    with lines_of("fixed") as lines:
        seen = 0
        for line in lines:
            seen, control = seen + 1, json.loads(line)["control"]
            if control["with"] != control["without"] or seen == 400:
                break
    assert control["with"] != control["without"]
    frame = frame_of(line)  # as the service takes it
    assert len(frame.objects) > 5
    assert frame.seq == seen
    assert control["rule"] == "fixed"
    assert control["rate"] == "400 veh/h"
    assert control["signal"] in ("red", "green")
    assert control["with"].keys() == control["without"].keys() == {"time spent", "mean speed", "ramp queue", "outside"}


@pytest.mark.slow
@pytest.mark.sumo
def test_without_a_rule_both_simulations_are_the_same():
    pytest.importorskip("libsumo")
    with lines_of("none") as lines:
        for _ in range(60):
            control = json.loads(next(lines))["control"]
            assert control["with"] == control["without"]
    assert control["rate"] == "not metered"
