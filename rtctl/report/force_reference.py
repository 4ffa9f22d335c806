"""Insertion forces of the reference study: Bernstein polynomials over the depth (Table V.2; spec 03 section 1)."""

import math

import numpy as np

FULL_DEPTH_MM = 13.8
"""Depth of λ = 1."""

MEAN_N = (-0.00368, 0.00322, -0.09043, 0.27410, -0.66837, 0.48569, -0.32705, 0.08950, -0.09196, -0.02012, -0.09988)
DEVIATION_N = (0.00754, 0.00454, -0.07346, 0.31662, -0.53801, 0.81025, -0.77213, 0.51994, -0.15782, 0.07319, 0.11535)
"""Coefficients of the mean and of the standard deviation of f_z; resistance is negative."""


def bernstein(coefficients: tuple[float, ...], x: np.ndarray) -> np.ndarray:
    """Sum of c_i binom(n, i) x^i (1 - x)^(n - i) at `x` (k,) in [0, 1]."""
    n = len(coefficients) - 1
    return np.sum([c * math.comb(n, i) * x**i * (1 - x) ** (n - i) for i, c in enumerate(coefficients)], axis=0)


def resistance(depth_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean resistance and standard deviation (k,) [N], both positive, at depths (k,) in 0 .. 13.8 mm."""
    share = depth_mm / FULL_DEPTH_MM
    return -bernstein(MEAN_N, share), bernstein(DEVIATION_N, share)
