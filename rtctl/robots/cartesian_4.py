"""Three orthogonal linear axes along x, y, z of {B} and one rotation about z.

The robot that the dissertation recommends as future work: x, y and phi are those of the planar robot, and z is the
direction out of its plane, in which that one cannot give way. The linear axes carry the axis of the rotation, at
(c_x, c_y, c_z) in {B}; the gripper tip lies beside it at the offset g in the platform frame, p = c + R_z(phi) g. Where a
linear axis stands at zero is a matter of its own scale, so g has no component along z. Pose: gripper tip and platform
angle in {B}, (x, y, z mm, phi rad). Joints: (c_x, c_y, c_z mm, phi rad).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hal.kernel import kernel
from hal.options import option, read
from rtctl.robots import interface
from rtctl.robots.interface import OUTSIDE_BOX, REACHABLE, STROKE_LIMIT
from rtctl.robots.robot import Robot, check_home, ordered

TRAVEL_TOLERANCE = 1e-6
"""Home may be at an end stop, up to rounding [mm, rad]."""


@dataclass(frozen=True)
class Cartesian4Options:
    """Geometry and limits; one entry an axis: x, y, z and phi."""

    gripper_mm: tuple[float, ...] = option(
        (88.0, 0.0),
        shape=(2,),
        low=-1000,
        high=1000,
        unit="mm",
        doc="gripper tip from the axis of the rotation, along x and y of the platform",
    )
    lead_mm_per_rad: tuple[float, ...] = option(
        (0.097, 0.097, 0.097), shape=(3,), low=0.001, high=10, unit="mm/rad", doc="screw leads of x, y, z"
    )
    gear_ratio: float = option(100.0, low=1, high=10000, doc="turns of the motor per turn of the gripper")
    home_mm_rad: tuple[float, ...] = option(
        (150.0, 0.0, 0.0, 0.0),
        shape=(4,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="pose at which all motor angles are zero",
    )
    travel_low_mm_rad: tuple[float, ...] = option(
        (55.0, -30.0, -20.0, -0.5), shape=(4,), low=-1000, high=1000, unit="mm, rad", doc="smallest c_x, c_y, c_z, phi"
    )
    travel_high_mm_rad: tuple[float, ...] = option(
        (95.0, 30.0, 20.0, 0.5), shape=(4,), low=-1000, high=1000, unit="mm, rad", doc="largest c_x, c_y, c_z, phi"
    )
    box_low_mm_rad: tuple[float, ...] = option(
        (148.5, -11.0, -10.0, -0.32),
        shape=(4,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="smallest x, y, z, phi allowed",
    )
    box_high_mm_rad: tuple[float, ...] = option(
        (176.0, 8.0, 10.0, 0.32), shape=(4,), low=-1000, high=1000, unit="mm, rad", doc="largest x, y, z, phi allowed"
    )


CARTESIAN_4 = np.dtype(
    [
        ("gripper_mm", "f8", (2,)),
        ("lead", "f8", (4,)),  # mm or rad of a joint per rad of its motor
        ("home_joint", "f8", (4,)),
        ("joint_low", "f8", (4,)),
        ("joint_high", "f8", (4,)),
        ("box_low", "f8", (4,)),
        ("box_high", "f8", (4,)),
        ("home_pose", "f8", (4,)),
    ],
    align=True,
)


def load(table: Mapping[str, Any]) -> Robot:
    """The robot with the options in `table`.

    Raises:
        OptionError: as `hal.options.read`, or a lower limit that is not below its upper limit.
        RobotError: home is outside the limits.
    """
    o, data = read(Cartesian4Options, table, "robot.geometry"), np.zeros(1, CARTESIAN_4)
    ordered("travel_low_mm_rad", o.travel_low_mm_rad, "travel_high_mm_rad", o.travel_high_mm_rad)
    ordered("box_low_mm_rad", o.box_low_mm_rad, "box_high_mm_rad", o.box_high_mm_rad)
    data["gripper_mm"], data["home_pose"] = o.gripper_mm, o.home_mm_rad
    data["lead"] = *o.lead_mm_per_rad, 1.0 / o.gear_ratio
    data["joint_low"], data["joint_high"] = o.travel_low_mm_rad, o.travel_high_mm_rad
    data["box_low"], data["box_high"] = o.box_low_mm_rad, o.box_high_mm_rad
    robot = Robot(
        kind="cartesian_4",
        pose_names=("x_mm", "y_mm", "z_mm", "phi_rad"),
        joint_names=("c_x_mm", "c_y_mm", "c_z_mm", "phi_rad"),
        joint_units=("mm", "mm", "mm", "rad"),
        record=data,
        translation_mask=(True, True, True),
        length_dofs=3,
    )
    data["home_joint"], _ = robot.inverse(o.home_mm_rad)
    check_home(robot)
    return robot


@kernel
def _arm(robot, phi):
    """R_z(phi) g: the gripper tip from the axis of the rotation, along x and y of {B} [mm]."""
    c, s = math.cos(phi), math.sin(phi)
    gx, gy = robot.gripper_mm[0], robot.gripper_mm[1]
    return c * gx - s * gy, s * gx + c * gy


@interface.implement(interface.inverse, CARTESIAN_4)
@kernel
def inverse(robot, pose, joint, motor):
    """Every finite pose has joint values."""
    arm_x, arm_y = _arm(robot, pose[3])
    joint[0], joint[1], joint[2], joint[3] = pose[0] - arm_x, pose[1] - arm_y, pose[2], pose[3]
    finite = True
    for i in range(4):
        motor[i] = (joint[i] - robot.home_joint[i]) / robot.lead[i]
        finite = finite and math.isfinite(motor[i])
    if not finite:
        for i in range(4):
            joint[i] = motor[i] = math.nan
    return finite


@interface.implement(interface.forward, CARTESIAN_4)
@kernel
def forward(robot, motor, pose):
    """In closed form, so in one step from wherever `pose` starts."""
    for i in range(4):
        if not math.isfinite(motor[i]):
            return -1
    for i in range(4):
        pose[i] = robot.home_joint[i] + robot.lead[i] * motor[i]
    arm_x, arm_y = _arm(robot, pose[3])
    pose[0] += arm_x
    pose[1] += arm_y
    return 1


@interface.implement(interface.jacobian, CARTESIAN_4)
@kernel
def jacobian(robot, pose, matrix):
    """d motor / d pose (4, 4) [rad/mm, rad/rad]: the linear axes make up for the swing of the gripper."""
    arm_x, arm_y = _arm(robot, pose[3])
    for i in range(4):
        for k in range(4):
            matrix[i, k] = 0.0
        matrix[i, i] = 1.0 / robot.lead[i]
    matrix[0, 3], matrix[1, 3] = arm_y / robot.lead[0], -arm_x / robot.lead[1]


@interface.implement(interface.rotation, CARTESIAN_4)
@kernel
def rotation(_robot, pose, matrix):
    """R_z(phi): the array is inserted along the platform's x axis."""
    c, s = math.cos(pose[3]), math.sin(pose[3])
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = c, -s, 0.0
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = s, c, 0.0
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 0.0, 0.0, 1.0


@interface.implement(interface.translate, CARTESIAN_4)
@kernel
def translate(_robot, pose, offset_in_base):
    """x, y and z."""
    for i in range(3):
        pose[i] += offset_in_base[i]


@interface.implement(interface.reach, CARTESIAN_4)
@kernel
def reach(robot, pose):
    """Box, then travels; axes at right angles are never singular."""
    for k in range(4):
        if not robot.box_low[k] <= pose[k] <= robot.box_high[k]:
            return OUTSIDE_BOX
    arm_x, arm_y = _arm(robot, pose[3])
    if not (_within(robot, 0, pose[0] - arm_x) and _within(robot, 1, pose[1] - arm_y)):
        return STROKE_LIMIT
    if not (_within(robot, 2, pose[2]) and _within(robot, 3, pose[3])):
        return STROKE_LIMIT
    return REACHABLE


@kernel
def _within(robot, i, joint):
    return robot.joint_low[i] - TRAVEL_TOLERANCE <= joint <= robot.joint_high[i] + TRAVEL_TOLERANCE
