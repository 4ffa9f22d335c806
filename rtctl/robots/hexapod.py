"""Spatial 6-UPS insertion platform (01 section 2): six legs of variable length between a base and a platform.

A motor turns the screw of its leg. Pose: gripper tip in {B} and Euler angles of the tip frame {T} in {B},
(x, y, z mm, alpha, beta, gamma rad), R = R_z(gamma) R_y(beta) R_x(alpha). The tool axis, along which the array is
inserted, is +z of {T}. The gripper frame of the interface, whose x axis is the insertion axis, is {T} turned by 90 deg
about its y axis and by 180 deg about the tool axis: x_G = z_T, y_G = -y_T, z_G = x_T. The force sensor's frame {F}
(rtctl/wrench.py) is then parallel to {T}.

In the kernels a pose is a position and the nine entries of R, and leg i is B_i + l_i u_i = p + R P_i. A row of the
Jacobian is (u_i, (R P_i) x u_i): leg lengths per velocity of the tip and angular velocity, both in {B}.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hal.errors import OptionError
from hal.kernel import kernel
from hal.options import option, read
from rtctl.robots import interface, twist_algebra
from rtctl.robots.interface import OUTSIDE_BOX, REACHABLE, SINGULAR, STROKE_LIMIT
from rtctl.robots.orientation import (
    euler_of_quaternion,
    matrix_of_euler,
    matrix_of_quaternion,
    per_euler_rates,
    quaternion_of_euler,
    turned,
)
from rtctl.robots.robot import Robot, RobotError, check_home, ordered
from rtctl.robots.twist_algebra import solve_by_blocks

NEWTON_STEP = 1e-8
"""The last step [mm, rad]; what is left is of the order of its square."""
NEWTON_LIMIT = 12
LEG_TOLERANCE_MM = 1e-6
CONDITION_MAX = 1e4
"""Of J at home, columns of length 1."""
STEEPEST_RAD = math.radians(85)
"""Largest |beta| of a box: at 90 deg the Euler angles lose a direction."""


def _ring(radius_mm: float, angles_deg: tuple[float, ...], z_mm: float) -> tuple[tuple[float, ...], ...]:
    angles = np.radians(angles_deg)
    return tuple((radius_mm * float(c), radius_mm * float(s), z_mm) for c, s in zip(np.cos(angles), np.sin(angles), strict=True))  # fmt: skip


@dataclass(frozen=True)
class HexapodOptions:
    """Geometry and limits; one entry a leg, counted counter-clockwise seen from +z of the base."""

    base_mm: tuple[tuple[float, ...], ...] = option(
        _ring(60.0, (15, 105, 135, 225, 255, 345), 0.0),
        shape=(6, 3),
        low=-1000,
        high=1000,
        unit="mm",
        doc="base joints in {B}; by default on radius 60 mm at 15, 105, 135, 225, 255, 345 deg",
    )
    platform_mm: tuple[tuple[float, ...], ...] = option(
        _ring(35.0, (45, 75, 165, 195, 285, 315), -90.0),
        shape=(6, 3),
        low=-1000,
        high=1000,
        unit="mm",
        doc="platform joints in the tip frame, tool axis +z; by default 90 mm behind the tip on radius 35 mm at 45, 75,"
        " 165, 195, 285, 315 deg",
    )
    lead_mm_per_rad: tuple[float, ...] = option(
        (0.097,) * 6, shape=(6,), low=0.001, high=10, unit="mm/rad", doc="screw leads"
    )
    leg_min_mm: tuple[float, ...] = option((90.0,) * 6, shape=(6,), low=1, high=2000, unit="mm", doc="shortest legs")
    leg_max_mm: tuple[float, ...] = option((160.0,) * 6, shape=(6,), low=1, high=2000, unit="mm", doc="longest legs")
    home_mm_rad: tuple[float, ...] = option(
        (0.0, 0.0, 200.0, 0.0, 0.0, 0.0),
        shape=(6,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="pose at which all motor angles are zero",
    )
    box_low_mm_rad: tuple[float, ...] = option(
        (-20.0, -20.0, 185.0, -0.262, -0.262, -0.262),
        shape=(6,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="smallest x, y, z, alpha, beta, gamma allowed",
    )
    box_high_mm_rad: tuple[float, ...] = option(
        (20.0, 20.0, 215.0, 0.262, 0.262, 0.262),
        shape=(6,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="largest x, y, z, alpha, beta, gamma allowed",
    )
    margin_min: float = option(
        0.2, low=1e-3, high=1, doc="smallest det J / det J at home allowed; it is 0 at a singularity, 1 at home"
    )


HEXAPOD = np.dtype(
    [
        ("base_mm", "f8", (6, 3)),
        ("platform_mm", "f8", (6, 3)),
        ("lead_mm_per_rad", "f8", (6,)),
        ("home_leg_mm", "f8", (6,)),
        ("joint_low", "f8", (6,)),
        ("joint_high", "f8", (6,)),
        ("box_low", "f8", (6,)),
        ("box_high", "f8", (6,)),
        ("home_pose", "f8", (6,)),
        ("home_determinant_mm3", "f8"),
        ("margin_min", "f8"),
    ],
    align=True,
)


def load(table: Mapping[str, Any]) -> Robot:
    """The robot with the options in `table`; OptionError and RobotError as `record`."""
    return _robot(record(read(HexapodOptions, table, "robot.geometry")))


def record(options: HexapodOptions) -> np.ndarray:
    """Geometry, home and limits as `HEXAPOD`, shape (1,).

    Raises:
        OptionError: a lower limit that is not below its upper limit, or a box with the gripper on its side.
        RobotError: home is outside the limits or singular.
    """
    o, data = options, np.zeros(1, HEXAPOD)
    ordered("leg_min_mm", o.leg_min_mm, "leg_max_mm", o.leg_max_mm)
    ordered("box_low_mm_rad", o.box_low_mm_rad, "box_high_mm_rad", o.box_high_mm_rad)
    for name, box in (("box_low_mm_rad", o.box_low_mm_rad), ("box_high_mm_rad", o.box_high_mm_rad)):
        if abs(box[4]) > STEEPEST_RAD:
            raise OptionError(
                f"robot.geometry.{name}[4] is too steep: Euler angles lose a direction at beta = +-90 deg",
                value=box[4],
                bound=f"{-STEEPEST_RAD:.4g} .. {STEEPEST_RAD:.4g} rad",
            )
    for name in ("base_mm", "platform_mm", "lead_mm_per_rad", "margin_min"):
        data[name] = getattr(o, name)
    data["joint_low"], data["joint_high"] = o.leg_min_mm, o.leg_max_mm
    data["box_low"], data["box_high"], data["home_pose"] = o.box_low_mm_rad, o.box_high_mm_rad, o.home_mm_rad
    joint = np.empty(6)
    _legs(data, data["home_pose"][0], joint)
    data["home_leg_mm"] = joint
    data["home_determinant_mm3"] = _determinant(data, data["home_pose"][0])
    check_home(_robot(data))
    _check_home_is_regular(data)
    return data


def _check_home_is_regular(data: np.ndarray) -> None:
    """The margin is measured by det J at home, so home itself needs another measure: the condition of J."""
    matrix = _robot(data).jacobian(data["home_pose"][0])
    condition = float(np.linalg.cond(matrix / np.linalg.norm(matrix, axis=0)))
    if not condition < CONDITION_MAX:
        raise RobotError(
            "home is not usable: it is a singularity",
            value=condition,
            bound=f"condition of J below {CONDITION_MAX:g}",
            remedy="check base_mm and platform_mm in robot.geometry, and the order of the legs",
        )


def _robot(data: np.ndarray) -> Robot:
    return Robot(
        kind="hexapod",
        pose_names=("x_mm", "y_mm", "z_mm", "alpha_rad", "beta_rad", "gamma_rad"),
        joint_names=tuple(f"l{i}_mm" for i in range(1, 7)),
        joint_units=("mm",) * 6,
        record=data,
        translation_mask=(True, True, True),
        length_dofs=3,
        singular_error=partial(_singular_error, data),
    )


def _singular_error(data: np.ndarray, pose: np.ndarray) -> RobotError:
    return RobotError(
        f"the pose {pose.round(6).tolist()} is at or beyond a singularity: det J over that at home is too small",
        value=float(_determinant(data, pose) / data["home_determinant_mm3"][0]),
        bound=f"{data['margin_min'][0]:g} or larger",
        remedy="choose a pose with smaller angles, or lower robot.geometry.margin_min",
    )


@kernel
def _legs(data, pose, joint):
    robot = data[0]
    r = matrix_of_euler(pose[3], pose[4], pose[5])
    for i in range(6):
        joint[i] = _leg(robot, i, pose[0], pose[1], pose[2], r)[0]


@kernel
def _determinant(data, pose):
    return determinant(data[0], pose)


@kernel
def _leg(robot, i, x, y, z, r):
    """Leg i at the position (x, y, z) and rotation r: its length [mm] and its row of J, (u, (R P) x u)."""
    px, py, pz = robot.platform_mm[i, 0], robot.platform_mm[i, 1], robot.platform_mm[i, 2]
    ax = r[0] * px + r[1] * py + r[2] * pz
    ay = r[3] * px + r[4] * py + r[5] * pz
    az = r[6] * px + r[7] * py + r[8] * pz
    dx, dy, dz = x + ax - robot.base_mm[i, 0], y + ay - robot.base_mm[i, 1], z + az - robot.base_mm[i, 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    shorten = 1.0 / length
    ux, uy, uz = shorten * dx, shorten * dy, shorten * dz
    return length, ux, uy, uz, ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux


@interface.implement(interface.inverse, HEXAPOD)
@kernel
def inverse(robot, pose, joint, motor):
    """Lengths of the legs [mm] and motor angles [rad]; every finite pose has them."""
    r = matrix_of_euler(pose[3], pose[4], pose[5])
    finite = True
    for i in range(6):
        joint[i] = _leg(robot, i, pose[0], pose[1], pose[2], r)[0]
        motor[i] = (joint[i] - robot.home_leg_mm[i]) / robot.lead_mm_per_rad[i]
        finite = finite and math.isfinite(motor[i])
    if not finite:
        for i in range(6):
            joint[i] = motor[i] = math.nan
    return finite


@interface.implement(interface.forward, HEXAPOD)
@kernel
def forward(robot, motor, pose):
    """Newton on the lengths of the legs; the orientation is a unit quaternion, turned by each step's rotation vector.

    A step s = (translation, rotation vector) solves J^T J s = J^T v, in blocks [A C; C^T D] s = (f, m). That squares
    the condition of J, but v stays exact, and so does where Newton ends; and no row needs to be kept or pivoted.
    """
    x, y, z = pose[0], pose[1], pose[2]
    q = quaternion_of_euler(pose[3], pose[4], pose[5])
    for step in range(1, NEWTON_LIMIT + 1):
        r = matrix_of_quaternion(q)
        a11 = a12 = a13 = a22 = a23 = a33 = 0.0
        c11 = c12 = c13 = c21 = c22 = c23 = c31 = c32 = c33 = 0.0
        d11 = d12 = d13 = d22 = d23 = d33 = 0.0
        f1 = f2 = f3 = m1 = m2 = m3 = 0.0
        for i in range(6):
            length, ux, uy, uz, wx, wy, wz = _leg(robot, i, x, y, z, r)
            v = robot.home_leg_mm[i] + robot.lead_mm_per_rad[i] * motor[i] - length
            a11, a12, a13 = a11 + ux * ux, a12 + ux * uy, a13 + ux * uz
            a22, a23, a33 = a22 + uy * uy, a23 + uy * uz, a33 + uz * uz
            c11, c12, c13 = c11 + ux * wx, c12 + ux * wy, c13 + ux * wz
            c21, c22, c23 = c21 + uy * wx, c22 + uy * wy, c23 + uy * wz
            c31, c32, c33 = c31 + uz * wx, c32 + uz * wy, c33 + uz * wz
            d11, d12, d13 = d11 + wx * wx, d12 + wx * wy, d13 + wx * wz
            d22, d23, d33 = d22 + wy * wy, d23 + wy * wz, d33 + wz * wz
            f1, f2, f3 = f1 + ux * v, f2 + uy * v, f3 + uz * v
            m1, m2, m3 = m1 + wx * v, m2 + wy * v, m3 + wz * v
        change_x, change_y, change_z, turn_x, turn_y, turn_z = solve_by_blocks(
            (a11, a12, a13, a22, a23, a33),
            (c11, c12, c13, c21, c22, c23, c31, c32, c33),
            (d11, d12, d13, d22, d23, d33),
            (f1, f2, f3),
            (m1, m2, m3),
        )
        x, y, z = x + change_x, y + change_y, z + change_z
        q = turned(q, turn_x, turn_y, turn_z)
        if not math.isfinite(x + y + z + q[0] + q[1] + q[2] + q[3]):
            return -1
        shift = max(abs(change_x), abs(change_y), abs(change_z))
        if max(shift, abs(turn_x), abs(turn_y), abs(turn_z)) < NEWTON_STEP:
            pose[0], pose[1], pose[2] = x, y, z
            pose[3], pose[4], pose[5] = euler_of_quaternion(q)
            return step
    return -1


@interface.implement(interface.jacobian, HEXAPOD)
@kernel
def jacobian(robot, pose, matrix):
    """d motor / d (x, y, z, alpha, beta, gamma) (6, 6) [rad/mm, rad/rad]: J diag(I, T) over the leads."""
    r = matrix_of_euler(pose[3], pose[4], pose[5])
    for i in range(6):
        _, ux, uy, uz, wx, wy, wz = _leg(robot, i, pose[0], pose[1], pose[2], r)
        alpha, beta, gamma = per_euler_rates(pose[4], pose[5], wx, wy, wz)
        lead = robot.lead_mm_per_rad[i]
        matrix[i, 0], matrix[i, 1], matrix[i, 2] = ux / lead, uy / lead, uz / lead
        matrix[i, 3], matrix[i, 4], matrix[i, 5] = alpha / lead, beta / lead, gamma / lead


@interface.implement(interface.rotation, HEXAPOD)
@kernel
def rotation(_robot, pose, matrix):
    """The gripper frame (z_T, -y_T, x_T): the array is inserted along the tool axis."""
    r = matrix_of_euler(pose[3], pose[4], pose[5])
    for i in range(3):
        matrix[i, 0], matrix[i, 1], matrix[i, 2] = r[3 * i + 2], -r[3 * i + 1], r[3 * i]


@interface.implement(interface.translate, HEXAPOD)
@kernel
def translate(_robot, pose, offset_in_base):
    """x, y and z: nothing is out of its reach."""
    for i in range(3):
        pose[i] += offset_in_base[i]


@interface.implement(interface.reach, HEXAPOD)
@kernel
def reach(robot, pose):
    """Box, legs, then det J, which must have the sign it has at home: beyond a singularity is another assembly."""
    for k in range(6):
        if not robot.box_low[k] <= pose[k] <= robot.box_high[k]:
            return OUTSIDE_BOX
    r = matrix_of_euler(pose[3], pose[4], pose[5])
    for i in range(6):
        length = _leg(robot, i, pose[0], pose[1], pose[2], r)[0]
        if not robot.joint_low[i] - LEG_TOLERANCE_MM <= length <= robot.joint_high[i] + LEG_TOLERANCE_MM:
            return STROKE_LIMIT
    margin = determinant(robot, pose) / robot.home_determinant_mm3
    return REACHABLE if margin >= robot.margin_min else SINGULAR


@kernel
def determinant(robot, pose):
    """det J [mm^3] of leg lengths per velocity of the tip and angular velocity."""
    r = matrix_of_euler(pose[3], pose[4], pose[5])
    x, y, z = pose[0], pose[1], pose[2]
    a, b, c = _leg(robot, 0, x, y, z, r), _leg(robot, 1, x, y, z, r), _leg(robot, 2, x, y, z, r)
    d, e, f = _leg(robot, 3, x, y, z, r), _leg(robot, 4, x, y, z, r), _leg(robot, 5, x, y, z, r)
    return twist_algebra.determinant(a[1:], b[1:], c[1:], d[1:], e[1:], f[1:])
