"""Planar wire-driven 3RPR (dissertation, chapter III; 01 section 1).

Three legs: an arm of length a_i turns about the base joint b_i by psi_i, and a piston extends by q_i at the fixed
interior angle alpha_i to the arm, up to the platform joint e_i. A motor turns a screw of lead eta_i that pulls
the wire of the piston; the wire runs over a pulley of radius r_i at the base joint, so that the turning of the leg
moves the piston too (III.4). Pose: gripper tip and platform angle in {B}, (x mm, y mm, phi rad).

In the kernels u_i = q_i - r_i (psi_i - psi_i,home) is the wire that the motor pays out, u_i = eta_i theta_i.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hal.kernel import kernel
from hal.options import option, read
from rtctl.robots import interface
from rtctl.robots.interface import OUTSIDE_BOX, REACHABLE, SINGULAR, STROKE_LIMIT
from rtctl.robots.robot import Robot, RobotError, check_home, ordered

PRINTED_HOME = (149.167323, -9.859070, math.radians(-2.5749905))
"""Home of the default geometry (01 section 1.2), where the search for home starts."""
RESERVED_MM = 20.0
"""Part of a leg that the piston's bearing needs (Table III.2)."""
NEWTON_STEP = 1e-11
NEWTON_LIMIT = 12
STROKE_TOLERANCE_MM = 1e-6
"""Home is at the end stop, and q = 0 only up to rounding."""


@dataclass(frozen=True)
class Planar3rprOptions:
    """Geometry and limits; one entry a leg. The legs 1 and 3 cross: their order matters (01 section 1.2)."""

    a_mm: tuple[float, ...] = option((63.2, 63.2, 64.0), shape=(3,), low=1, high=500, unit="mm", doc="arm lengths")
    alpha_rad: tuple[float, ...] = option(
        (math.pi, math.pi, math.pi), shape=(3,), low=0.1, high=6.2, unit="rad", doc="interior angles of arm and piston"
    )
    eta_mm_per_rad: tuple[float, ...] = option(
        (0.097, 0.097, 0.097), shape=(3,), low=0.001, high=10, unit="mm/rad", doc="screw leads"
    )
    pulley_radius_mm: tuple[float, ...] = option(
        (2.0, 2.0, 2.0), shape=(3,), low=0, high=50, unit="mm", doc="radii of the wire pulleys at the base joints"
    )
    base_mm: tuple[tuple[float, ...], ...] = option(
        ((0.0, 8.0), (0.0, -8.0), (0.0, 0.0)), shape=(3, 2), low=-1000, high=1000, unit="mm", doc="base joints in {B}"
    )
    platform_mm: tuple[tuple[float, ...], ...] = option(
        ((-88.0, -2.0), (-88.0, -21.0), (-88.0, 21.0)),
        shape=(3, 2),
        low=-1000,
        high=1000,
        unit="mm",
        doc="platform joints in the platform frame, origin at the gripper tip",
    )
    stroke_min_mm: tuple[float, ...] = option(
        (0.0, 0.0, 0.0), shape=(3,), low=-10, high=0, unit="mm", doc="smallest strokes; home is at stroke 0"
    )
    stroke_max_mm: tuple[float, ...] | None = option(
        None, shape=(3,), low=0.1, high=500, unit="mm", doc="largest strokes; a_mm - 20 when absent"
    )
    box_low_mm_rad: tuple[float, ...] = option(
        (148.5, -11.0, -0.32), shape=(3,), low=-1000, high=1000, unit="mm, mm, rad", doc="smallest x, y, phi allowed"
    )
    box_high_mm_rad: tuple[float, ...] = option(
        (176.0, 8.0, 0.32), shape=(3,), low=-1000, high=1000, unit="mm, mm, rad", doc="largest x, y, phi allowed"
    )
    determinant_min_mm: float = option(
        1.0, low=0.01, high=100, unit="mm", doc="smallest |det J_u| allowed; it is 0 at a singularity"
    )


