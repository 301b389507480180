"""The line of ranks: it finds a slope, does not mind outliers, and takes what is missing as usual."""

import numpy as np

from rampcast.models.ranked_line import fit_ranked_line


def made_up(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    table = np.column_stack([rng.normal(size=count), rng.integers(0, 3, count), rng.normal(size=count)])
    return table, 5.0 + 2.0 * table[:, 0] + 0.1 * rng.normal(size=count)


def test_a_slope_is_found_and_shrunk_by_as_many_rows_as_the_constant_says():
    """The column is normal, so its scores are itself; 300 rows more without effect take 300 / 3300 of the slope."""
    table, wanted = made_up(3000)
    line = fit_ranked_line(table, wanted)
    asked = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    low, high = line.predict(asked)
    np.testing.assert_allclose((high - low) / 2.0, 2.0 * 3000 / 3300, rtol=0.03)
    np.testing.assert_allclose((high + low) / 2.0, 5.0, atol=0.1)


def test_a_value_far_out_is_no_more_than_the_largest_of_training():
    table, wanted = made_up(400)
    line = fit_ranked_line(table, wanted)
    far, large = line.predict(np.array([[1e6, 1.0, 0.0], [table[:, 0].max(), 1.0, 0.0]]))
    assert far == large


def test_what_is_missing_counts_as_usual():
    table, wanted = made_up(400)
    holes = np.where(np.random.default_rng(2).random(table.shape) < 0.3, np.nan, table)
    line = fit_ranked_line(holes, wanted)
    np.testing.assert_allclose(line.predict(np.full((1, 3), np.nan)), wanted.mean())
    assert np.isfinite(line.predict(holes)).all()


def test_where_many_values_are_alike_a_hair_does_not_lead_through_the_ranks():
    """Half of the vehicles stand, to a tenth of a millimetre per second."""
    rng = np.random.default_rng(3)
    standing = rng.random(2000) < 0.5
    column = np.where(standing, 1e-4 * rng.normal(size=2000), rng.uniform(0.0, 10.0, 2000))
    line = fit_ranked_line(column[:, None], column)
    slow, fast = line.predict(np.array([[-1e-4], [1e-4]]))
    assert abs(fast - slow) < 1e-3
