"""CochleRob: a Delta robot that hangs from a slider, and the slider from an arc (01 section 3).

The arc turns by phi about the vertical axis z of {B}, the slider runs along it by psi, and the Delta below the slider
carries the nacelle with the magnets. {B} is the paper's R_0, with its origin at the centre of the arc; R_1 with the
axes A_0 = R_z(phi) R_x(psi) turns with the slider. Pose: the tip P (the paper's L_2) in {B} and the two angles,
(x, y, z mm, psi, phi rad). Joints: the angles alpha_1..3 of the Delta's arms below its base plate, psi and phi [rad].
All motor angles are zero where the arms are level, the slider is on top and the arc at phi = 0, and they are
n alpha_i, n (R/R_p) psi and n phi.

The tool axis is A_0 z, and the tip is on its lower side: it advances along -A_0 z, from the nacelle to the tip. The
gripper frame of the interface, whose x axis is the insertion axis, is R_1 turned by 90 deg about its y axis:
x_G = -z_1, y_G = y_1, z_G = x_1.

In the kernels (x, y, z) is the nacelle P_n in the Delta's frame, with z < 0, and rod i of unit vector u_i hangs from
the elbow C_i = (r + l_1 cos alpha_i) a_i - l_1 sin alpha_i z, with a_i the horizontal direction of arm i.
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
from rtctl.robots import interface
from rtctl.robots.interface import OUTSIDE_BOX, REACHABLE, SINGULAR, STROKE_LIMIT
from rtctl.robots.robot import Robot, RobotError, check_home, ordered

ANGLE_TOLERANCE_RAD = 1e-9
"""A joint may be at its limit, up to rounding."""


@dataclass(frozen=True)
class CochlerobOptions:
    """Geometry, masses and limits; limits of joints are of alpha_1, alpha_2, alpha_3, psi, phi."""

    base_radius_mm: float = option(110.0, low=1, high=1000, unit="mm", doc="Delta: radius of its base plate, l_0")
    nacelle_radius_mm: float = option(50.0, low=0, high=1000, unit="mm", doc="Delta: radius of the nacelle, l_3")
    arm_mm: float = option(130.0, low=1, high=1000, unit="mm", doc="Delta: length of the arms, l_1")
    rod_mm: float = option(260.0, low=1, high=2000, unit="mm", doc="Delta: length of the rods, l_2")
    tool_mm: float = option(110.0, low=0, high=2000, unit="mm", doc="from the nacelle down to the tip, L_t")
    arc_radius_mm: float = option(340.0, low=1, high=5000, unit="mm", doc="radius of the arc, R")
    slider_pulley_mm: float = option(20.0, low=1, high=1000, unit="mm", doc="radius of the slider's pulley, R_p")
    gear_ratio: float = option(231.0, low=1, high=10000, doc="turns of a motor per turn of its gear's output, n")
    arm_kg: float = option(0.12, low=0, high=100, unit="kg", doc="mass of an arm, M_1")
    arm_centre_mm: float = option(52.0, low=0, high=1000, unit="mm", doc="its centre of mass from its axis, d_1")
    rods_kg: float = option(0.06, low=0, high=100, unit="kg", doc="mass of the pair of rods of an arm, M_2")
    nacelle_kg: float = option(1.2, low=0, high=100, unit="kg", doc="mass of the nacelle with its magnets, M_3")
    slider_kg: float = option(0.8, low=0, high=100, unit="kg", doc="mass of the slider with the base plate, M_4")
    joint_low_rad: tuple[float, ...] = option(
        (-0.6, -0.6, -0.6, -0.05, -6.3), shape=(5,), low=-20, high=0, unit="rad", doc="smallest joint angles"
    )
    joint_high_rad: tuple[float, ...] = option(
        (1.1, 1.1, 1.1, 1.65, 6.3), shape=(5,), low=0, high=20, unit="rad", doc="largest joint angles"
    )
    box_low_mm_rad: tuple[float, ...] = option(
        (-80.0, -80.0, -80.0, -0.02, -6.2832),
        shape=(5,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="smallest x, y, z, psi, phi allowed",
    )
    box_high_mm_rad: tuple[float, ...] = option(
        (80.0, 80.0, 80.0, 1.6, 6.2832),
        shape=(5,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="largest x, y, z, psi, phi allowed",
    )
    margin_min: float = option(
        0.1,
        low=0.001,
        high=1,
        doc="smallest distance of the Delta from a singularity allowed; it is 0 there, at most 1",
    )


COCHLEROB = np.dtype(
    [
        ("arm_axis", "f8", (3, 2)),  # a_i: directions of the arms in the Delta's plane
        ("hub_radius_mm", "f8"),  # r = l_0 - l_3: the chains moved inwards until the rods meet in one point
        ("arm_mm", "f8"),
        ("rod_mm", "f8"),
        ("arc_radius_mm", "f8"),
        ("nacelle_mm", "f8"),  # R - L_t: the tip above the nacelle, seen from the centre of the arc
        ("arm_kg", "f8"),
        ("arm_centre_mm", "f8"),
        ("rods_kg", "f8"),
        ("nacelle_kg", "f8"),
        ("slider_kg", "f8"),
        ("ratio", "f8", (5,)),  # motor angle per joint angle
        ("joint_low", "f8", (5,)),
        ("joint_high", "f8", (5,)),
        ("box_low", "f8", (5,)),
        ("box_high", "f8", (5,)),
        ("margin_min", "f8"),
        ("home_pose", "f8", (5,)),
    ],
    align=True,
)


def load(table: Mapping[str, Any]) -> Robot:
    """The robot with the options in `table`.

    Raises:
        OptionError: as `hal.options.read`, a lower limit that is not below its upper limit, or a nacelle that is wider
            than the base plate.
        RobotError: the Delta cannot be assembled with its arms level, or that is outside the limits or singular.
    """
    o, data = read(CochlerobOptions, table, "robot.geometry"), np.zeros(1, COCHLEROB)
    ordered("joint_low_rad", o.joint_low_rad, "joint_high_rad", o.joint_high_rad)
    ordered("box_low_mm_rad", o.box_low_mm_rad, "box_high_mm_rad", o.box_high_mm_rad)
    if o.nacelle_radius_mm > o.base_radius_mm:
        what = "robot.geometry.nacelle_radius_mm is larger than base_radius_mm"
        raise OptionError(what, value=o.nacelle_radius_mm, bound=f"at most {o.base_radius_mm:g} mm", remedy="set both")
    for name in ("arm_mm", "rod_mm", "arc_radius_mm", "arm_kg", "arm_centre_mm", "rods_kg", "nacelle_kg", "slider_kg"):
        data[name] = getattr(o, name)
    azimuth = np.arange(3) * (2.0 * math.pi / 3.0)
    data["arm_axis"][0, :, 0], data["arm_axis"][0, :, 1] = np.cos(azimuth), np.sin(azimuth)
    data["hub_radius_mm"] = o.base_radius_mm - o.nacelle_radius_mm
    data["nacelle_mm"] = o.arc_radius_mm - o.tool_mm
    data["ratio"] = o.gear_ratio * np.array([1.0, 1.0, 1.0, o.arc_radius_mm / o.slider_pulley_mm, 1.0])
    data["joint_low"], data["joint_high"] = o.joint_low_rad, o.joint_high_rad
    data["box_low"], data["box_high"] = o.box_low_mm_rad, o.box_high_mm_rad
    data["margin_min"] = o.margin_min
    robot = _robot(data)
    try:
        data["home_pose"] = robot.forward(np.zeros(5))
    except RobotError:
        raise RobotError(
            "the Delta cannot be assembled with its arms level",
            value=[float(data["hub_radius_mm"][0]), o.arm_mm, o.rod_mm],
            bound="rod_mm above base_radius_mm - nacelle_radius_mm + arm_mm",
            remedy="check these lengths in robot.geometry",
        ) from None
    check_home(robot)
    return robot


def _robot(data: np.ndarray) -> Robot:
    return Robot(
        kind="cochlerob",
        pose_names=("x_mm", "y_mm", "z_mm", "psi_rad", "phi_rad"),
        joint_names=("alpha1_rad", "alpha2_rad", "alpha3_rad", "psi_rad", "phi_rad"),
        joint_units=("rad",) * 5,
        record=data,
        translation_mask=(True, True, True),
        length_dofs=3,
        singular_error=partial(_singular_error, data),
    )


def _singular_error(data: np.ndarray, pose: np.ndarray) -> RobotError:
    rods, outstretched = _margins(data, pose)
    if outstretched < data["margin_min"][0]:
        what, value = (
            "an arm is nearly in line with its rods: u_i is too steep on the circle of its elbow",
            outstretched,
        )
    else:
        what, value = "the rods are nearly in one plane, or beyond: -det [u_1 u_2 u_3] is too small", rods
    return RobotError(
        f"the pose {pose.round(6).tolist()} is too near to a singularity of the Delta: {what}",
        value=float(value),
        bound=f"{data['margin_min'][0]:g} or larger",
        remedy="choose a pose nearer to the middle of the workspace, or lower robot.geometry.margin_min",
    )


@kernel
def _margins(data, pose):
    robot = data[0]
    _, _, _, _, x, y, z = nacelle(robot, pose)
    a, b, c = chain(robot, 0, x, y, z), chain(robot, 1, x, y, z), chain(robot, 2, x, y, z)
    return spread(a, b, c), min(a[4], b[4], c[4])


@kernel
def nacelle(robot, pose):
    """cos psi, sin psi, cos phi, sin phi and the nacelle (x, y, z) = A_0^T P - (0, 0, R - L_t) [mm]."""
    c_psi, s_psi = math.cos(pose[3]), math.sin(pose[3])
    c_phi, s_phi = math.cos(pose[4]), math.sin(pose[4])
    along = c_phi * pose[1] - s_phi * pose[0]
    x = c_phi * pose[0] + s_phi * pose[1]
    y = c_psi * along + s_psi * pose[2]
    z = c_psi * pose[2] - s_psi * along - robot.nacelle_mm
    return c_psi, s_psi, c_phi, s_phi, x, y, z


@kernel
def chain(robot, i, x, y, z):
    """Arm i with the nacelle at (x, y, z): alpha_i, the rod's unit vector u_i, and how well the arm drives it.

    The last is u_i dC_i/dalpha / l_1, 1 where the rod is tangential to the circle of the elbow and 0 where it is in
    line with the arm. The loop closes where b cos alpha + 2 z sin alpha = d, which is (8) corrected; b^2 + 4 z^2 - d^2
    is the paper's F_i, and of its two roots this is the elbow outwards, in the form that is never 0/0 for z < 0. All
    NaN where the rod is too short or too long.
    """
    r, l1, l2 = robot.hub_radius_mm, robot.arm_mm, robot.rod_mm
    ax, ay = robot.arm_axis[i, 0], robot.arm_axis[i, 1]
    q = 2.0 * (x * ax + y * ay)
    b = 2.0 * r - q
    d = (l2 * l2 - l1 * l1 - r * r - x * x - y * y - z * z + r * q) / l1
    root = math.sqrt(4.0 * z * z + (b - d) * (b + d))
    alpha = 2.0 * math.atan((b - d) / (root - 2.0 * z))
    reach_out, drop = r + l1 * math.cos(alpha), l1 * math.sin(alpha)
    return alpha, (x - reach_out * ax) / l2, (y - reach_out * ay) / l2, (z + drop) / l2, root / (2.0 * l2)


@kernel
def spread(a, b, c):
    """-det [u_1 u_2 u_3] of three chains: 1 for rods at right angles, 0 in one plane, negative beyond."""
    return a[1] * (b[3] * c[2] - b[2] * c[3]) + a[2] * (b[1] * c[3] - b[3] * c[1]) + a[3] * (b[2] * c[1] - b[1] * c[2])


@interface.implement(interface.inverse, COCHLEROB)
@kernel
def inverse(robot, pose, joint, motor):
    """(9) corrected: the elbows outwards."""
    _, _, _, _, x, y, z = nacelle(robot, pose)
    for i in range(3):
        joint[i] = chain(robot, i, x, y, z)[0]
    joint[3], joint[4] = pose[3], pose[4]
    assembled = True
    for i in range(5):
        motor[i] = robot.ratio[i] * joint[i]
        assembled = assembled and math.isfinite(motor[i])
    if not assembled:
        for i in range(5):
            joint[i] = motor[i] = math.nan
    return assembled


@interface.implement(interface.forward, COCHLEROB)
@kernel
def forward(robot, motor, pose):
    """In closed form, so in one step from wherever `pose` starts; -1 where the robot cannot be assembled as drawn.

    The nacelle is as far below the plane of the three elbows as the rods reach, under the centre of the circle through
    them: the same as the H_k of the paper, without dividing by H_2. The other assemblies, with an elbow inwards or an
    arm turned more than half round, are not the robot's: there `inverse` would give other angles.
    """
    r, l1, l2 = robot.hub_radius_mm, robot.arm_mm, robot.rod_mm
    alpha1, alpha2, alpha3 = motor[0] / robot.ratio[0], motor[1] / robot.ratio[1], motor[2] / robot.ratio[2]
    psi, phi = motor[3] / robot.ratio[3], motor[4] / robot.ratio[4]
    if not (max(abs(alpha1), abs(alpha2), abs(alpha3)) <= math.pi and math.isfinite(psi + phi)):
        return -1
    reach_1, reach_2, reach_3 = r + l1 * math.cos(alpha1), r + l1 * math.cos(alpha2), r + l1 * math.cos(alpha3)
    x1, y1, z1 = reach_1 * robot.arm_axis[0, 0], reach_1 * robot.arm_axis[0, 1], -l1 * math.sin(alpha1)
    # the triangle of the elbows: edges a and b from the first, normal n upwards
    ax, ay = reach_2 * robot.arm_axis[1, 0] - x1, reach_2 * robot.arm_axis[1, 1] - y1
    bx, by = reach_3 * robot.arm_axis[2, 0] - x1, reach_3 * robot.arm_axis[2, 1] - y1
    az, bz = -l1 * math.sin(alpha2) - z1, -l1 * math.sin(alpha3) - z1
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    aa, bb, nn = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, nx * nx + ny * ny + nz * nz
    # from the first elbow to the centre of their circle, and from there down to the nacelle
    wx, wy, wz = aa * bx - bb * ax, aa * by - bb * ay, aa * bz - bb * az
    half = 0.5 / nn
    mx, my, mz = half * (wy * nz - wz * ny), half * (wz * nx - wx * nz), half * (wx * ny - wy * nx)
    down = math.sqrt((l2 * l2 - mx * mx - my * my - mz * mz) / nn)
    x, y, z = x1 + mx - down * nx, y1 + my - down * ny, z1 + mz - down * nz
    if not (
        _drives(robot, 0, alpha1, x, y, z) and _drives(robot, 1, alpha2, x, y, z) and _drives(robot, 2, alpha3, x, y, z)
    ):
        return -1
    c_psi, s_psi = math.cos(psi), math.sin(psi)
    c_phi, s_phi = math.cos(phi), math.sin(phi)
    z += robot.nacelle_mm
    along = c_psi * y - s_psi * z
    pose[0], pose[1] = c_phi * x - s_phi * along, s_phi * x + c_phi * along
    pose[2], pose[3], pose[4] = s_psi * y + c_psi * z, psi, phi
    return 1


@kernel
def _drives(robot, i, alpha, x, y, z):
    """The elbow of arm i is outwards: the arm pushes its rod when it turns down. False for NaN."""
    outwards = x * robot.arm_axis[i, 0] + y * robot.arm_axis[i, 1] - robot.hub_radius_mm
    return -math.sin(alpha) * outwards - math.cos(alpha) * z > 0.0


@interface.implement(interface.jacobian, COCHLEROB)
@kernel
def jacobian(robot, pose, matrix):
    """d motor / d pose (5, 5) [rad/mm, rad/rad]: u_i (dP_n - dC_i) = 0, and P_n = A_0^T P - (0, 0, R - L_t)."""
    c_psi, s_psi, c_phi, s_phi, x, y, z = nacelle(robot, pose)
    above = z + robot.nacelle_mm
    along = c_psi * y - s_psi * above  # A_0^T P = (x, y, above) before the turn by psi is (x, along, P_z)
    for i in range(3):
        _, ux, uy, uz, drive = chain(robot, i, x, y, z)
        per = robot.ratio[i] / (robot.arm_mm * drive)
        flat = c_psi * uy - s_psi * uz
        matrix[i, 0] = per * (c_phi * ux - s_phi * flat)
        matrix[i, 1] = per * (s_phi * ux + c_phi * flat)
        matrix[i, 2] = per * (s_psi * uy + c_psi * uz)
        matrix[i, 3] = per * (uy * above - uz * y)
        matrix[i, 4] = per * (ux * along - flat * x)
    for i in range(3, 5):
        for k in range(5):
            matrix[i, k] = 0.0
        matrix[i, i] = robot.ratio[i]


@interface.implement(interface.rotation, COCHLEROB)
@kernel
def rotation(_robot, pose, matrix):
    """A_0 R_y(90 deg): the tool advances along -A_0 z."""
    c_psi, s_psi = math.cos(pose[3]), math.sin(pose[3])
    c_phi, s_phi = math.cos(pose[4]), math.sin(pose[4])
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = -s_phi * s_psi, -s_phi * c_psi, c_phi
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = c_phi * s_psi, c_phi * c_psi, s_phi
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = -c_psi, s_psi, 0.0


@interface.implement(interface.translate, COCHLEROB)
@kernel
def translate(_robot, pose, offset_in_base):
    """x, y and z."""
    for k in range(3):
        pose[k] += offset_in_base[k]


@interface.implement(interface.reach, COCHLEROB)
@kernel
def reach(robot, pose):
    """Box, joint angles, then how far the Delta is from its two kinds of singularity."""
    for k in range(5):
        if not robot.box_low[k] <= pose[k] <= robot.box_high[k]:
            return OUTSIDE_BOX
    _, _, _, _, x, y, z = nacelle(robot, pose)
    a, b, c = chain(robot, 0, x, y, z), chain(robot, 1, x, y, z), chain(robot, 2, x, y, z)
    if not (_within(robot, 0, a[0]) and _within(robot, 1, b[0]) and _within(robot, 2, c[0])):
        return STROKE_LIMIT
    if not (_within(robot, 3, pose[3]) and _within(robot, 4, pose[4])):
        return STROKE_LIMIT
    if not min(spread(a, b, c), a[4], b[4], c[4]) >= robot.margin_min:
        return SINGULAR
    return REACHABLE


@kernel
def _within(robot, i, angle):
    return robot.joint_low[i] - ANGLE_TOLERANCE_RAD <= angle <= robot.joint_high[i] + ANGLE_TOLERANCE_RAD
