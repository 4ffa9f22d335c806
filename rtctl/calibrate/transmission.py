"""Screw lead, pulley radius and backlash of the wire drives from tracked poses (05 section 4; (III.61)).

For every leg theta = q / eta - (r / eta) psi - chi_m over strokes q, turns psi of the leg from home, and motor angles
theta; m is 1 where the piston was extending when it came to rest, 0 where it was retracting. Both directions share one
plane, each has its own offset.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hal.kernel import kernel
from rtctl.calibrate.errors import CalibrationError
from rtctl.robots import Robot
from rtctl.robots.planar_3rpr import strokes_and_turns

ROWS_MIN = 8
ROWS_PER_DIRECTION_MIN = 3
IDENTIFIABLE = 1e-6
UNKNOWNS = 4
ROUNDING_RAD = 1e-9
RESIDUAL_BOUND_RAD = 0.6
"""Of every leg, rms: what the dissertation's planes left (D III.8)."""


@dataclass(frozen=True)
class LegFit:
    """One wire drive; standard deviations in the same order as the values.

    chi_rad: offsets (2,) of the planes, retracting and extending, as (III.61) has them: subtracted.
    """

    eta_mm_per_rad: float
    pulley_radius_mm: float
    chi_rad: tuple[float, float]
    residual_rad: float
    eta_sd_mm_per_rad: float
    pulley_radius_sd_mm: float
    backlash_sd_rad: float

    @property
    def backlash_rad(self) -> float:
        """How much more the motor has turned at the same stroke when extending: chi_0 - chi_1.

        (III.61) subtracts chi, so a piston that lags its motor has chi_1 < chi_0; this is `control.backlash_rad`.
        """
        return self.chi_rad[0] - self.chi_rad[1]

    @property
    def home_stroke_mm(self) -> float:
        """Stroke of the piston where the motor angle is zero, having come there retracting: what homing leaves."""
        return self.eta_mm_per_rad * self.chi_rad[0]


def require(legs: list[LegFit], bound_rad: float = RESIDUAL_BOUND_RAD) -> None:
    """Raise CalibrationError for a leg with too large a residual, or one whose motor lags its piston."""
    for i, leg in enumerate(legs, 1):
        if not leg.residual_rad <= bound_rad:
            raise CalibrationError(f"leg {i} does not fit a plane for each direction", value=f"{leg.residual_rad:.2f} rad rms", bound=f"{bound_rad:g} rad", remedy="see that every pose was approached by more than the backlash, and that the tracker saw all of them; or allow it with --bound")  # fmt: skip
        if leg.backlash_rad < -3.0 * leg.backlash_sd_rad - ROUNDING_RAD:
            raise CalibrationError(f"the motor of leg {i} seems to lag its piston", value=f"{leg.backlash_rad:.2f} rad", bound="a backlash of 0 or more", remedy="see that `extending` is 1 where the leg came to rest extending, and not the other way round")  # fmt: skip


def fit_legs(robot: Robot, pose: ArrayLike, motor_rad: ArrayLike, extending: ArrayLike) -> list[LegFit]:
    """Every leg of the planar robot, from poses (n, 3) in {B}, motor angles (n, 3) from home and directions (n, 3).

    Raises:
        CalibrationError: numbers that are not finite, poses the robot cannot have, too few poses in one direction, or poses
            that do not determine the plane.
    """
    if robot.kind != "planar_3rpr":
        raise CalibrationError("only wire drives of the planar robot can be calibrated", value=robot.kind)
    pose, motor = (np.asarray(v, dtype=float) for v in (pose, motor_rad))
    side = np.asarray(extending)
    if pose.ndim != 2 or pose.shape[1] != robot.dof or motor.shape != pose.shape or side.shape != pose.shape:
        raise CalibrationError("poses, angles and directions do not belong together", value=f"{pose.shape}, {motor.shape}, {side.shape}")  # fmt: skip
    stroke, turn = np.empty_like(pose), np.empty_like(pose)
    for k in range(len(pose)):
        _strokes_and_turns(robot.record, pose[k], stroke[k], turn[k])
    return [fit_leg(stroke[:, i], turn[:, i], motor[:, i], side[:, i], f"leg {i + 1}") for i in range(robot.dof)]


def fit_leg(
    stroke_mm: ArrayLike, turn_rad: ArrayLike, motor_rad: ArrayLike, extending: ArrayLike, name: str = "the leg"
) -> LegFit:
    """One leg from strokes, turns, motor angles and directions (n,) by least squares in the motor angle.

    Orthogonal regression would mix units: radians of the motor in hundreds, millimetres, tenths of a radian.

    Raises:
        CalibrationError: as :func:`fit_legs`.
    """
    q, psi, theta = (np.asarray(v, dtype=float) for v in (stroke_mm, turn_rad, motor_rad))
    side = np.asarray(extending) != 0
    if not all(np.isfinite(v).all() for v in (q, psi, theta)):
        raise CalibrationError(f"{name} has poses it cannot reach, or numbers that are not finite", remedy="see that poses are in {B}, in mm and rad")  # fmt: skip
    if len(q) < ROWS_MIN:
        raise CalibrationError(f"{name} has too few poses", value=len(q), bound=f"at least {ROWS_MIN}")
    rarer = min(int(side.sum()), int((~side).sum()))
    if rarer < ROWS_PER_DIRECTION_MIN:
        raise CalibrationError(f"{name} came too rarely from one side", value=rarer, bound=f"at least {ROWS_PER_DIRECTION_MIN} poses each", remedy="approach poses extending and retracting")  # fmt: skip
    matrix = np.column_stack((q, -psi, -1.0 * ~side, -1.0 * side))
    strength = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0).clip(1e-12), compute_uv=False)
    if not strength[-1] > IDENTIFIABLE:
        raise CalibrationError(f"the poses do not determine the drive of {name}", value=f"{strength[-1]:.1g}", bound=f"a smallest singular value above {IDENTIFIABLE:g}", remedy="choose poses that differ in all coordinates")  # fmt: skip
    (a, b, chi_0, chi_1), *_ = np.linalg.lstsq(matrix, theta, rcond=None)
    residual = theta - matrix @ (a, b, chi_0, chi_1)
    variance = residual @ residual / max(len(q) - UNKNOWNS, 1)
    covariance = variance * np.linalg.inv(matrix.T @ matrix)
    toward_r = np.array([-b / a**2, 1 / a])  # dr / d(a, b) of r = b / a
    return LegFit(
        eta_mm_per_rad=float(1 / a),
        pulley_radius_mm=float(b / a),
        chi_rad=(float(chi_0), float(chi_1)),
        residual_rad=float(np.sqrt(np.mean(residual**2))),
        eta_sd_mm_per_rad=float(np.sqrt(covariance[0, 0]) / a**2),
        pulley_radius_sd_mm=float(np.sqrt(toward_r @ covariance[:2, :2] @ toward_r)),
        backlash_sd_rad=float(np.sqrt(covariance[2, 2] + covariance[3, 3] - 2 * covariance[2, 3])),
    )


@kernel
def _strokes_and_turns(robot, pose, stroke, turn):
    strokes_and_turns(robot[0], pose, stroke, turn)
