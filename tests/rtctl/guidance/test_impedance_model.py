"""The boundary-element model of a pair: the table of 04 section 2, closed forms, and solvers that share nothing with it."""

import math

import finite_elements
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from bench.impedance_cost import solve_in_numpy
from rtctl.guidance.impedance.boundary_elements import BoundaryError, polygon, solve
from rtctl.guidance.impedance.influence import flux_influence, potential_influence
from rtctl.guidance.impedance.pair_model import (
    CONDUCTIVITY_S_PER_MM,
    CURRENT_A,
    RATIO,
    PairError,
    area_mm2,
    fluid,
    impedance_ohm,
)

TABLE = {
    0.1: (3423.3357, 1693.2246, 1424.3783),
    0.3: (1601.8103, 1394.5038, 1345.7285),
    0.6: (1351.1574, 1332.1453, 1327.5832),
    1.0: (1324.6479, 1323.4498, 1325.1418),
}
coordinate = st.floats(-2.0, 2.0)


def lengths_mm(boundary):
    return np.linalg.norm(np.roll(boundary.node_mm, -1, axis=0) - boundary.node_mm, axis=1)


@pytest.mark.parametrize("h", TABLE)
def test_table_of_the_specification(h):
    assert [impedance_ohm(h, alpha) for alpha in (0.0, 0.5, 1.0)] == pytest.approx(TABLE[h], rel=1e-6, abs=0.0)


def test_source_at_the_wide_end():
    assert impedance_ohm(0.1, 0.5, source_far=True) == pytest.approx(1650.88, abs=0.005)
    assert impedance_ohm(0.1, 0.0, source_far=True) == pytest.approx(impedance_ohm(0.1, 0.0), rel=1e-10)


def test_convergence_is_monotone_and_below_four_permille_from_25_elements_on():
    z = {n: impedance_ohm(1.0, 0.0, n) for n in (10, 20, 25, 30, 80)}
    assert [z[n] for n in (10, 25, 30, 80)] == pytest.approx([1309.956, 1323.704, 1324.648, 1326.470], abs=5e-4)
    assert sorted(z.values()) == list(z.values())
    assert 1.0 - z[25] / z[80] == pytest.approx(0.00209, abs=5e-6)


def test_thirty_elements_on_a_contact_are_270_and_lose_half_a_permille_of_the_current():
    boundary = fluid(1.0, 0.0)
    potential, flux = solve(boundary)
    assert len(potential) == 270
    assert np.bincount(boundary.curve).tolist() == (30 * RATIO).tolist()
    out = -(flux * lengths_mm(boundary))[boundary.curve == 2].sum() * CONDUCTIVITY_S_PER_MM
    assert out / CURRENT_A == pytest.approx(0.999549, abs=5e-7)


@pytest.mark.parametrize(("h", "alpha"), [(0.1, 0.0), (0.7, 0.4), (1.0, 1.0)])
def test_sides_are_those_of_table_vii_2_and_enclose_the_area(h, alpha):
    boundary = fluid(h, alpha)
    sides = np.bincount(boundary.curve, lengths_mm(boundary))
    far = h + 0.82 * math.tan(alpha)
    assert sides == pytest.approx([0.2, 0.42, 0.2, far, 0.82 / math.cos(alpha), h])
    x, y = boundary.node_mm.T
    enclosed = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert enclosed == pytest.approx(area_mm2(h, alpha))
    assert enclosed == pytest.approx(0.82 * h + 0.3362 * math.tan(alpha))


@pytest.mark.parametrize(
    ("h", "alpha", "printed"),
    [(0.1, 0.0, 3416.27), (0.1, 1.0, 1422.66), (0.5, 0.5, 1339.24), (1.0, 0.0, 1326.34)],
)
def test_finite_elements_agree(h, alpha, printed):
    fine = finite_elements.impedance_ohm(h, alpha)
    assert fine == pytest.approx(printed, rel=3e-5), "the other solver is the one of the specification"
    assert impedance_ohm(h, alpha) == pytest.approx(fine, rel=0.003)


