"""The force model against the printed identities (03 section 1), quadrature and finite differences."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from rtctl.guidance.force_model import AOS_START, REFERENCE, basis, basis_derivative, basis_integral, fit

MEAN = """
-0.00368 -0.01943 -0.05576 -0.04169 -0.04532 -0.09988
-0.02584 -0.06586  0.32665  0.44780  0.30874 -0.41673
 0.01062 -0.00091 -0.24368 -0.57025 -0.50025 -0.19172"""
DEVIATION = """
0.00754  0.01376  0.02151  0.01796  0.03973  0.11535
0.06385  0.23934  1.11056  1.36248  1.46618  1.47611
0.04616  0.10488  0.40463  0.53501  0.63826  1.06752"""
"""At lambda = 0, 0.2 .. 1; rows f_z, f_xx, f_yy."""


def numbers(text):
    return np.array([[float(v) for v in line.split()] for line in text.strip().splitlines()])


def test_table_v_2_gives_the_printed_curves():
    x = np.linspace(0.0, 1.0, 6)
    assert REFERENCE.mean @ basis(x).T == pytest.approx(numbers(MEAN), abs=5.1e-6)
    assert REFERENCE.deviation @ basis(x).T == pytest.approx(numbers(DEVIATION), abs=5.1e-6)


def test_deviations_are_positive_and_smallest_where_the_sensor_is_no_better():
    x = np.linspace(0.0, 1.0, 100_001)
    deviation = REFERENCE.deviation @ basis(x).T
    assert (deviation > 0.0).all()
    assert deviation[0].min() == pytest.approx(0.002533, abs=5e-7)
    assert x[deviation[0].argmin()] == pytest.approx(0.0736, abs=5e-5)


def test_integrals_of_the_force_are_those_of_the_reference_study():
    x = np.linspace(0.0, 1.0, 100_001)
    assert np.trapezoid(basis(x) @ REFERENCE.deviation[0], x) == pytest.approx(0.02782, abs=5e-6)
    assert np.trapezoid(np.abs(basis(x) @ REFERENCE.mean[0]), x) == pytest.approx(0.04082, abs=5e-6)
    after = np.linspace(AOS_START, 0.95, 10_001)
    assert np.abs(basis(after) @ REFERENCE.mean[0]).mean() == pytest.approx(0.0470, abs=1e-4)


def inverse_condition(matrix):
    values = np.linalg.svd(matrix, compute_uv=False)
    return values[-1] / values[0]


ORDERS = (1, 3, 5, 7, 9)


def test_inverse_condition_numbers_are_the_printed_ones():
    x = np.linspace(0.0, 1.0, 50)
    assert [f"{inverse_condition(basis(x, n)):.4e}" for n in ORDERS] == [
        "5.8902e-01", "1.7900e-01", "5.0856e-02", "1.3940e-02", "3.7177e-03",
    ]  # fmt: skip
    powers = [f"{inverse_condition(x[:, None] ** np.arange(n + 1)):.4e}" for n in ORDERS]
    assert powers == ["2.3220e-01", "8.4846e-03", "2.8190e-04", "9.0212e-06", "2.8098e-07"]
    assert f"{inverse_condition(basis(np.arange(1, 51) / 50)):.4e}" == "1.5448e-03"


@pytest.mark.parametrize("order", [1, 4, 10])
def test_derivative_and_integral_are_those_of_the_polynomials(order):
    x = np.linspace(0.0, 1.0, 21)
    for i in range(order + 1):
        c = np.zeros(order + 1)
        c[i] = 1.0
        through = Polynomial.fit(np.linspace(0, 1, order + 1), basis(np.linspace(0, 1, order + 1), order) @ c, order)
        assert basis_derivative(x, order) @ c == pytest.approx(through.deriv()(x), abs=1e-7)
        assert basis_integral(x, order) @ c == pytest.approx(through.integ(lbnd=0.0)(x), abs=1e-9)


def test_the_integral_over_everything_is_the_mean_of_the_coefficients():
    assert basis_integral(np.ones(1)) == pytest.approx(np.full((1, 11), 1.0 / 11.0))


def test_a_fit_recovers_the_model_its_insertions_were_made_of():
    x = np.linspace(0.0, 1.0, 97)
    signs = np.array([-1.0, 1.0])[:, None, None] / np.sqrt(2.0)  # two insertions, one deviation apart (ddof = 1)
    made = fit(x, (REFERENCE.mean + signs * REFERENCE.deviation) @ basis(x).T)
    assert made.mean == pytest.approx(REFERENCE.mean, abs=1e-9)
    assert made.deviation == pytest.approx(REFERENCE.deviation, abs=1e-9)
