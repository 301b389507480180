"""How many threads rampcast works with."""

import importlib
import threading

import pytest

from rampcast.errors import RampcastError
from rampcast.threads import choosing_threads, in_threads, thread_count
from tests.made_up_traffic import random_traffic


def test_the_caller_wins_over_the_environment_and_that_over_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RAMPCAST_THREADS", raising=False)
    assert thread_count() >= 1
    monkeypatch.setenv("RAMPCAST_THREADS", "3")
    assert thread_count() == 3
    with choosing_threads(5):
        assert thread_count() == 5
        with choosing_threads(None):
            assert thread_count() == 5
    assert thread_count() == 3


def test_results_come_in_order_from_as_many_threads_as_were_chosen() -> None:
    together = threading.Barrier(3, timeout=20.0)  # passes only if three work at the same time

    def work(number: int) -> int:
        together.wait()
        return 2 * number

    with choosing_threads(3):
        assert in_threads(work, range(6)) == [0, 2, 4, 6, 8, 10]


def test_one_thread_is_the_callers_own() -> None:
    with choosing_threads(1):
        assert set(in_threads(lambda _: threading.get_ident(), range(4))) == {threading.get_ident()}


def test_the_choice_reaches_the_threads_of_threads() -> None:
    with choosing_threads(2):
        assert in_threads(lambda _: thread_count(), range(4)) == [2] * 4


@pytest.mark.parametrize("wrong", ["0", "-2", "all", "1.5"])
def test_a_wrong_number_of_threads_is_told(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAMPCAST_THREADS", wrong)
    with pytest.raises(RampcastError, match=f"RAMPCAST_THREADS must be a whole number of at least 1, not '{wrong}'"):
        thread_count()


@pytest.mark.parametrize("wrong", [0, -1, True])
def test_a_wrong_argument_is_told(wrong: int) -> None:
    with pytest.raises(RampcastError, match="threads must be a whole number of at least 1"), choosing_threads(wrong):
        pass


class Working(Exception):
    """Stops what is called, and tells with how many threads it would have worked."""


def stop(*_: object, **__: object) -> None:
    raise Working(thread_count())


@pytest.mark.parametrize(
    ("module", "name", "call"),
    [
        ("rampcast.forecast.forecaster", "training_of", lambda module, traffic: module.fit(traffic, threads=3)),
        ("rampcast.forecast.forecaster", "find_anchors", lambda module, traffic: predict(module.Forecaster, traffic)),
        (
            "rampcast.paper.framework",
            "for_each_lane",
            lambda module, traffic: module.fit_paper(traffic, mode=module.Mode.PAPER, threads=3),
        ),
        ("rampcast.paper.framework", "find_anchors", lambda module, traffic: predict(module.PaperForecaster, traffic)),
    ],
)
def test_fits_and_forecasts_work_with_the_threads_that_their_caller_names(module, name, call, monkeypatch) -> None:
    monkeypatch.setattr(importlib.import_module(module), name, stop)
    with pytest.raises(Working, match="3"):
        call(importlib.import_module(module), random_traffic(1, vehicles=4, seconds=12.0))


def predict(kind: type, traffic: object) -> None:
    kind.predict(object.__new__(kind), traffic, threads=3)