def test_rectangle_conducts_like_a_wire():
    """Patch test: current from end to end of 0.82 x 0.3, whose potential is linear."""
    z = {}
    for n in (10, 40):
        corner = np.array([(0.0, 0.0), (0.82, 0.0), (0.82, 0.3), (0.0, 0.3)])
        flux = np.array([0.0, 0.0, 0.0, CURRENT_A / (0.3 * CONDUCTIVITY_S_PER_MM)])
        boundary = polygon(corner, np.array([3 * n, n, 3 * n, n]), np.array([False, True, False, False]), flux)
        potential, _ = solve(boundary)
        z[n] = potential[boundary.curve == 3].mean() / CURRENT_A
    exact = 0.82 / (0.3 * CONDUCTIVITY_S_PER_MM)
    assert exact == pytest.approx(1708.333, abs=5e-4)
    assert z[40] == pytest.approx(1707.980, abs=5e-4)
    assert abs(z[40] - exact) < 0.25 * abs(z[10] - exact)


def test_a_potential_given_at_both_ends_is_linear_between_them():
    corner = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])
    given_v, known = np.array([0.0, 5.0, 0.0, 1.0]), np.array([False, True, False, True])
    boundary = polygon(corner, np.array([80, 40, 80, 40]), known, given_v)
    potential, flux = solve(boundary)
    middle_x = boundary.node_mm[:80, 0] + 0.0125
    assert potential[:80] == pytest.approx(1.0 + 2.0 * middle_x, abs=0.01)
    assert flux[boundary.curve == 1].mean() == pytest.approx(2.0, abs=0.02)


@given(*[coordinate] * 6)
def test_closed_forms_are_the_integrals(x0, y0, x1, y1, x, y):
    """F_1 and F_2 against adaptive quadrature of Phi and of its normal derivative."""
    length = math.hypot(x1 - x0, y1 - y0)
    tx, ty = (x1 - x0) / max(length, 1e-300), (y1 - y0) / max(length, 1e-300)
    foot = min(max((x - x0) * tx + (y - y0) * ty, 0.0), length)
    distance = math.hypot(x0 + foot * tx - x, y0 + foot * ty - y)
    if length < 0.05 or distance < 0.05:
        return

    def phi(s):
        return math.log((x0 + s * tx - x) ** 2 + (y0 + s * ty - y) ** 2) / (4.0 * math.pi)

    def slope(s):
        rx, ry = x0 + s * tx - x, y0 + s * ty - y
        return (rx * ty - ry * tx) / (2.0 * math.pi * (rx * rx + ry * ry))

    for form, integrand in ((potential_influence, phi), (flux_influence, slope)):
        exact, _ = quad(integrand, 0.0, length, epsabs=1e-14, epsrel=1e-12, limit=200, points=[foot])
        assert form(x0, y0, x1, y1, x, y) == pytest.approx(exact, abs=1e-13)


@given(angle=st.floats(1e-7, 0.2), turned=st.floats(-3.2, 3.2))
def test_an_element_seen_from_far_away_is_seen_to_the_last_digit(angle, turned):
    """Where the series takes over from the arc tangent."""
    ends = [(3.0 * math.cos(turned + w), 3.0 * math.sin(turned + w)) for w in (0.0, angle)]
    assert 2.0 * math.pi * flux_influence(*ends[0], *ends[1], 0.0, 0.0) == pytest.approx(angle, rel=1e-8, abs=2e-15)
    exact = math.atan2(
        ends[0][0] * ends[1][1] - ends[0][1] * ends[1][0], ends[0][0] * ends[1][0] + ends[0][1] * ends[1][1]
    )
    assert 2.0 * math.pi * flux_influence(*ends[0], *ends[1], 0.0, 0.0) == pytest.approx(exact, rel=1e-15, abs=0.0)


def test_an_element_at_its_own_midpoint():
    length = 0.3
    assert flux_influence(0.0, 0.0, 0.1, math.sqrt(0.08), 0.05, math.sqrt(0.02)) == 0.0
    exact = length / (2.0 * math.pi) * (math.log(length / 2.0) - 1.0)
    assert potential_influence(1.0, 2.0, 1.0 + length, 2.0, 1.0 + length / 2.0, 2.0) == pytest.approx(exact, abs=1e-14)


