"""Spec 08 section 5, item 2: Euler's loads."""

import math

import numpy as np
import pytest
from bare_rod import LENGTH_MM, BareRod
from scipy.optimize import brentq
from scipy.special import ellipk

BENDING_NMM2 = 1.0
CLAMPED_PINNED = brentq(lambda k: math.tan(k) - k, 4.4, 4.6) ** 2
"""20.19: the least root of tan k = k, squared."""


def buckling_load_n(segments, pinned):
    """The compression at which the straight rod's Hessian loses its positive sign, by bisection."""
    rod = BareRod(segments, BENDING_NMM2)
    if pinned:
        rod.hold_n_per_mm[segments, 1] = 1e6
    low, high = 0.0, 40.0 * BENDING_NMM2 / LENGTH_MM**2
    for _ in range(40):
        load = 0.5 * (low + high)
        rod.load_n[segments, 0] = -load
        rod.relax()  # it stays straight: nothing pushes it aside
        assert np.all(rod.nodes_mm[:, 1] == 0.0)
        low, high = (load, high) if rod.turned() == 0 else (low, load)
    return high


@pytest.mark.parametrize(
    ("pinned", "factor"), [(False, math.pi**2 / 4), (True, CLAMPED_PINNED)], ids=["clamped-free", "clamped-pinned"]
)
def test_the_buckling_load_is_eulers(pinned, factor):
    assert pytest.approx(20.19, abs=5e-3) == CLAMPED_PINNED
    euler_n = factor * BENDING_NMM2 / LENGTH_MM**2
    errors = [buckling_load_n(segments, pinned) / euler_n - 1.0 for segments in (20, 40)]
    assert abs(errors[1]) < 0.01
    assert abs(errors[1]) < 0.3 * abs(errors[0])  # second order


@pytest.mark.parametrize(("load", "deflected"), [(0.95, False), (1.05, True)])
def test_an_imperfect_rod_deflects_beyond_eulers_load(load, deflected):
    """The postbuckled elastica: at 1.05 P_cr the tip stands aside by a third of the length."""
    rod = BareRod(40, BENDING_NMM2)
    euler_n = math.pi**2 / 4 * BENDING_NMM2 / LENGTH_MM**2
    rod.load_n[40] = -load * euler_n, 1e-4 * euler_n
    rod.relax(5000)
    aside = abs(rod.nodes_mm[-1, 1]) / LENGTH_MM
    # P / P_cr = (2 K(k) / pi)^2 and aside = 2 k sqrt(B / P) with k = sin(theta_tip / 2)
    k = brentq(lambda k: (2.0 * ellipk(k * k) / math.pi) ** 2 - 1.05, 0.01, 0.9)
    expected = 2.0 * k / math.sqrt(1.05 * math.pi**2 / 4)
    assert aside == pytest.approx(expected, rel=0.01) if deflected else aside < 0.01
