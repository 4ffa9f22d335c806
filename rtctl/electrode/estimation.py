"""Shape of an array nobody has calibrated, from one measured point (spec 02 section 4; (II.15)-(II.19)).

A stylet cannot be put back into an array that goes into a patient, so such an array has no calibration of its own. What
there is, is a point the array goes through with its stylet in, and the matrices of arrays of its kind.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from hal.errors import RtctlError
from rtctl.electrode.array_shape import LENGTH_MM, ORDER

NODES = 37
"""Along the array, where its shape is compared with the mean of its kind."""
STARTS = 5
"""Of the search, over the place of the point along the array."""
MISS_MM = 1e-6
MOST_RAD = 0.5
"""Largest rms difference to the mean of its kind; an array bent more with its stylet in is of another kind, or broken."""
QUADRATURE = np.polynomial.legendre.leggauss(24)
_POWERS = np.arange(ORDER)
_SCALE = LENGTH_MM**_POWERS


class EstimationError(RtctlError):
    """No array of this kind goes through the point."""


@dataclass(frozen=True)
class Estimate:
    """What came out.

    modal_matrix: A_est (4, 4), (II.19).
    place_mm: L~, arc length at which the array goes through the point.
    cost_rad2: sum of squared differences to the mean shape over the 37 nodes, (II.18).
    """

    modal_matrix: np.ndarray
    place_mm: float
    cost_rad2: float

    @property
    def rms_rad(self) -> float:
        """Root mean square difference to the mean shape with the stylet in."""
        return math.sqrt(self.cost_rad2 / NODES)


def estimate(point_mm: Sequence[float] | np.ndarray, known: Sequence[np.ndarray]) -> Estimate:
    """The likely matrix of an array that goes through a point with its stylet in.

    Its first column is the one nearest to the mean of its kind, in bending angles, that puts the array through the
    point (II.18); the others, how it curls, are the mean (II.19).

    Args:
        point_mm: p_m (2,) in the array's frame {E}.
        known: modal matrices (4, 4) of calibrated arrays of its kind.

    Raises:
        EstimationError: no known array, a point that is no number or out of reach, or one that only an array unlike the
            known ones would go through.
    """
    if not len(known):
        raise EstimationError("there is no calibrated array to start from", value=0, bound="at least 1")
    mean = np.mean([np.asarray(matrix, dtype=float) for matrix in known], axis=0)
    point = np.asarray(point_mm, dtype=float)
    if mean.shape != (ORDER, ORDER) or not np.isfinite(mean).all():
        raise EstimationError("a modal matrix is not usable", value=mean.shape, bound="4 x 4 finite numbers")
    if point.shape != (2,) or not np.isfinite(point).all():
        raise EstimationError("the measured point must be two finite numbers", value=point.tolist())
    distance = float(np.linalg.norm(point))
    if not 0.0 < distance <= LENGTH_MM:
        raise EstimationError(
            "the array does not reach the measured point",
            value=round(distance, 4),
            bound=f"above 0, at most {LENGTH_MM:g} mm from the grip",
            remedy="give the point in the array's frame: origin at the grip, x along the array there",
        )
    best, cost = _search(point, mean[:, 0])
    found = Estimate(np.column_stack((best[:ORDER] / _SCALE, mean[:, 1:])), float(best[ORDER]) * LENGTH_MM, cost)
    if found.rms_rad > MOST_RAD:
        raise EstimationError(
            "only an array unlike the known ones goes through the measured point",
            value=round(found.rms_rad, 4),
            bound=f"at most {MOST_RAD:g} rad rms from their mean shape",
            remedy="measure the point again, in the array's frame, with the stylet fully in",
        )
    return found


def _search(point: np.ndarray, mean: np.ndarray) -> tuple[np.ndarray, float]:
    """Minimum (5,) of (II.18), and its cost: coefficients of the powers of s / L, and L~ / L; the best of several starts."""
    scaled = mean * _SCALE
    basis = np.vander(np.linspace(0.0, 1.0, NODES), ORDER, increasing=True)

    def cost(x: np.ndarray) -> float:
        difference = basis @ (x[:ORDER] - scaled)
        return float(difference @ difference)

    def gradient(x: np.ndarray) -> np.ndarray:
        return np.append(2.0 * basis.T @ (basis @ (x[:ORDER] - scaled)), 0.0)

    def miss(x: np.ndarray) -> np.ndarray:
        return _end(x)[0] - point / LENGTH_MM

    nearest = float(np.linalg.norm(point)) / LENGTH_MM  # no array is shorter than the way to the point
    best, least = None, math.inf
    for place in np.linspace(nearest, 1.0, STARTS):
        x = minimize(
            cost,
            np.append(scaled, place),
            method="SLSQP",
            jac=gradient,
            bounds=Bounds([-math.inf] * ORDER + [0.0], [math.inf] * ORDER + [1.0]),
            constraints=NonlinearConstraint(miss, 0.0, 0.0, jac=lambda x: _end(x)[1]),
            options={"maxiter": 300, "ftol": 1e-13},
        ).x
        if LENGTH_MM * float(np.abs(miss(x)).max()) <= MISS_MM and cost(x) < least:
            best, least = x, cost(x)
    if best is None:
        raise EstimationError("no array was found that goes through the measured point", value=point.tolist())
    return best, least


def _end(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """p_e(L~, 0) / L, and its derivatives (2, 5) by the coefficients and by L~ / L."""
    nodes, weights = QUADRATURE
    s, w = x[ORDER] * (nodes + 1) / 2, x[ORDER] * weights / 2
    powers = np.vander(s, ORDER, increasing=True)
    angle = powers @ x[:ORDER]
    cosine, sine = np.cos(angle), np.sin(angle)
    last = float(x[ORDER] ** _POWERS @ x[:ORDER])
    place = np.array([w @ cosine, w @ sine])
    slopes = np.array([[*(-(w * sine) @ powers), math.cos(last)], [*((w * cosine) @ powers), math.sin(last)]])
    return place, slopes
