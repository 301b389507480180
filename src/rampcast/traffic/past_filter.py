"""States from the past alone: a Kalman filter of vehicles whose acceleration fades, and its smoother over 4 s.

A vehicle's acceleration decays with the rate `FADING` and is driven by white jerk (Singer 1970); its position is seen
with white noise, at whatever moments there are rows: any frame rate, missing and late frames alike. Whoever has the
same rows gets the same states, bit for bit. Only the ratio of jerk to position noise matters once a few rows are seen.
The filter and its numbers were chosen by errors against two-sided smoothing of real recordings:
docs/decisions/past_filter.md.

Source: Singer 1970, "Estimating optimal tracking filter performance for manned maneuvering targets", eq. 13 and 14;
Rauch, Tung and Striebel 1965 for the smoother.
"""

from typing import Any, no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

FADING = 1.0  # [1/s]
POSITION_NOISE = 0.1  # [m]
JERK = np.array([10.0, 3.0])  # [m/s^2.5] of x and of y: root of the spectral density
SPEED_BEFORE = np.array([15.0, 0.5])  # [m/s] what a vehicle's speed may be off the traffic's before its second row
ACCELERATION_BEFORE = np.array([1.5, 0.3])  # [m/s^2]
LONGEST_HOLE = 1.0  # [s]; after a longer one a track begins anew
FASTEST = 70.0  # [m/s]; what is farther off the row before is another vehicle under the same id
SLACK = 3.0  # [m] that two rows may be apart beyond that
SAME_MOMENT = 1e-6  # [s]
SMALL = 0.01  # FADING * dt below which the series of the noise is exact enough, and its closed form is not


@numba.njit(cache=True)
@no_type_check
def _transition(dt: float, f: Any) -> None:
    """Fills f with the motion over dt [s]."""
    e = np.exp(-FADING * dt)
    f[:] = 0.0
    f[0, 0] = f[1, 1] = 1.0
    f[0, 1] = dt
    f[0, 2] = (FADING * dt - 1.0 + e) / FADING**2
    f[1, 2] = (1.0 - e) / FADING
    f[2, 2] = e


@numba.njit(cache=True)
@no_type_check
def _noise(dt: float, density: float, q: Any) -> None:
    """Fills q with the covariance that white jerk of that density adds over dt [s]."""
    b = FADING * dt
    if b < SMALL:
        q[0, 0], q[0, 1], q[0, 2] = dt**5 / 20.0, dt**4 / 8.0, dt**3 / 6.0
        q[1, 1], q[1, 2], q[2, 2] = dt**3 / 3.0, dt**2 / 2.0, dt
    else:
        e, e2 = np.exp(-b), np.exp(-2.0 * b)
        q[0, 0] = (1.0 - e2 + 2.0 * b + 2.0 * b**3 / 3.0 - 2.0 * b**2 - 4.0 * b * e) / (2.0 * FADING**5)
        q[0, 1] = (e2 + 1.0 - 2.0 * e + 2.0 * b * e - 2.0 * b + b**2) / (2.0 * FADING**4)
        q[0, 2] = (1.0 - e2 - 2.0 * b * e) / (2.0 * FADING**3)
        q[1, 1] = (4.0 * e - 3.0 - e2 + 2.0 * b) / (2.0 * FADING**3)
        q[1, 2] = (e2 + 1.0 - 2.0 * e) / (2.0 * FADING**2)
        q[2, 2] = (1.0 - e2) / (2.0 * FADING)
    q[1, 0], q[2, 0], q[2, 1] = q[0, 1], q[0, 2], q[1, 2]
    q *= density


@numba.njit(cache=True)
@no_type_check
def _moved(f: Any, p: Any, q: Any, out: Any) -> None:
    """Fills out with f p f' + q."""
    for i in range(3):
        for j in range(i, 3):
            total = q[i, j]
            for k in range(i, 3):
                for m in range(j, 3):
                    total += f[i, k] * p[k, m] * f[j, m]
            out[i, j] = out[j, i] = total


@numba.njit(cache=True)
@no_type_check
def _taken(matrix: Any, vector: Any, out: Any) -> None:
    """Fills out with the product of a matrix and a vector."""
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@numba.njit(cache=True)
@no_type_check
def _inverse(p: Any, out: Any) -> None:
    """Fills out with the inverse of a symmetric matrix of three rows."""
    a, b, c, d, e, f = p[0, 0], p[0, 1], p[0, 2], p[1, 1], p[1, 2], p[2, 2]
    out[0, 0], out[0, 1], out[0, 2] = d * f - e * e, c * e - b * f, b * e - c * d
    out[1, 1], out[1, 2], out[2, 2] = a * f - c * c, b * c - a * e, a * d - b * b
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    out /= a * out[0, 0] + b * out[0, 1] + c * out[0, 2]


@numba.njit(cache=True)
@no_type_check
def _begin(time: Any, x: Any, first: int, stop: int) -> int:
    """Returns the first row of a vehicle's last unbroken track: no long hole, and nothing that nobody can drive."""
    begin = first
    for row in range(first + 1, stop):
        dt = time[row] - time[row - 1]
        if dt > LONGEST_HOLE + SAME_MOMENT or abs(x[row] - x[row - 1]) > FASTEST * dt + SLACK:
            begin = row
    return begin


@numba.njit(cache=True)
@no_type_check
def _moments(time: Any, begin: int, stop: int, grid: Any, out: Any, row_at: Any, place_at: Any) -> int:
    """Fills the moments of rows and grid in order, with the row and the place in the grid that each is; returns their
    number. Grid moments before the first row are left out."""
    row, place, count = begin, 0, 0
    while place < len(grid) and grid[place] < time[begin] - SAME_MOMENT:
        place += 1
    while row < stop or place < len(grid):
        at_row = row < stop and (place == len(grid) or time[row] <= grid[place] + SAME_MOMENT)
        at_grid = place < len(grid) and (row == stop or grid[place] <= time[row] + SAME_MOMENT)
        out[count] = time[row] if at_row else grid[place]
        row_at[count], place_at[count] = (row if at_row else -1), (place if at_grid else -1)
        row, place, count = row + at_row, place + at_grid, count + 1
    return count


