"""Power law: inversion with its bound, and the fits of 04 section 3, the one that fails to reach the print included."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtctl.guidance.impedance.fit import NEAR, PRINTED, PUBLISHED, Design, fit
from rtctl.guidance.impedance.power_law import area_of_impedance, impedance_of_area, impedance_slope

LAW = (83.2, -1.317, 1149.0)


@pytest.mark.parametrize(
    ("z", "area"),
    [(1300.0, 0.635993), (2000.0, 0.171101), (1260.62, 0.8), (1200.0, 0.8), (1149.0, 0.8), (900.0, 0.8), (-5.0, 0.8)],
)
def test_inversion_of_the_specification(z, area):
    assert area_of_impedance(z, *LAW, 0.8) == pytest.approx(area, abs=1e-6)


def test_the_bound_is_where_the_specification_has_it():
    assert impedance_of_area(0.8, *LAW) == pytest.approx(1260.623, abs=5e-4)
    assert area_of_impedance(1260.63, *LAW, 0.8) < 0.8


@pytest.mark.parametrize(("z", "slope"), [(1300.0, -3.20e-3), (2000.0, -1.53e-4)])
def test_noise_weighs_most_far_from_the_wall(z, slope):
    area = area_of_impedance(z, *LAW, 0.8)
    assert 1.0 / impedance_slope(area, *LAW[:2]) == pytest.approx(slope, rel=3e-3)


@given(st.floats(0.01, 0.8))
def test_area_and_impedance_are_each_others_inverse(area):
    z = impedance_of_area(area, *LAW)
    assert area_of_impedance(z, *LAW, 0.8) == pytest.approx(area, rel=1e-9)
    h = 1e-6 * area
    difference = (impedance_of_area(area + h, *LAW) - impedance_of_area(area - h, *LAW)) / (2.0 * h)
    assert impedance_slope(area, *LAW[:2]) == pytest.approx(difference, rel=1e-5)


@given(st.floats(-1e4, 1e5))
def test_the_area_is_always_possible(z):
    assert 0.0 < area_of_impedance(z, *LAW, 0.8) <= 0.8


def test_a_fit_finds_the_law_it_was_given():
    area = np.geomspace(0.05, 1.0, 40)
    found = fit(area, impedance_of_area(area, *LAW))
    assert (found.factor_ohm, found.exponent, found.far_field_ohm) == pytest.approx(LAW, rel=1e-8)
    assert found.r2 == pytest.approx(1.0, abs=1e-12)
    assert found.rmse_ohm < 1e-6


@pytest.fixture(scope="module")
def fits():
    return {design.name: fit(*design.samples()) for design in (PRINTED, NEAR)}


@pytest.mark.parametrize(
    ("design", "coefficients", "r2", "rmse", "std"),
    [
        (PRINTED, (36.27, -1.6593, 1272.7), 0.9788, 30.5, 208.0),
        (NEAR, (83.05, -1.3225, 1155.7), 0.9907, 69.2, 716.0),
    ],
)
def test_fits_of_the_named_designs(fits, design, coefficients, r2, rmse, std):
    found = fits[design.name]
    assert (found.factor_ohm, found.exponent, found.far_field_ohm) == pytest.approx(coefficients, rel=1e-3)
    assert found.r2 == pytest.approx(r2, abs=1e-4)
    assert found.rmse_ohm == pytest.approx(rmse, rel=0.005)
    assert found.std_ohm == pytest.approx(std, rel=0.005)


def test_the_printed_ranges_do_not_lead_to_the_published_law(fits):
    """A documented deviation: R^2 and RMSE of Table VII.4 need samples three times as scattered as those ranges give."""
    printed, near = fits[PRINTED.name], fits[NEAR.name]
    assert PUBLISHED.std_ohm == pytest.approx(767.0, abs=1.0)
    assert printed.std_ohm < 0.3 * PUBLISHED.std_ohm
    assert not 79.84 <= printed.factor_ohm <= 86.57
    assert 79.84 <= near.factor_ohm <= 86.57


def test_a_design_is_a_product_grid():
    area, z = Design("two by three", np.array([0.2, 0.5]), np.array([0.0, 0.1, 0.2])).samples()
    assert area.shape == z.shape == (6,)
    assert area[[0, 3]] == pytest.approx([0.82 * 0.2, 0.82 * 0.5])
