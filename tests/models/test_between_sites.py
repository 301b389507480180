"""How sites differ: a known spread is found again, it is the likeliest, and the limits of pooling."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from rampcast.models.between_sites import LEAST_SPREAD, VAGUE, Evidence, fit_population

NAMES = ("gap", "headway", "speed")
MEAN, SPREAD = np.array([0.7, 0.2, 3.0]), np.array([0.4, 0.1, 0.25])


def sites(count: int, *, precise: float, seed: int = 1, spread: np.ndarray = SPREAD):
    """Returns the true parameters of sites, and what is said of them: estimates that err, all in a way of their own."""
    rng = np.random.default_rng(seed)
    true = MEAN + spread * rng.standard_normal((count, 3))
    evidence = {}
    for number, one in enumerate(true):
        mixed = rng.standard_normal((3, 3))
        precision = precise * (mixed @ mixed.T + 0.5 * np.eye(3))
        own = rng.multivariate_normal(one, np.linalg.inv(precision))
        evidence[f"site {number}"] = Evidence(precision, precision @ own)
    return true, evidence


def fitted(evidence, **more):
    return fit_population(evidence, names=NAMES, assumed=np.zeros(3), spread=np.full(3, 0.3), **more)


def test_a_known_spread_is_found_again():
    _, evidence = sites(400, precise=20.0)
    found = fitted(evidence)
    np.testing.assert_allclose(found.spread, SPREAD, rtol=0.15)
    np.testing.assert_allclose(found.mean, MEAN, atol=0.06)


def test_six_sites_tell_the_spread_right_on_average():
    """And the mean is as far off as its covariance says."""
    found = [fitted(sites(6, precise=200.0, seed=seed)[1]) for seed in range(40)]
    variance = np.mean([one.spread**2 for one in found], axis=0)
    np.testing.assert_allclose(variance, SPREAD**2, rtol=0.25)
    off = np.array([(one.mean - MEAN) / np.sqrt(np.diag(one.doubt)) for one in found])
    assert 0.8 < np.sqrt((off**2).mean()) < 1.35


def test_the_spread_is_the_likeliest_that_an_optimiser_finds():
    """The restricted likelihood, the mean integrated out, written down from its definition."""
    _, evidence = sites(5, precise=30.0)
    own = [np.linalg.solve(one.precision, one.information) for one in evidence.values()]
    wrong = [np.linalg.inv(one.precision) for one in evidence.values()]

    def unlikelihood(log_spread):
        covariance = np.kron(np.ones((5, 5)), VAGUE**2 * np.eye(3))
        for number, one in enumerate(wrong):
            some = slice(3 * number, 3 * number + 3)
            covariance[some, some] += one + np.diag(np.exp(2.0 * log_spread))
        return -multivariate_normal(np.zeros(15), covariance).logpdf(np.concatenate(own))

    best = minimize(unlikelihood, np.log(np.full(3, 0.3)), method="Nelder-Mead", options={"maxiter": 2000})
    found = fitted(evidence)
    assert unlikelihood(np.log(found.spread)) == pytest.approx(best.fun, abs=0.02)


def test_a_site_that_says_all_is_itself_and_one_that_says_nothing_is_the_mean():
    true, evidence = sites(8, precise=1e8)
    nothing = Evidence(np.zeros((3, 3)), np.zeros(3))
    found = fitted(evidence | {"unknown": nothing})
    np.testing.assert_allclose(found.values[:8], true, atol=1e-3)
    np.testing.assert_allclose(found.shrinkage[:8], 0.0, atol=1e-3)
    np.testing.assert_allclose(found.values[8], found.mean)
    np.testing.assert_allclose(found.shrinkage[8], 1.0)


def test_a_further_site_goes_from_the_mean_to_itself_as_its_vehicles_get_more():
    _, evidence = sites(8, precise=100.0)
    found, own = fitted(evidence), MEAN + 1.0
    assert found.site().shrinkage.tolist() == [1.0] * 3
    np.testing.assert_array_equal(found.site().mean, found.mean)
    # a draw, beyond what the mean itself may be off
    assert (found.site().deviation > found.spread).all()
    distances = []
    for precise in (0.0, 1e-6, 1.0, 10.0, 1e8):
        one = found.site(Evidence(precise * np.eye(3), precise * own))
        distances.append(np.abs(one.mean - own))
        if precise <= 1e-6:
            np.testing.assert_allclose(one.shrinkage, 1.0, atol=1e-5)
            np.testing.assert_allclose(one.deviation, found.site().deviation, rtol=1e-5)
    assert (np.diff(distances, axis=0) <= 1e-9).all()
    np.testing.assert_allclose(distances[-1], 0.0, atol=1e-5)
    np.testing.assert_allclose(one.shrinkage, 0.0, atol=1e-5)


def test_sites_that_are_alike_are_pooled():
    _, evidence = sites(6, precise=1e4, spread=np.zeros(3))
    found = fitted(evidence)
    assert found.spread.max() < 0.02
    together = sum(one.precision for one in evidence.values())
    pooled = np.linalg.solve(together, sum(one.information for one in evidence.values()))
    np.testing.assert_allclose(found.mean, pooled, atol=0.01)


def test_what_no_site_tells_stays_what_is_assumed():
    """All are blind for the third parameter."""
    _, evidence = sites(6, precise=50.0)
    seen = np.diag([1.0, 1.0, 0.0])
    blind = {
        name: Evidence(seen @ one.precision @ seen, seen @ one.precision @ seen @ (MEAN + 0.1 * number))
        for number, (name, one) in enumerate(evidence.items())
    }
    found = fitted(blind)
    assert found.mean[2] == pytest.approx(0.0, abs=1e-9)
    assert found.spread[2] == pytest.approx(0.3)
    np.testing.assert_allclose(found.shrinkage[:, 2], 1.0)
    assert found.spread[:2].min() > LEAST_SPREAD


def test_tied_parameters_have_one_spread():
    _, evidence = sites(40, precise=50.0)
    found = fitted(evidence, tied=np.array([0, 1, 1]))
    assert found.spread[1] == found.spread[2]
    assert 0.1 < found.spread[1] < 0.25
