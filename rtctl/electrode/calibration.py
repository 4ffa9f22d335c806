"""Calibration of the modal matrix from measured bending angles (spec 02 section 3; (II.10)-(II.14)).

Phi = Omega A Gamma is linear in A. By columns, vec(Phi) = (Gamma^T kron Omega) vec(A), and each measured angle is a row
of it. s and q are scaled to one, because the raw matrix has a condition number of 4e7.
"""

import numpy as np
from numpy.typing import ArrayLike

from hal.errors import RtctlError
from rtctl.electrode.array_shape import LENGTH_MM, ORDER, STYLET_MAX_MM

POWERS = np.arange(ORDER)


def calibrate(s_mm: ArrayLike, stylet_mm: ArrayLike, angle_rad: ArrayLike) -> np.ndarray:
    """Least-squares modal matrix A (4, 4) of angles (w, z) measured at arc lengths (w,) and withdrawals (z,).

    Raises:
        RtctlError: the angles do not fit the samples, are not finite, or the samples cannot determine A.
    """
    s, q, angle = (np.asarray(v, dtype=float) for v in (s_mm, stylet_mm, angle_rad))
    if angle.shape != (s.size, q.size):
        raise RtctlError("calibration angles do not match the samples", value=angle.shape, bound=f"{s.size} x {q.size}")
    every_s, every_q = np.tile(s, q.size), np.repeat(q, s.size)
    return calibrate_segments(every_s, every_s, every_q, angle.ravel(order="F"))


def calibrate_segments(from_mm: ArrayLike, to_mm: ArrayLike, stylet_mm: ArrayLike, angle_rad: ArrayLike) -> np.ndarray:
    """Least-squares modal matrix A (4, 4) of the mean angles (n,) of n segments of the array.

    A segment reaches from one arc length to another, at one withdrawal; one of no length is a point. Segments may lie
    anywhere: two images need not have been digitised at the same places.

    Raises:
        RtctlError: as :func:`calibrate`.
    """
    start, end, q, angle = (np.asarray(v, dtype=float) for v in (from_mm, to_mm, stylet_mm, angle_rad))
    if not all(np.isfinite(v).all() for v in (start, end, q, angle)):
        raise RtctlError("calibration samples must be finite numbers", remedy="leave the incomplete image out")
    for name, samples in (("arc lengths", start + end), ("stylet withdrawals", q)):
        if np.unique(samples).size < ORDER:
            raise RtctlError(
                f"too few different {name} to calibrate", value=np.unique(samples).size, bound="at least 4"
            )
    omega = mean_powers(start / LENGTH_MM, end / LENGTH_MM)
    gamma = np.vander(q / STYLET_MAX_MM, ORDER, increasing=True)
    rows = (gamma[:, :, None] * omega[:, None, :]).reshape(len(angle), ORDER * ORDER)
    scaled, *_ = np.linalg.lstsq(rows, angle, rcond=None)
    return scaled.reshape((ORDER, ORDER), order="F") / np.outer(LENGTH_MM**POWERS, STYLET_MAX_MM**POWERS)


def segment_angles(
    modal_matrix: np.ndarray, from_mm: np.ndarray, to_mm: np.ndarray, stylet_mm: np.ndarray
) -> np.ndarray:
    """Mean angles (n,) [rad] that the model gives segments: of (II.6), over each of them."""
    eta = np.vander(stylet_mm, ORDER, increasing=True)
    return np.einsum("ni,ij,nj->n", mean_powers(from_mm, to_mm), modal_matrix, eta)


def mean_powers(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Mean (n, 4) of 1, s, s^2, s^3 over segments, written so that a segment of no length is no special case."""
    a, b = start, end
    ones = np.ones_like(a)
    return np.stack((ones, (a + b) / 2, (a * a + a * b + b * b) / 3, (a * a + b * b) * (a + b) / 4), axis=1)
