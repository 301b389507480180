"""Hazards over sites: sites of different patience are told apart, and what few merges say is little."""

import numpy as np
import pytest

from rampcast.models.merging import FEATURES, Periods, fit_merge_hazard, merge_periods
from rampcast.models.site_hazards import NAMES, fit_hazards, hazard_evidence

STEPS = 75
LOGITS = {"hasty": -2.0, "usual": -3.0, "patient": -4.0}
ZONE = (200.0, 10.0)


def merging(logit: float, count: int, seed: int):
    """Returns features, and times of lane changes, under a hazard in which the first feature counts."""
    rng = np.random.default_rng(seed)
    features = rng.normal(0.0, 1.0, (count, 1, STEPS, FEATURES))
    merges = rng.random((count, STEPS)) < 1.0 / (1.0 + np.exp(-logit - 1.5 * features[:, 0, :, 0]))
    return features, np.where(merges.any(axis=1), (merges.argmax(axis=1) + 1) * 0.2, np.nan)


def periods_of(logits, count: int) -> tuple[Periods, np.ndarray, np.ndarray]:
    made = [merging(logit, count, seed) for seed, logit in enumerate(logits)]
    features, change = (np.concatenate(values) for values in zip(*made, strict=True))
    return merge_periods(features, change, np.full(len(change), 15.0)), change, np.full(len(change), 15.0)


@pytest.fixture(scope="module")
def fitted():
    periods, change, seen_for = periods_of(LOGITS.values(), 300)
    site, vehicle = np.repeat(list(LOGITS), 300), np.arange(900)
    pooled = fit_merge_hazard(periods, change, seen_for, zone=ZONE)
    return fit_hazards(periods, site, vehicle, pooled)


def test_sites_of_different_patience_are_told_apart(fitted):
    found = dict(zip(fitted.parameters.sites, fitted.parameters.values[:, 0], strict=True))
    weight = dict(zip(fitted.parameters.sites, fitted.parameters.values[:, 1], strict=True))
    for name, logit in LOGITS.items():
        assert found[name] == pytest.approx(logit + 1.5 * fitted.middle[0], abs=0.25)
        assert weight[name] == pytest.approx(1.5 * fitted.scale[0], abs=0.25)
    assert fitted.parameters.spread[0] == pytest.approx(1.0, abs=0.3)
    np.testing.assert_allclose(fitted.parameters.spread[1:], fitted.parameters.spread[1])
    assert fitted.parameters.spread[1] < 0.2


def test_the_hazard_of_an_unknown_site_is_the_mean_and_may_be_off_by_a_factor(fitted):
    estimate = fitted.parameters.site()
    hazard = fitted.hazard(estimate, ZONE)
    assert hazard.constant + hazard.weights @ fitted.middle == pytest.approx(estimate.mean[0])
    assert hazard.unknown == pytest.approx(np.hypot(fitted.parameters.spread[0], fitted.parameters.doubt[0, 0] ** 0.5))
    assert (hazard.first, hazard.last) == ZONE


def test_a_further_site_is_the_mean_of_the_others_until_its_vehicles_tell(fitted):
    values = []
    for count in (1, 10, 400):
        periods, *_ = periods_of([-1.0], count)
        estimate = fitted.parameters.site(fitted.evidence(periods, np.arange(count)))
        values.append((estimate.mean[0], estimate.shrinkage[0]))
    means, shrinkage = zip(*values, strict=True)
    assert fitted.parameters.mean[0] < means[0] < means[1] < means[2]
    assert means[2] == pytest.approx(-1.0 + 1.5 * fitted.middle[0], abs=0.2)
    assert shrinkage[0] > 0.5 > shrinkage[1] > shrinkage[2]


def test_a_vehicle_at_many_moments_counts_as_one():
    periods, *_ = periods_of([-3.0], 60)
    once, often = (
        hazard_evidence(periods, np.arange(60) // each, np.zeros(len(NAMES)), np.zeros(FEATURES), np.ones(FEATURES))
        for each in (1, 6)
    )
    assert np.trace(once.precision) > 4.0 * np.trace(often.precision)
