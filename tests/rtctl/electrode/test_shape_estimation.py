"""Estimation from one point (spec 02 section 4; (II.15)-(II.19)), against its study numbers and its own conditions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from rtctl.electrode.array_shape import shape_point, tip
from rtctl.electrode.estimation import EstimationError, estimate
from rtctl.electrode.synthetic_arrays import modal_matrix

KNOWN = [modal_matrix(k) for k in range(1, 8)]
MEAN = np.mean(KNOWN, axis=0)
POINT = (16.7742445, 3.4374196)
NODES = np.vander(np.linspace(0, 18, 37), 4, increasing=True)


def test_study_of_array_5():
    assert shape_point(KNOWN[4], 0.0, 17.2) == pytest.approx(POINT, abs=5e-7)
    found = estimate(POINT, KNOWN)
    assert found.place_mm == pytest.approx(17.15790, rel=1e-3)
    assert found.cost_rad2 == pytest.approx(0.263749, rel=1e-3)


def test_tip_errors_of_array_5():
    found = estimate(POINT, KNOWN)
    error = [np.linalg.norm(np.subtract(tip(found.modal_matrix, q), tip(KNOWN[4], q))) for q in np.linspace(0, 15, 31)]
    assert error[0] < 0.1
    assert max(error) < 0.75


def test_the_array_goes_through_the_point_and_its_cost_is_that_of_its_shape():
    found = estimate(POINT, KNOWN)
    assert shape_point(found.modal_matrix, 0.0, found.place_mm) == pytest.approx(POINT, abs=1e-6)
    difference = NODES @ (found.modal_matrix[:, 0] - MEAN[:, 0])
    assert found.cost_rad2 == pytest.approx(difference @ difference, rel=1e-9)
    assert found.rms_rad == pytest.approx(np.sqrt(np.mean(difference**2)))


def test_how_it_curls_is_the_mean_of_its_kind():
    assert estimate(POINT, KNOWN).modal_matrix[:, 1:] == pytest.approx(MEAN[:, 1:])


@settings(max_examples=15)
@given(st.integers(1, 7), st.floats(3.0, 18.0))
def test_a_point_of_the_mean_array_gives_the_mean_array(number, place):
    modal = KNOWN[number - 1]
    found = estimate(shape_point(modal, 0.0, place), [modal])
    assert found.cost_rad2 < 1e-8
    assert found.place_mm == pytest.approx(place, abs=1e-3)
    assert found.modal_matrix[:, 0] == pytest.approx(modal[:, 0], abs=1e-4)


@pytest.mark.parametrize("point", [POINT, (10.0, 1.5), (17.0, 1.0), (5.0, 0.5)])
def test_no_start_of_an_independent_method_finds_a_nearer_shape(point):
    """The constraint as a stiff spring, from random starts."""
    found = estimate(point, KNOWN)
    rng = np.random.default_rng(1)
    scale = 18.0 ** np.arange(4)
    start = np.append(found.modal_matrix[:, 0] * scale, found.place_mm)

    def residuals(x):
        fine = np.linspace(0, x[4], 401)
        angle = np.vander(fine / 18, 4, increasing=True) @ x[:4]
        end = np.trapezoid(np.stack((np.cos(angle), np.sin(angle))), fine, axis=1)
        return np.append(
            np.vander(np.linspace(0, 1, 37), 4, increasing=True) @ x[:4] - NODES @ MEAN[:, 0], 3e3 * (end - point)
        )

    for _ in range(6):
        x = start + rng.normal(0, (0.1, 0.3, 0.3, 0.3, 0.5))
        x[4] = np.clip(x[4], np.hypot(*point), 17.99)
        other = least_squares(residuals, x, bounds=([-np.inf] * 4 + [0.0], [np.inf] * 4 + [18.0]))
        assert 2 * other.cost > found.cost_rad2 * 0.999


@pytest.mark.parametrize(
    ("point", "known", "message"),
    [
        ((19.0, 0.0), KNOWN, "does not reach the measured point: got 19.0"),
        ((0.0, 0.0), KNOWN, "does not reach"),
        ((np.nan, 1.0), KNOWN, "two finite numbers"),
        ((1.0, 2.0, 3.0), KNOWN, "two finite numbers"),
        (POINT, [], "no calibrated array"),
        (POINT, [np.full((4, 4), np.nan)], "not usable"),
        ((-10.0, 3.0), KNOWN, "unlike the known ones|no array was found"),
        ((5.0, 12.0), KNOWN, "unlike the known ones goes through the measured point: got .*0.5 rad rms"),
    ],
)
def test_a_useless_point_is_refused(point, known, message):
    with pytest.raises(EstimationError, match=message):
        estimate(point, known)