@numba.njit(cache=True)
@no_type_check
def _filtered(moment: Any, row_at: Any, count: int, seen: Any, axis: int, speed: float, work: Any) -> None:
    """Runs the filter forward: predicted and corrected means and covariances of every moment."""
    mean, cov, mean_after, cov_after, f, q = work
    density, variance = JERK[axis] ** 2, POSITION_NOISE**2
    for n in range(count):
        if n == 0:
            mean[0, 0], mean[0, 1], mean[0, 2] = seen[row_at[0]], speed, 0.0
            cov[0] = 0.0
            cov[0, 0, 0] = 1e4 * variance
            cov[0, 1, 1], cov[0, 2, 2] = SPEED_BEFORE[axis] ** 2, ACCELERATION_BEFORE[axis] ** 2
        else:
            _transition(moment[n] - moment[n - 1], f[n])
            _noise(moment[n] - moment[n - 1], density, q)
            _taken(f[n], mean_after[n - 1], mean[n])
            _moved(f[n], cov_after[n - 1], q, cov[n])
        if row_at[n] < 0:
            mean_after[n, :], cov_after[n, :, :] = mean[n], cov[n]
            continue
        rest, total = seen[row_at[n]] - mean[n, 0], cov[n, 0, 0] + variance
        for i in range(3):
            mean_after[n, i] = mean[n, i] + cov[n, i, 0] / total * rest
            for j in range(3):
                cov_after[n, i, j] = cov[n, i, j] - cov[n, i, 0] * cov[n, 0, j] / total


@numba.njit(cache=True)
@no_type_check
def _smoothed(count: int, work: Any) -> None:
    """Runs the smoother backward over what `_filtered` left: `mean_after` holds the smoothed means then."""
    mean, cov, mean_after, cov_after, f, _ = work
    inverse, rest, weighed, back = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    for n in range(count - 2, -1, -1):
        _inverse(cov[n + 1], inverse)
        for i in range(3):
            rest[i] = mean_after[n + 1, i] - mean[n + 1, i]
        _taken(inverse, rest, weighed)
        _taken(f[n + 1].T, weighed, rest)
        _taken(cov_after[n], rest, back)
        for i in range(3):
            mean_after[n, i] += back[i]


@numba.njit(cache=True)
@no_type_check
def _states(time: Any, places: Any, first: Any, grid: Any, speed: float, states: Any, valid: Any) -> None:
    longest = 0
    for vehicle in range(len(first) - 1):
        longest = max(longest, first[vehicle + 1] - first[vehicle])
    size = longest + len(grid)
    moment, row_at, place_at = np.empty(size), np.empty(size, np.int64), np.empty(size, np.int64)
    work = (
        np.empty((size, 3)),
        np.empty((size, 3, 3)),
        np.empty((size, 3)),
        np.empty((size, 3, 3)),
        np.empty((size, 3, 3)),
        np.empty((3, 3)),
    )
    for vehicle in range(len(first) - 1):
        stop = first[vehicle + 1]
        begin = _begin(time, places[0], first[vehicle], stop)
        count = _moments(time, begin, stop, grid, moment, row_at, place_at)
        for axis in range(2):
            if np.isnan(places[axis, begin:stop]).any():
                continue
            _filtered(moment, row_at, count, places[axis], axis, speed if axis == 0 else 0.0, work)
            _smoothed(count, work)
            for n in range(count):
                if place_at[n] >= 0:
                    valid[vehicle, place_at[n]] = True
                    for order in range(3):
                        states[vehicle, 2 * order + axis, place_at[n]] = work[2][n, order]


def states_from_past(
    time: Float[np.ndarray, "row"],
    x: Float[np.ndarray, "row"],
    y: Float[np.ndarray, "row"],
    first: Int[np.ndarray, "vehicle_and_one"],
    *,
    grid: Float[np.ndarray, "past"],
) -> tuple[Float[np.ndarray, "vehicle 6 past"], Bool[np.ndarray, "vehicle past"]]:
    """Returns x, y, v, u, a, e of each vehicle at the moments of a grid [m, m/s, m/s^2], and where they are known.

    A vehicle is known from the first row of its last unbroken track on; after its last row it is taken on as the filter
    predicts. Where y was not seen, y, u and e are NaN.

    Args:
        time: of each row [s]; rising within a vehicle, none after the end of the grid.
        x, y: front centre [m]; y may be NaN for a vehicle's whole track.
        first: row where each vehicle begins, and the number of rows.
        grid: rising moments [s].
    """
    vehicles = len(first) - 1
    states = np.full((vehicles, 6, len(grid)), np.nan)
    valid = np.zeros((vehicles, len(grid)), dtype=bool)
    if vehicles:
        _states(time, np.stack([x, y]), first, grid, _usual_speed(time, x, first), states, valid)
    return states, valid


def _usual_speed(
    time: Float[np.ndarray, "row"], x: Float[np.ndarray, "row"], first: Int[np.ndarray, "vehicle_and_one"]
) -> float:
    """Returns the median speed over the vehicles seen twice [m/s], or 0: what is believed of one seen once."""
    begin, last = first[:-1], first[1:] - 1
    twice = last > begin
    if not twice.any():
        return 0.0
    return float(np.median((x[last] - x[begin])[twice] / (time[last] - time[begin])[twice]))
