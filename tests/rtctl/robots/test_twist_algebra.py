"""Six equations in a twist against numpy."""

import numpy as np
import pytest

from rtctl.robots import twist_algebra

RNG = np.random.default_rng(5)


def rows(matrix):
    return [tuple(map(float, row)) for row in matrix]


def test_determinant():
    for matrix in RNG.normal(size=(50, 6, 6)):
        assert twist_algebra.determinant(*rows(matrix)) == pytest.approx(np.linalg.det(matrix), abs=1e-12)


def test_determinant_of_a_singular_matrix_is_zero_up_to_rounding():
    matrix = RNG.normal(size=(6, 6))
    matrix[5] = matrix[0] - 2 * matrix[3]
    assert abs(twist_algebra.determinant(*rows(matrix))) < 1e-13


def test_solution_by_blocks():
    upper = np.triu_indices(3)
    for matrix, right in zip(RNG.normal(size=(50, 6, 6)), RNG.normal(size=(50, 6)), strict=True):
        m = matrix.T @ matrix + 0.1 * np.eye(6)
        a, c, d = m[:3, :3], m[:3, 3:], m[3:, 3:]
        blocks = (a[upper], c.ravel(), d[upper], right[:3], right[3:])
        found = twist_algebra.solve_by_blocks(*(tuple(map(float, block)) for block in blocks))
        assert found == pytest.approx(np.linalg.solve(m, right), rel=1e-9, abs=1e-9)
