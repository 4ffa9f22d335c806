"""Calibration of the modal matrix from measured bending angles (spec 02 section 3; (II.9)-(II.14))."""

import numpy as np
from numpy.typing import ArrayLike

from hal.errors import RtctlError
from rtctl.electrode.array_shape import LENGTH_MM, ORDER, STYLET_MAX_MM


def calibrate(s_mm: ArrayLike, stylet_mm: ArrayLike, angle_rad: ArrayLike) -> np.ndarray:
    """Least-squares modal matrix A (4, 4) of angles (w, z) measured at arc lengths (w,) and withdrawals (z,).

    Solves (Gamma^T kron Omega) vec(A) = vec(Phi), vec by columns. s and q are scaled to one, because the raw
    matrix has a condition number of 4e7.

    Raises:
        RtctlError: the angles do not fit the samples, are not finite, or the samples cannot determine A.
    """
    s, q, angle = (np.asarray(v, dtype=float) for v in (s_mm, stylet_mm, angle_rad))
    if angle.shape != (s.size, q.size):
        raise RtctlError("calibration angles do not match the samples", value=angle.shape, bound=f"{s.size} x {q.size}")
    if not all(np.isfinite(v).all() for v in (s, q, angle)):
        raise RtctlError("calibration samples must be finite numbers", remedy="leave the incomplete image out")
    for name, samples in (("arc lengths", s), ("stylet withdrawals", q)):
        if np.unique(samples).size < ORDER:
            raise RtctlError(
                f"too few different {name} to calibrate", value=np.unique(samples).size, bound="at least 4"
            )
    omega = np.vander(s / LENGTH_MM, ORDER, increasing=True)
    gamma = np.vander(q / STYLET_MAX_MM, ORDER, increasing=True).T
    scaled, *_ = np.linalg.lstsq(np.kron(gamma.T, omega), angle.ravel(order="F"), rcond=None)
    powers = np.arange(ORDER)
    return scaled.reshape((ORDER, ORDER), order="F") / np.outer(LENGTH_MM**powers, STYLET_MAX_MM**powers)
