"""Spec 08 section 5, item 1: a cantilever under a tip load is the elastica."""

import math

import numpy as np
import pytest
from bare_rod import LENGTH_MM, BareRod
from scipy.integrate import solve_bvp

BENDING_NMM2 = 1.0


def elastica_tip_mm(load_n):
    """Tip (x, y) of an inextensible cantilever under a dead load (F_x, F_y) at its tip, by its boundary-value problem.

    B theta'' = F_x sin(theta) - F_y cos(theta), theta(0) = 0, theta'(L) = 0; x' = cos(theta), y' = sin(theta).
    """
    fx, fy = load_n

    def slope(_s, u):
        theta, turn = u[0], u[1]
        return np.stack((turn, (fx * np.sin(theta) - fy * np.cos(theta)) / BENDING_NMM2, np.cos(theta), np.sin(theta)))

    def ends(a, b):
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0.0, LENGTH_MM, 400)
    guess = np.zeros((4, s.size))
    guess[0] = 0.5 * math.copysign(1.0, fy) * s / LENGTH_MM
    guess[2] = s
    solution = solve_bvp(slope, ends, s, guess, tol=1e-9, max_nodes=100_000)
    assert solution.success
    return solution.y[2:, -1]


def error(segments, load_n):
    """Distance of the rod's tip from the elastica's, over the length."""
    rod = BareRod(segments, BENDING_NMM2)
    rod.load_n[segments] = load_n
    rod.relax()
    return float(np.hypot(*(rod.nodes_mm[-1] - elastica_tip_mm(load_n))) / LENGTH_MM)


@pytest.mark.parametrize("bearing_deg", [60.0, 90.0, 120.0])
@pytest.mark.parametrize("strength", [0.5, 2.0, 8.0])
def test_a_cantilever_under_a_tip_load_is_the_elastica(strength, bearing_deg):
    """`strength` is F L^2 / B: up to a tip that points along the load."""
    force_n, bearing = strength * BENDING_NMM2 / LENGTH_MM**2, math.radians(bearing_deg)
    load_n = force_n * np.array([math.cos(bearing), math.sin(bearing)])
    assert error(40, load_n) < 1e-3


def test_the_error_is_of_second_order_in_the_segment():
    """Clamped at the middle of its first edge: anywhere else, the order would be one."""
    load_n = np.array([0.0, 3.0 * BENDING_NMM2 / LENGTH_MM**2])
    errors = [error(segments, load_n) for segments in (20, 40, 80)]
    # the segment is L / (N - 1/2)
    orders = [
        math.log(coarse / fine) / math.log((2 * n - 0.5) / (n - 0.5))
        for coarse, fine, n in zip(errors[:-1], errors[1:], (20, 40), strict=True)
    ]
    assert orders == pytest.approx([2.0, 2.0], abs=0.1)


def test_a_stretched_rod_follows_hooke():
    rod = BareRod(40, axial_n=150.0)
    rod.load_n[-1, 0] = 0.3
    rod.relax()
    # half of the first edge is in the gripper
    assert rod.nodes_mm[-1, 0] - rod.nodes_mm[1, 0] == pytest.approx((LENGTH_MM - rod.record["edge_mm"] / 2) * 1.002)
