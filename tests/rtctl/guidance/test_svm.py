"""The dual problem against its optimality conditions and an independent solver."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, minimize

from rtctl.guidance.svm import TrainingError, decide, linear_kernel, rbf_kernel, solve


def draw(seed, count, dimension, apart=1.0):
    random = np.random.default_rng(seed)
    labels = np.where(np.arange(count) % 2, 1.0, -1.0)
    return random.standard_normal((count, dimension)) + apart * labels[:, None] * random.random(dimension), labels


def dual_value(alpha, matrix, labels):
    signed = alpha * labels
    return alpha.sum() - 0.5 * signed @ matrix @ signed


@given(st.integers(0, 10_000), st.integers(4, 60), st.integers(1, 80), st.floats(0.01, 10.0), st.booleans())
def test_every_solution_meets_the_optimality_conditions(seed, count, dimension, limit, radial):
    v, y = draw(seed, count, dimension)
    matrix = rbf_kernel(v, v, 1.5) if radial else linear_kernel(v, v)
    dual = solve(matrix, y, limit)
    alpha, margin = dual.multipliers, y * decide(dual, y, matrix)
    assert ((alpha >= 0.0) & (alpha <= limit)).all()
    assert y @ alpha == pytest.approx(0.0, abs=1e-9 * limit * count)
    tolerance = 1e-5 * max(1.0, np.abs(matrix).max())
    assert (margin[alpha < limit] >= 1.0 - tolerance).all(), "who is not at the limit is outside the margin"
    assert (margin[alpha > 0.0] <= 1.0 + tolerance).all(), "who supports is not beyond the margin"


@pytest.mark.parametrize("limit", [0.1, 1.05, 5.0])
def test_the_dual_is_as_large_as_a_general_solver_makes_it(limit):
    v, y = draw(3, 24, 6, apart=0.4)
    matrix = linear_kernel(v, v)
    found = minimize(
        lambda a: -dual_value(a, matrix, y),
        np.full(24, limit / 2),
        jac=lambda a: y * (matrix @ (a * y)) - 1.0,
        bounds=[(0.0, limit)] * 24,
        constraints=[LinearConstraint(y[None], 0.0, 0.0)],
        method="SLSQP",
        options={"maxiter": 2000, "ftol": 1e-14},
    )
    dual = solve(matrix, y, limit)
    assert dual_value(dual.multipliers, matrix, y) >= dual_value(found.x, matrix, y) - 1e-6
    w, reference = (dual.multipliers * y) @ v, (found.x * y) @ v
    assert w == pytest.approx(reference, abs=1e-4)


def test_two_points_are_parted_in_the_middle():
    dual = solve(linear_kernel(np.array([[1.0], [3.0]]), np.array([[1.0], [3.0]])), np.array([-1.0, 1.0]), 100.0)
    at = np.array([[1.0], [2.0], [3.0]])
    h = decide(dual, np.array([-1.0, 1.0]), linear_kernel(np.array([[1.0], [3.0]]), at))
    assert h == pytest.approx([-1.0, 0.0, 1.0], abs=1e-6)


def test_what_cannot_be_trained_is_refused():
    with pytest.raises(TrainingError, match="two classes"):
        solve(np.eye(3), np.ones(3), 1.0)
    with pytest.raises(TrainingError, match="not finite"):
        solve(np.full((2, 2), np.nan), np.array([-1.0, 1.0]), 1.0)


def test_the_radial_kernel_halves_the_squared_distance():
    assert rbf_kernel(np.zeros((1, 2)), np.array([[3.0, 4.0]]), 5.0) == pytest.approx(np.exp(-0.5))
