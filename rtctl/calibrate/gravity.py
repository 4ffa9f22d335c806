"""Weight, centre of mass and sensor bias from readings at rest in several orientations (05 section 1; D Appendix A).

Readings are those of the raw sensor in {F}; `turns` (n, 3, 3) are the rotations ^F R_B from {B} into {F} they were taken
at. All fits return the parameters of noise-free readings to 1e-9.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rtctl.calibrate.errors import CalibrationError

IDENTIFIABLE = 1e-3
"""A combination of parameters that moves the readings by less than this share of the strongest is not identifiable."""
POSES_MIN = 3
SPHERE_POSES_MIN = 4
ROUNDING = 1e-12
SPREAD_SIGMA = 4.0
"""Readings that spread by less than so many standard deviations of their noise do not spread."""


@dataclass(frozen=True)
class ForceFit:
    """Gravity force (3,) [N] fixed in {B} and bias (3,) [N] in {F}.

    free: (k, 6) unit vectors (gravity in {B}, bias in {F}) along which the readings say nothing; the fit is the solution
    of minimum norm, which has no part along them. What it predicts for turns of the same kind is right all the same.
    """

    gravity_force_in_base_n: np.ndarray
    bias_in_sensor_n: np.ndarray
    free: np.ndarray

    def predict(self, turns: np.ndarray) -> np.ndarray:
        """Readings (n, 3) [N] at `turns` with nothing touching."""
        return turns @ self.gravity_force_in_base_n + self.bias_in_sensor_n


@dataclass(frozen=True)
class MomentFit:
    """Centre of mass (3,) [mm] in {F} and moment bias (3,) [N mm]; `free` as in :class:`ForceFit`."""

    centre_of_mass_in_sensor_mm: np.ndarray
    bias_in_sensor_nmm: np.ndarray
    free: np.ndarray

    def predict(self, weight_in_sensor_n: np.ndarray) -> np.ndarray:
        """Readings (n, 3) [N mm] under the weights (n, 3) [N] in {F}."""
        return np.cross(self.centre_of_mass_in_sensor_mm, weight_in_sensor_n) + self.bias_in_sensor_nmm


def fit_forces(turns: ArrayLike, force_in_sensor_n: ArrayLike) -> ForceFit:
    """The linear fit f = ^F R_B f_g + b_F of readings (n, 3) [N], minimum norm by SVD (05 section 1; (III.57)).

    Raises:
        CalibrationError: shapes that do not fit, numbers that are not finite, or fewer than three readings.
    """
    turns, force = _checked(turns, force_in_sensor_n, POSES_MIN)
    matrix = np.concatenate((turns, np.broadcast_to(np.eye(3), turns.shape)), axis=2).reshape(-1, 6)
    solution, free = _minimum_norm(matrix, force.ravel())
    return ForceFit(solution[:3], solution[3:], free)


def fit_sphere(turns: ArrayLike, force_in_sensor_n: ArrayLike, noise_n: float = 0.0) -> ForceFit:
    """The sphere fit of readings (n, 3) [N]: they lie on a sphere about the bias with the weight as radius ((A.3)-(A.7)).

    Corrected as in 05 section 1: no squares on the left of (A.3), and (A.7) with the bias taken off.

    Args:
        noise_n: standard deviation of the readings. A spread within it is none.

    Raises:
        CalibrationError: as :func:`fit_forces`, or readings in a plane or on a line: no sphere is determined (rank below
            4), as with a mechanism that turns about one axis only.
    """
    turns, force = _checked(turns, force_in_sensor_n, SPHERE_POSES_MIN)
    centre = force.mean(axis=0)  # about it the matrix is well scaled, and its rank is one more than that of the spread
    spread = np.linalg.svd(force - centre, compute_uv=False)
    none = max(SPREAD_SIGMA * noise_n * np.sqrt(len(force)), ROUNDING * float(np.linalg.norm(force)))
    threshold = max(IDENTIFIABLE * spread[0], none)
    rank = 1 + int((spread > threshold).sum())
    if rank < SPHERE_POSES_MIN:
        raise CalibrationError(
            "the readings determine no sphere: they lie in a plane or closer together",
            value=f"rank {rank}",
            bound="rank 4",
            remedy="use the linear fit, or orientations about two axes at least",
        )
    about = force - centre
    matrix = np.column_stack((about, np.ones(len(about))))
    a, *_ = np.linalg.lstsq(matrix, -np.sum(about**2, axis=1), rcond=None)
    offset = -a[:3] / 2
    weight = np.sqrt(max(float(offset @ offset - a[3]), 0.0))
    bias = centre + offset
    direction = np.einsum("kji,kj->i", turns, force - bias)
    return ForceFit(weight * direction / np.linalg.norm(direction), bias, np.zeros((0, 6)))


def moment_matrix(weight_in_sensor_n: np.ndarray) -> np.ndarray:
    """Matrix (3 n, 6) of m = -[F]x r + b_m for weights (n, 3) in {F} ((A.9d), with forces in place of moments)."""
    x, y, z = weight_in_sensor_n.T
    zero = np.zeros_like(x)
    cross = np.stack((zero, z, -y, -z, zero, x, y, -x, zero), axis=1).reshape(-1, 3, 3)
    return np.concatenate((cross, np.broadcast_to(np.eye(3), cross.shape)), axis=2).reshape(-1, 6)


def fit_moments(weight_in_sensor_n: ArrayLike, moment_in_sensor_nmm: ArrayLike) -> MomentFit:
    """Centre of mass and moment bias from moments (n, 3) [N mm] under the weights (n, 3) [N] in {F} (05 section 1).

    The weights are those of a force fit, not the readings.

    Raises:
        CalibrationError: as :func:`fit_forces`, or weights that are all zero.
    """
    weight, moment = _pair(weight_in_sensor_n, moment_in_sensor_nmm, POSES_MIN)
    scale = float(np.linalg.norm(weight, axis=1).max())
    if scale == 0.0:
        raise CalibrationError("nothing weighs on the sensor, so there is no centre of mass", value=0.0)
    solution, free = _minimum_norm(moment_matrix(weight / scale), moment.ravel())
    return MomentFit(solution[:3] / scale, solution[3:], free)


def _minimum_norm(matrix: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares solution (6,) of minimum norm, and the directions (k, 6) the matrix does not see."""
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    seen = s > IDENTIFIABLE * s[0]
    return vt[seen].T @ ((u.T @ readings)[seen] / s[seen]), vt[~seen]


def _checked(turns: ArrayLike, readings: ArrayLike, least: int) -> tuple[np.ndarray, np.ndarray]:
    turns = np.asarray(turns, dtype=float)
    if turns.ndim != 3 or turns.shape[1:] != (3, 3):
        raise CalibrationError("turns must be rotation matrices", value=turns.shape, bound="(n, 3, 3)")
    if not np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-6):
        raise CalibrationError("turns must be rotation matrices", remedy="one of them is not orthonormal")
    _, readings = _pair(turns[:, 0], readings, least)
    return turns, readings


def _pair(first: ArrayLike, second: ArrayLike, least: int) -> tuple[np.ndarray, np.ndarray]:
    """Two arrays (n, 3) of finite numbers, n >= least."""
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3:
        raise CalibrationError("readings do not belong together", value=f"{a.shape} and {b.shape}", bound="(n, 3) both")
    if len(a) < least:
        raise CalibrationError("too few poses", value=len(a), bound=f"at least {least}", remedy="measure more of them")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise CalibrationError("readings must be finite numbers", remedy="leave the incomplete poses out")
    return a, b