PLANAR_3RPR = np.dtype(
    [
        ("a_mm", "f8", (3,)),
        ("alpha_cos", "f8", (3,)),
        ("alpha_sin", "f8", (3,)),
        ("eta_mm_per_rad", "f8", (3,)),
        ("pulley_radius_mm", "f8", (3,)),
        ("base_mm", "f8", (3, 2)),
        ("platform_mm", "f8", (3, 2)),
        ("joint_low", "f8", (3,)),
        ("joint_high", "f8", (3,)),
        ("box_low", "f8", (3,)),
        ("box_high", "f8", (3,)),
        ("determinant_min_mm", "f8"),
        ("home_side", "f8"),  # sign of det J_u at home
        ("home_pose", "f8", (3,)),
        ("home_arm", "f8", (3, 2)),  # unit vectors (cos psi, sin psi) of the arms at home
    ],
    align=True,
)


def load(table: Mapping[str, Any]) -> Robot:
    """The robot with the options in `table`; OptionError and RobotError as `record`."""
    data = record(read(Planar3rprOptions, table, "robot.geometry"))
    return _robot(data)


def record(options: Planar3rprOptions) -> np.ndarray:
    """Geometry, home and limits as `PLANAR_3RPR`, shape (1,).

    Raises:
        OptionError: a lower limit that is not below its upper limit.
        RobotError: no assembly with retracted pistons near the printed home, or one outside the limits.
    """
    data = geometry(options)
    _find_home(data)
    check_home(_robot(data))
    return data


def geometry(options: Planar3rprOptions) -> np.ndarray:
    """Like `record`, but without a home: arms at home are said to point along x. OptionError as `record`."""
    o, data = options, np.zeros(1, PLANAR_3RPR)
    stroke_max = o.stroke_max_mm or tuple(a - RESERVED_MM for a in o.a_mm)
    ordered("stroke_min_mm", o.stroke_min_mm, "stroke_max_mm", stroke_max)
    ordered("box_low_mm_rad", o.box_low_mm_rad, "box_high_mm_rad", o.box_high_mm_rad)
    for name in ("a_mm", "eta_mm_per_rad", "pulley_radius_mm", "base_mm", "platform_mm", "determinant_min_mm"):
        data[name] = getattr(o, name)
    data["alpha_cos"], data["alpha_sin"] = np.cos(o.alpha_rad), np.sin(o.alpha_rad)
    data["joint_low"], data["joint_high"] = o.stroke_min_mm, stroke_max
    data["box_low"], data["box_high"] = o.box_low_mm_rad, o.box_high_mm_rad
    data["home_arm"][:, :, 0] = 1.0
    return data


def _find_home(data: np.ndarray) -> None:
    """Without pulleys the motor angles are the strokes, so home is the forward kinematics of zero."""
    uncoupled = data.copy()
    uncoupled["pulley_radius_mm"] = 0.0
    home = np.array(PRINTED_HOME)
    if _solve_home(uncoupled, home) < 0:
        raise RobotError(
            "the legs cannot be assembled with all pistons retracted near the printed home",
            value=[round(v, 4) for v in PRINTED_HOME],
            remedy="check a_mm, alpha_rad, base_mm and platform_mm in robot.geometry, and the order of the legs",
        )
    data["home_pose"] = home
    turn = np.empty(3)
    _solve_arms(data, home, turn)
    data["home_arm"][0, :, 0], data["home_arm"][0, :, 1] = np.cos(turn), np.sin(turn)
    data["home_side"] = np.sign(_determinant(data, home))


def _robot(data: np.ndarray) -> Robot:
    return Robot(
        kind="planar_3rpr",
        pose_names=("x_mm", "y_mm", "phi_rad"),
        joint_names=("q1_mm", "q2_mm", "q3_mm"),
        joint_units=("mm",) * 3,
        record=data,
        translation_mask=(True, True, False),
        length_dofs=2,
        singular_error=partial(_singular_error, data),
    )


def _singular_error(data: np.ndarray, pose: np.ndarray) -> RobotError:
    side = "-" if data["home_side"][0] < 0 else ""
    return RobotError(
        f"the pose {pose.round(6).tolist()} is at or beyond a singularity: det J_u [mm] is too near to zero",
        value=float(_determinant(data, pose)),
        bound=f"{side}{data['determinant_min_mm'][0]:g} mm or farther from zero",
        remedy="choose a pose with a smaller |phi_rad|, or lower robot.geometry.determinant_min_mm",
    )


