"""The power law fitted to the boundary-element model over a design of pair geometries (04 section 3; Table VII.4).

The sampling behind the published coefficients is not printed, and the ranges that are do not lead to them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from rtctl.guidance.impedance.pair_model import area_mm2, impedance_ohm
from rtctl.guidance.impedance.power_law import EXPONENT, FACTOR_OHM, FAR_FIELD_OHM


@dataclass(frozen=True)
class Design:
    """Pair geometries on a product grid: distances h [mm] (n,) and inclinations alpha [rad] (m,)."""

    name: str
    h_mm: np.ndarray
    alpha_rad: np.ndarray

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Area [mm^2] and impedance [ohm] of every geometry, both (n m,)."""
        grid = [(h, a) for h in self.h_mm for a in self.alpha_rad]
        area = np.array([area_mm2(h, a) for h, a in grid])
        return area, np.array([impedance_ohm(h, a) for h, a in grid])


@dataclass(frozen=True)
class Fit:
    """z = a A^b + c of n samples.

    rmse_ohm: root of the squared residuals over n - 3. std_ohm: standard deviation of the samples.
    """

    factor_ohm: float
    exponent: float
    far_field_ohm: float
    r2: float
    rmse_ohm: float
    std_ohm: float


PRINTED = Design("printed ranges: h 0.1 to 1, alpha 0 to 1", np.linspace(0.1, 1.0, 20), np.linspace(0.0, 1.0, 20))
NEAR = Design("h 0.05 to 1, alpha 0 to 0.2", np.linspace(0.05, 1.0, 20), np.linspace(0.0, 0.2, 20))
PUBLISHED = Fit(FACTOR_OHM, EXPONENT, FAR_FIELD_OHM, 0.9964, 46.0, 46.0 / (1.0 - 0.9964) ** 0.5)
"""Table VII.4; the deviation of the samples follows from R^2 and RMSE."""


def fit(area: np.ndarray, z_ohm: np.ndarray) -> Fit:
    """Unweighted least squares over areas [mm^2] and impedances [ohm], both (n,)."""

    def misfit(p: np.ndarray) -> np.ndarray:
        return p[0] * area ** p[1] + p[2] - z_ohm

    def slope(p: np.ndarray) -> np.ndarray:
        power = area ** p[1]
        return np.column_stack((power, p[0] * power * np.log(area), np.ones_like(area)))

    found = least_squares(misfit, (80.0, -1.3, 1200.0), slope, method="lm", x_scale="jac", xtol=1e-13, ftol=1e-13)
    squares = 2.0 * found.cost
    spread = z_ohm - z_ohm.mean()
    a, b, c = map(float, found.x)
    rmse = float(np.sqrt(squares / (len(z_ohm) - 3)))
    return Fit(a, b, c, 1.0 - squares / float(spread @ spread), rmse, float(z_ohm.std(ddof=1)))