def printed_forms(x0, y0, x1, y1, x, y):
    """F_1 and F_2 as (VII.15) prints them."""
    length = math.hypot(x1 - x0, y1 - y0)
    nx, ny = (y1 - y0) / length, -(x1 - x0) / length
    a, b = length**2, 2.0 * length * (-ny * (x0 - x) + nx * (y0 - y))
    e = (x0 - x) ** 2 + (y0 - y) ** 2
    q = math.sqrt(max(4.0 * a * e - b * b, 0.0))
    w = math.atan((2.0 * a + b) / q) - math.atan(b / q)
    logs = -b / (2.0 * a) * math.log(abs(e / a)) + (1.0 + b / (2.0 * a)) * math.log(abs(1.0 + b / a + e / a))
    f1 = length / (4.0 * math.pi) * (2.0 * (math.log(length) - 1.0) + logs + q * w / a)
    return f1, length * (nx * (x0 - x) + ny * (y0 - y)) / (math.pi * q) * w


@given(*[st.floats(0.1, 2.0)] * 6)
def test_they_are_the_printed_ones(x0, y0, x1, y1, x, y):
    length = math.hypot(x1 - x0, y1 - y0)
    if length < 0.05 or abs((x0 - x) * (y1 - y0) - (y0 - y) * (x1 - x0)) < 0.01:
        return
    f1, f2 = printed_forms(x0, y0, x1, y1, x, y)
    assert potential_influence(x0, y0, x1, y1, x, y) == pytest.approx(f1, abs=1e-12)
    assert flux_influence(x0, y0, x1, y1, x, y) == pytest.approx(f2, abs=1e-12)


def test_all_flux_influences_of_a_closed_boundary_add_up_to_one_inside_and_half_on_it():
    """(VII.13)."""
    node = fluid(0.4, 0.3).node_mm
    after = np.roll(node, -1, axis=0)
    for point, total in (((0.4, 0.2), 1.0), ((0.4, -0.1), 0.0), ((0.41, 0.0), 0.5)):
        seen = sum(flux_influence(*a, *b, *point) for a, b in zip(node, after, strict=True))
        assert seen == pytest.approx(total, abs=1e-12)


@pytest.mark.parametrize(("h", "alpha"), [(0.1, 0.0), (0.3, 0.5), (1.0, 1.0)])
def test_the_printed_formulas_in_numpy_give_the_same(h, alpha):
    """What the bench compares with."""
    assert solve_in_numpy(fluid(h, alpha)) == pytest.approx(impedance_ohm(h, alpha), rel=1e-9)


@given(h=st.floats(0.05, 0.8), alpha=st.floats(0.0, 0.9))
def test_impedance_falls_with_the_distance_and_with_the_inclination(h, alpha):
    if h < 0.6:
        assert impedance_ohm(h + 0.05, alpha) < impedance_ohm(h, alpha) + 1.0
        assert impedance_ohm(h, alpha + 0.05) < impedance_ohm(h, alpha) + 1.0
    assert 1300.0 < impedance_ohm(h, alpha) < 8000.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0.0, 0.1), "distance"), ((-1.0, 0.1), "distance"), ((math.nan, 0.1), "distance"), ((math.inf, 0.1), "distance"),
        ((0.1, -0.1), "inclination"), ((0.1, 1.6), "inclination"), ((0.1, math.nan), "inclination"), ((0.1, 0.1, 0), "element"),
    ],
)  # fmt: skip
def test_what_is_no_pair_is_refused(arguments, words):
    with pytest.raises(PairError, match=words):
        impedance_ohm(*arguments)


def test_a_boundary_without_a_potential_is_refused():
    corner = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    with pytest.raises(BoundaryError, match="somewhere"):
        solve(polygon(corner, np.array([4, 4, 4]), np.zeros(3, dtype=bool), np.zeros(3)))
    with pytest.raises(BoundaryError, match="no area"):
        solve(polygon(0.0 * corner, np.array([4, 4, 4]), np.array([True, False, False]), np.zeros(3)))
