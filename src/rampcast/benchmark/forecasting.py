"""What every model forecasts for the test cases of a data set, part by part where each vehicle tests once."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.merge_tables import Thresholds, outcomes, thresholds
from rampcast.benchmark.merges import MergeFit, MergeForecasts, MergePredict
from rampcast.benchmark.models import ORACLE, Fit, Forecasts, Predict, Training, oracle, with_bands
from rampcast.benchmark.splits import folds
from rampcast.forecasters import FORECASTERS
from rampcast.models.folds import Fold
from rampcast.threads import in_threads
from rampcast.traffic.around import joined

FOLDS = 2  # of the forecasts by which the thresholds of models are chosen that know their training cases by heart
MOST_FOR_THRESHOLDS = 1500  # training cases; a threshold needs no more
MOST_FOR_BANDS = 400  # likewise; a 5 % quantile is that of 20 errors then

One = TypeVar("One")
Part = tuple[Training, Cases]  # the test cases are forecast by models that were trained on the training cases


def forecast_cases(training: Training, test: Cases, *, models: Mapping[str, Fit]) -> dict[str, Forecasts]:
    """Returns where every model, and the oracle, forecasts the test cases to be."""
    return forecast_parts([(training, test)], models=models)


def forecast_parts(parts: Sequence[Part], *, models: Mapping[str, Fit]) -> dict[str, Forecasts]:
    """Returns where every model, and the oracle, forecasts the test cases of all parts to be, in their order.

    The bands of a model that gives none are the quantiles of its errors on the training cases; of several parts, those
    of its errors in the other parts, which are of models that had not seen these cases.
    """
    asked = in_threads(lambda part: _predictors(part[0], models), parts)
    forecasts = {}
    for name in (*models, ORACLE):
        found = [predict[name](test) for predict, (_, test) in zip(asked, parts, strict=True)]
        if found[0].quantiles is None:
            found = _with_bands(found, parts, asked[0][name])
        forecasts[name] = joined(found)
    return forecasts


def forecast_merges(
    training: Training, test: Cases, *, models: Mapping[str, MergeFit]
) -> tuple[dict[str, MergeForecasts], dict[str, Thresholds]]:
    """Returns when every model forecasts the test cases to merge, and the thresholds for each of them."""
    return forecast_merge_parts([(training, test)], models=models)


def forecast_merge_parts(
    parts: Sequence[Part], *, models: Mapping[str, MergeFit]
) -> tuple[dict[str, MergeForecasts], dict[str, Thresholds]]:
    """Returns when every model forecasts the test cases of all parts to merge, in their order, and the thresholds.

    Thresholds are chosen on the training cases; of several parts, on the forecasts of the other parts.
    """
    forecasts, limits = {}, {}
    tests = [test for _, test in parts]
    for name, fit in models.items():
        asked = in_threads(fit, [training for training, _ in parts])
        found = [predict(test.scenes, test.since_entry) for predict, test in zip(asked, tests, strict=True)]
        forecasts[name] = joined(found)
        if len(parts) == 1:
            by_heart = name in FORECASTERS and FORECASTERS[name].by_heart
            chosen = [_for_thresholds(parts[0][0], fit if by_heart else None, asked[0])]
        else:
            chosen = [(joined(_others(tests, k)), joined(_others(found, k))) for k in range(len(parts))]
        some = [thresholds(outcomes(cases), forecast) for cases, forecast in chosen]
        limits[name] = _repeated(some, [len(test) for test in tests])
    return forecasts, limits


def _predictors(training: Training, models: Mapping[str, Fit]) -> dict[str, Callable[[Cases], Forecasts]]:
    """Returns all models, and the oracle, as functions of cases."""
    found: dict[str, Callable[[Cases], Forecasts]] = {
        name: partial(_of_scenes, fit(training)) for name, fit in models.items()
    }
    tell = oracle(training)
    found[ORACLE] = lambda cases: tell(cases.scenes, cases.leader_truth)
    return found


def _of_scenes(predict: Predict, cases: Cases) -> Forecasts:
    return predict(cases.scenes)


def _with_bands(
    found: Sequence[Forecasts], parts: Sequence[Part], predict: Callable[[Cases], Forecasts]
) -> list[Forecasts]:
    """Returns the forecasts with bands; `predict` is the model of the first part."""
    if len(parts) == 1:
        cases = parts[0][0].longitudinal
        some = cases.select(np.arange(0, len(cases), -(-len(cases) // MOST_FOR_BANDS)))
        return [with_bands(found[0], predict(some), some.truth)]
    truths = [test.truth for _, test in parts]
    return [
        with_bands(one, joined(_others(found, k)), np.concatenate(_others(truths, k))) for k, one in enumerate(found)
    ]


def _others(some: Sequence[One], number: int) -> list[One]:
    return [one for k, one in enumerate(some) if k != number]


def _repeated(some: Sequence[Thresholds], counts: Sequence[int]) -> Thresholds:
    """Returns the thresholds of each part, given to so many cases each."""
    return Thresholds(**{name: np.repeat(values, counts, axis=0) for name, values in vars(joined(some)).items()})


def _for_thresholds(training: Training, fit: MergeFit | None, predict: MergePredict) -> tuple[Cases, MergeForecasts]:
    """Returns training cases, and forecasts for them; with `fit`, by models that were trained on the others."""
    cases = training.merging
    if fit is None:
        cases = cases.select(np.arange(0, len(cases), -(-len(cases) // MOST_FOR_THRESHOLDS)))
        return cases, predict(cases.scenes, cases.since_entry)

    def out_of_fold(fold: Fold) -> tuple[Cases, MergeForecasts]:
        train, test = fold
        tests = cases.select(test)
        model = fit(Training(cases.select(train))) if len(train) else predict
        return tests, model(tests.scenes, tests.since_entry)

    pieces = in_threads(out_of_fold, folds(cases, min(FOLDS, len(set(cases.group.tolist())))))
    return joined([piece for piece, _ in pieces]), joined([forecast for _, forecast in pieces])
