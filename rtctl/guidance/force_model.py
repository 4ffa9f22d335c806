"""Insertion forces over depth as Bernstein polynomials (03 section 1; D Chapter V).

lambda = q / q_max runs from 0 to 1 at full depth. The three channels are, in this order, f_z [N] along the insertion axis,
where resistance is negative, and the moments f_xx, f_yy [N mm] about the axes of the sensor {F}.
"""

from dataclasses import dataclass
from math import comb

import numpy as np

ORDER = 10
"""Degree n of the polynomials."""
FULL_DEPTH_MM = 13.8
"""q_max: depth of lambda = 1."""
AOS_START = 7.0 / FULL_DEPTH_MM
"""lambda where the stylet begins to be held back."""
CHANNELS = ("f_z", "f_xx", "f_yy")

FLOOR = (0.004, 0.10, 0.10)
"""beta: standard deviation of the sensor's noise [N, N mm, N mm]."""

TABLE_V_2 = (
    (-0.00368, 0.00322, -0.09043, 0.27410, -0.66837, 0.48569, -0.32705, 0.08950, -0.09196, -0.02012, -0.09988),
    (-0.02584, -0.30809, 1.67939, -3.86249, 2.56596, 3.16762, -4.02440, 3.20528, 0.00664, -0.12767, -0.41673),
    (0.01062, -0.10120, 0.67325, -2.18398, 4.65950, -6.10697, 2.50529, -1.68914, -0.12048, -0.69473, -0.19172),
)
"""Coefficients of the mean over the reference insertions, channel by channel (Table V.2)."""
TABLE_V_2_DEVIATION = (
    (0.00754, 0.00454, -0.07346, 0.31662, -0.53801, 0.81025, -0.77213, 0.51994, -0.15782, 0.07319, 0.11535),
    (0.06385, -0.19397, 1.17943, -3.78169, 9.13224, -5.35123, 4.77472, 0.43311, 1.75574, 1.35499, 1.47611),
    (0.04616, -0.07260, 0.39600, -1.43339, 4.16891, -3.64368, 3.21728, -0.37063, 0.87301, 0.46814, 1.06752),
)
"""Coefficients of the standard deviation over them."""


@dataclass(frozen=True)
class ForceModel:
    """What normal insertions feel like: curves of mean and standard deviation.

    Attributes:
        mean, deviation: Bernstein coefficients (channels, 11) [N, N mm, N mm].
        floor: beta (channels,), the deviation below which the sensor itself is the doubt.
    """

    mean: np.ndarray
    deviation: np.ndarray
    floor: np.ndarray


REFERENCE = ForceModel(np.array(TABLE_V_2), np.array(TABLE_V_2_DEVIATION), np.array(FLOOR))
"""The reference study (Table V.2)."""


def basis(x: np.ndarray, order: int = ORDER) -> np.ndarray:
    """T_i(x) = binom(n, i) x^i (1 - x)^(n - i) at `x` (k,) in [0, 1]: (k, n + 1)."""
    i = np.arange(order + 1)
    binomial = np.array([comb(order, k) for k in i], float)
    x = np.asarray(x, float)[:, None]
    return binomial * x**i * (1.0 - x) ** (order - i)


def basis_derivative(x: np.ndarray, order: int = ORDER) -> np.ndarray:
    """dT_i/dx = n (T_{i-1}^{n-1} - T_i^{n-1}) at `x` (k,): (k, n + 1)."""
    lower = np.pad(basis(x, order - 1), ((0, 0), (1, 1)))
    return order * (lower[:, :-1] - lower[:, 1:])


def basis_integral(x: np.ndarray, order: int = ORDER) -> np.ndarray:
    """Integral of T_i from 0 to `x` (k,): sum of T_j^{n+1}, j > i, over n + 1; (k, n + 1)."""
    higher = basis(x, order + 1)
    return np.cumsum(higher[:, :0:-1], axis=1)[:, ::-1] / (order + 1)


def fit(x: np.ndarray, profiles: np.ndarray, floor: tuple[float, ...] = FLOOR) -> ForceModel:
    """Force model of normal insertions: least squares on their mean and standard deviation (ddof = 1), as in D V.2.

    Args:
        x: lambda (m,) of the samples, m > 10.
        profiles: forces (insertions, channels, m), at least two insertions.
    """
    curves = np.concatenate([profiles.mean(axis=0), profiles.std(axis=0, ddof=1)])
    coefficients = np.linalg.lstsq(basis(x), curves.T, rcond=None)[0].T
    channels = profiles.shape[1]
    return ForceModel(coefficients[:channels], coefficients[channels:], np.array(floor))


def resistance(depth_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean resistance of the reference study and its standard deviation (k,) [N], both positive, at 0 .. 13.8 mm."""
    curves = basis(depth_mm / FULL_DEPTH_MM)
    return -curves @ REFERENCE.mean[0], curves @ REFERENCE.deviation[0]
