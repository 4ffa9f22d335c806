"""Stiffness of a wire rope over its load, from a tensile test (05 section 2; (III.28)-(III.33))."""

import numpy as np
from numpy.typing import ArrayLike

from rtctl.calibrate.errors import CalibrationError

DECAY_PER_MM2 = 20.0
"""alpha: a sample 0.4 mm away has 4 % of the weight."""


def local_stiffness(
    elongation_mm: ArrayLike, tension_n: ArrayLike, at_mm: ArrayLike, decay_per_mm2: float = DECAY_PER_MM2
) -> np.ndarray:
    """Slope of the tension [N/mm] at the elongations `at_mm` (m,), by weighted regression on samples (n,).

    kappa = [(A^T W A)^-1 A^T W t]_2 with A = [1, y] and W = exp(-alpha (y - y_i)^2), (III.30) to (III.32) corrected. At the
    ends of the samples the weights are one-sided, and the slope is that some tenths of a millimetre inside.

    Raises:
        CalibrationError: samples that do not belong together, are not finite, or too few near a point.
    """
    y, t, at = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (elongation_mm, tension_n, at_mm))
    if y.shape != t.shape or y.ndim != 1:
        raise CalibrationError("elongations and tensions do not belong together", value=f"{y.shape} and {t.shape}")
    if not all(np.isfinite(v).all() for v in (y, t, at)):
        raise CalibrationError("elongations and tensions must be finite numbers", remedy="leave the bad samples out")
    away = y - at[:, None]
    weight = np.exp(-decay_per_mm2 * away**2)
    total = weight.sum(axis=1)
    if len(y) < 2 or not (total > 1.0).all():
        k = int(np.argmin(total)) if len(y) else 0
        raise CalibrationError("too few samples near an elongation", value=float(at[k]), bound="two within 0.2 mm", remedy="choose points inside the test")  # fmt: skip
    mean_y, mean_t = (weight * away).sum(axis=1) / total, (weight * t).sum(axis=1) / total
    y_about, t_about = away - mean_y[:, None], t - mean_t[:, None]
    spread = (weight * y_about**2).sum(axis=1)
    if not (spread > 0.0).all():
        raise CalibrationError("all samples near an elongation have the same one", value=float(at[int(np.argmin(spread))]))  # fmt: skip
    return (weight * y_about * t_about).sum(axis=1) / spread


def axial_rigidity_n(stiffness_n_per_mm: ArrayLike, length_mm: float) -> np.ndarray:
    """E A [N] of a specimen of a length ((III.33))."""
    return np.asarray(stiffness_n_per_mm, dtype=float) * length_mm