@kernel
def _solve_home(data, pose):
    return forward(data[0], np.zeros(3), pose)


@kernel
def _solve_arms(data, pose, turn):
    strokes_and_turns(data[0], pose, np.empty(3), turn)


@kernel
def _determinant(data, pose):
    return wire_jacobian(data[0], pose, np.empty((3, 3)))


@kernel
def _leg(robot, i, x, y, c, s):
    """Leg i at the pose (x, y, phi), c = cos phi, s = sin phi: q_i, psi_i - psi_i,home, and row i of J_u.

    (III.1), (III.2), (III.3) corrected, (III.14) corrected. Two short cuts: d^T s = q - a cos alpha, and
    (z x d)^T s = -a sin alpha by the law of sines, so that the row needs no angle. The turn is the angle between two
    vectors, which keeps the cut of atan2 opposite to home.
    """
    a, cosine, sine = robot.a_mm[i], robot.alpha_cos[i], robot.alpha_sin[i]
    r = robot.pulley_radius_mm[i]
    ex = c * robot.platform_mm[i, 0] - s * robot.platform_mm[i, 1]
    ey = s * robot.platform_mm[i, 0] + c * robot.platform_mm[i, 1]
    dx, dy = x + ex - robot.base_mm[i, 0], y + ey - robot.base_mm[i, 1]
    dd = dx * dx + dy * dy
    ds = math.sqrt(dd - a * a * sine * sine)
    q = a * cosine + ds

    along, across = a - q * cosine, q * sine
    arm_x, arm_y = dx * along - dy * across, dy * along + dx * across
    home_x, home_y = robot.home_arm[i, 0], robot.home_arm[i, 1]
    turn = math.atan2(arm_y * home_x - arm_x * home_y, arm_x * home_x + arm_y * home_y)

    pull = (1.0 - r * a * sine / dd) / ds
    wind = r / dd
    return (
        q,
        turn,
        pull * dx + wind * dy,
        pull * dy - wind * dx,
        pull * (ex * dy - ey * dx) - wind * (dx * ex + dy * ey),
    )


@interface.implement(interface.inverse, PLANAR_3RPR)
@kernel
def inverse(robot, pose, joint, motor):
    """(III.2)-(III.4): strokes [mm] and motor angles [rad], with the coupling by the pulleys."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    assembled = True
    for i in range(3):
        q, turn, _, _, _ = _leg(robot, i, pose[0], pose[1], c, s)
        angle = (q - robot.pulley_radius_mm[i] * turn) / robot.eta_mm_per_rad[i]
        joint[i], motor[i] = q, angle
        assembled = assembled and math.isfinite(angle)
    if not assembled:
        for i in range(3):
            joint[i] = motor[i] = math.nan
    return assembled


@interface.implement(interface.forward, PLANAR_3RPR)
@kernel
def forward(robot, motor, pose):
    """Newton on the motor angles with J_theta; both sides are multiplied by eta, which changes no step."""
    x, y, phi = pose[0], pose[1], pose[2]
    u1 = motor[0] * robot.eta_mm_per_rad[0]
    u2 = motor[1] * robot.eta_mm_per_rad[1]
    u3 = motor[2] * robot.eta_mm_per_rad[2]
    for step in range(1, NEWTON_LIMIT + 1):
        c, s = math.cos(phi), math.sin(phi)
        q1, turn1, a1, b1, c1 = _leg(robot, 0, x, y, c, s)
        q2, turn2, a2, b2, c2 = _leg(robot, 1, x, y, c, s)
        q3, turn3, a3, b3, c3 = _leg(robot, 2, x, y, c, s)
        v1 = u1 - q1 + robot.pulley_radius_mm[0] * turn1
        v2 = u2 - q2 + robot.pulley_radius_mm[1] * turn2
        v3 = u3 - q3 + robot.pulley_radius_mm[2] * turn3
        # Cramer's rule on rows (a, b, c), right side v
        m1, m2, m3 = b2 * c3 - b3 * c2, b3 * c1 - b1 * c3, b1 * c2 - b2 * c1
        inverted = 1.0 / (a1 * m1 + a2 * m2 + a3 * m3)
        change_x = inverted * (v1 * m1 + v2 * m2 + v3 * m3)
        change_y = inverted * (v1 * (c2 * a3 - c3 * a2) + v2 * (c3 * a1 - c1 * a3) + v3 * (c1 * a2 - c2 * a1))
        change_phi = inverted * (v1 * (a2 * b3 - a3 * b2) + v2 * (a3 * b1 - a1 * b3) + v3 * (a1 * b2 - a2 * b1))
        x, y, phi = x + change_x, y + change_y, phi + change_phi
        largest = max(abs(change_x), abs(change_y), abs(change_phi))
        if not math.isfinite(x + y + phi):
            return -1
        if largest < NEWTON_STEP:
            pose[0], pose[1], pose[2] = x, y, phi
            return step
    return -1


@kernel
def wire_jacobian(robot, pose, matrix):
    """J_u = J_q - R J_psi into `matrix` (3, 3) [1, 1, mm/rad]; returns its determinant [mm]."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(3):
        _, _, matrix[i, 0], matrix[i, 1], matrix[i, 2] = _leg(robot, i, pose[0], pose[1], c, s)
    return (
        matrix[0, 0] * (matrix[1, 1] * matrix[2, 2] - matrix[2, 1] * matrix[1, 2])
        + matrix[1, 0] * (matrix[2, 1] * matrix[0, 2] - matrix[0, 1] * matrix[2, 2])
        + matrix[2, 0] * (matrix[0, 1] * matrix[1, 2] - matrix[1, 1] * matrix[0, 2])
    )


