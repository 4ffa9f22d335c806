"""The cochlea template: lateral and modiolar wall, insertion point, and the path the tip should follow.

Cohen's spiral (spec 02 section 1; dissertation (II.1)). Everything is planar in the cochlea frame {C}: origin in the
centre of the spiral, x axis through theta = 10.3 deg, theta counter-clockwise. Template angles are in
degrees, lengths in mm.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

SPIRAL_A_MM, SPIRAL_B_PER_DEG, SPIRAL_D, SPIRAL_ORIGIN_DEG = 3.84, 0.001317, 0.12869, 5.0
KINK_DEG = 100.0
"""The logarithmic basal part meets the exponential turns here, continuous in position only."""
SPIRAL_C_MM = (
    SPIRAL_A_MM * math.exp(-SPIRAL_B_PER_DEG * KINK_DEG) / (1 - SPIRAL_D * math.log(KINK_DEG - SPIRAL_ORIGIN_DEG))
)

FIRST_DEG, LAST_DEG = 10.3, 910.0
COCHLEOSTOMY_DEG = 23.0
PATH_END_DEG = 720.0
"""Beyond it the wall of this template collapses to a radius no array can follow."""

SCALA_DEG = np.array([0, 10.3, 90, 180, 270, 360, 450, 585, 675, 1000.0])
SCALA_WIDTH_MM = np.array([1.66, 1.66, 1.60, 1.41, 1.31, 1.21, 1.20, 1.30, 1.29, 1.0])
SCALA_HEIGHT_MM = np.array([1.25, 1.25, 1.22, 1.03, 0.96, 0.82, 0.87, 0.78, 0.65, 0.65])


def width_mm(theta_deg: ArrayLike) -> np.ndarray:
    """Width of the scala tympani in the plane, linear between the measured angles."""
    return np.interp(np.asarray(theta_deg, dtype=float), SCALA_DEG, SCALA_WIDTH_MM)


def height_mm(theta_deg: ArrayLike) -> np.ndarray:
    """Height of the scala tympani across the plane, linear between the measured angles."""
    return np.interp(np.asarray(theta_deg, dtype=float), SCALA_DEG, SCALA_HEIGHT_MM)


def lateral_wall(theta_deg: ArrayLike, basal: ArrayLike | None = None) -> np.ndarray:
    """Points (..., 2) of the lateral wall in {C} [mm], (II.1).

    `basal` chooses the branch per angle; by default the basal one below 100 deg. Both branches agree there.
    """
    radius, _, radial, _ = _spiral(theta_deg, basal)
    return radius[..., None] * radial


def modiolar_wall(theta_deg: ArrayLike, basal: ArrayLike | None = None) -> np.ndarray:
    """Points (..., 2) of the modiolar wall in {C} [mm]: the lateral wall moved inwards by the width, along its normal.

    `basal` as in :func:`lateral_wall`; the two branches end 0.17 mm apart at 100 deg, where the tangent jumps.
    """
    return lateral_wall(theta_deg, basal) + width_mm(theta_deg)[..., None] * inward_normal(theta_deg, basal)


def inward_normal(theta_deg: ArrayLike, basal: ArrayLike | None = None) -> np.ndarray:
    """Unit normals (..., 2) of the lateral wall in {C}, left of the direction of growing theta."""
    radius, slope, radial, around = _spiral(theta_deg, basal)
    tangent = slope[..., None] * radial + radius[..., None] * around
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    return np.stack((-tangent[..., 1], tangent[..., 0]), axis=-1)


def wall_angles(step_deg: float, last_deg: float = LAST_DEG) -> tuple[np.ndarray, np.ndarray]:
    """Angles (n,) [deg] of a polyline from 10.3 deg on, and whether each belongs to the basal branch.

    The kink appears twice, once for either branch, so that a polyline keeps both one-sided wall points.
    """
    angles = FIRST_DEG + step_deg * np.arange(np.floor((last_deg - FIRST_DEG) / step_deg + 1e-9) + 1)
    if angles[-1] < last_deg - 1e-9:
        angles = np.append(angles, last_deg)
    before, after = angles[angles < KINK_DEG], angles[angles > KINK_DEG]
    basal = np.arange(len(before) + len(after) + 2) <= len(before)
    return np.concatenate((before, (KINK_DEG, KINK_DEG), after)), basal


def modiolar_polyline(step_deg: float, last_deg: float = LAST_DEG) -> np.ndarray:
    """Vertices (n, 2) of the modiolar wall in {C} [mm]; a chord joins the gap at the kink."""
    return modiolar_wall(*wall_angles(step_deg, last_deg))


def lateral_polyline(step_deg: float, last_deg: float = LAST_DEG) -> np.ndarray:
    """Vertices (n, 2) of the lateral wall in {C} [mm]."""
    return lateral_wall(*wall_angles(step_deg, last_deg))


def arc_length_mm(polyline: np.ndarray) -> np.ndarray:
    """Distance (n,) along the vertices (n, 2) of a polyline, zero at the first."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(polyline, axis=0), axis=1)))