@kernel
def strokes_and_turns(robot, pose, stroke, turn):
    """q (3,) [mm] and psi - psi_home (3,) [rad] of the legs, for whoever needs both (calibration, 05 section 4)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(3):
        stroke[i], turn[i], _, _, _ = _leg(robot, i, pose[0], pose[1], c, s)


@interface.implement(interface.jacobian, PLANAR_3RPR)
@kernel
def jacobian(robot, pose, matrix):
    """J_theta = G J_u (3, 3) [rad/mm, rad/mm, rad/rad]."""
    wire_jacobian(robot, pose, matrix)
    for i in range(3):
        for k in range(3):
            matrix[i, k] /= robot.eta_mm_per_rad[i]


@interface.implement(interface.rotation, PLANAR_3RPR)
@kernel
def rotation(_robot, pose, matrix):
    """R_z(phi): the array is inserted along the platform's x axis."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = c, -s, 0.0
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = s, c, 0.0
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 0.0, 0.0, 1.0


@interface.implement(interface.translate, PLANAR_3RPR)
@kernel
def translate(_robot, pose, offset_in_base):
    """x and y; the robot cannot leave its plane."""
    pose[0] += offset_in_base[0]
    pose[1] += offset_in_base[1]


@interface.implement(interface.reach, PLANAR_3RPR)
@kernel
def reach(robot, pose):
    """Box, strokes, then det J_u, which must have the sign it has at home: beyond a singularity is another assembly."""
    for k in range(3):
        if not robot.box_low[k] <= pose[k] <= robot.box_high[k]:
            return OUTSIDE_BOX
    c, s = math.cos(pose[2]), math.sin(pose[2])
    q1, _, a1, b1, c1 = _leg(robot, 0, pose[0], pose[1], c, s)
    q2, _, a2, b2, c2 = _leg(robot, 1, pose[0], pose[1], c, s)
    q3, _, a3, b3, c3 = _leg(robot, 2, pose[0], pose[1], c, s)
    if not (_within(robot, 0, q1) and _within(robot, 1, q2) and _within(robot, 2, q3)):
        return STROKE_LIMIT
    determinant = a1 * (b2 * c3 - b3 * c2) + a2 * (b3 * c1 - b1 * c3) + a3 * (b1 * c2 - b2 * c1)
    if not determinant * robot.home_side >= robot.determinant_min_mm:
        return SINGULAR
    return REACHABLE


@kernel
def _within(robot, i, q):
    return robot.joint_low[i] - STROKE_TOLERANCE_MM <= q <= robot.joint_high[i] + STROKE_TOLERANCE_MM