def insertion_point() -> np.ndarray:
    """Centre p_c (2,) of the cochleostomy in {C} [mm]: the middle of the scala at 23 deg."""
    return (lateral_wall(COCHLEOSTOMY_DEG) + modiolar_wall(COCHLEOSTOMY_DEG)) / 2


@dataclass(frozen=True)
class InsertionPath:
    """Where the tip should be at a depth: straight from p_c until it touches the modiolar wall, then along that wall.

    vertices: polyline (n, 2) in {C} [mm], the first is p_c, the second the point of tangency.
    length_mm: distance (n,) from p_c along it.
    tangency_deg: template angle of the point of tangency.
    """

    vertices: np.ndarray
    length_mm: np.ndarray
    tangency_deg: float

    @property
    def direction_rad(self) -> float:
        """Bearing of the straight part in {C}, the direction of insertion."""
        x, y = self.vertices[1] - self.vertices[0]
        return float(np.arctan2(y, x))

    def points(self, depth_mm: ArrayLike) -> np.ndarray:
        """Points (..., 2) in {C} [mm] at the given distances along the path, held at its ends."""
        depth = np.asarray(depth_mm, dtype=float)
        return np.stack([np.interp(depth, self.length_mm, column) for column in self.vertices.T], axis=-1)


def insertion_path(step_deg: float = 0.25, last_deg: float = PATH_END_DEG) -> InsertionPath:
    """The insertion path over a wall of `step_deg`; the vertex of smallest bearing from p_c is the tangency."""
    angles, basal = wall_angles(step_deg, last_deg)
    wall, start = modiolar_wall(angles, basal), insertion_point()
    bearing = np.arctan2(wall[:, 1] - start[1], wall[:, 0] - start[0])
    # only what the straight line meets first: further on the spiral turns behind the point of tangency
    ahead = np.where((angles > COCHLEOSTOMY_DEG) & (angles < KINK_DEG), np.mod(bearing, 2 * np.pi), np.inf)
    touch = int(np.argmin(ahead))
    vertices = np.vstack((start, wall[touch:]))
    return InsertionPath(vertices, arc_length_mm(vertices), float(angles[touch]))


def _spiral(theta_deg: ArrayLike, basal: ArrayLike | None) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Radius [mm], its slope [mm/rad], and the radial and circumferential unit vectors (..., 2)."""
    theta = np.asarray(theta_deg, dtype=float)
    basal = theta < KINK_DEG if basal is None else np.asarray(basal)
    from_origin = np.where(basal, theta - SPIRAL_ORIGIN_DEG, 1.0)
    turn = SPIRAL_A_MM * np.exp(-SPIRAL_B_PER_DEG * theta)
    radius = np.where(basal, SPIRAL_C_MM * (1 - SPIRAL_D * np.log(from_origin)), turn)
    slope_per_deg = np.where(basal, -SPIRAL_C_MM * SPIRAL_D / from_origin, -SPIRAL_B_PER_DEG * turn)
    angle = np.radians(theta - FIRST_DEG)
    radial = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    around = np.stack((-radial[..., 1], radial[..., 0]), axis=-1)
    return radius, np.degrees(slope_per_deg), radial, around
