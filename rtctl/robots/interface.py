"""What the tick asks of any robot, and how a robot answers it in compiled code.

A robot is one file. It packs its geometry into one structured record and implements the functions
below for the type of that record; the compiler picks the implementation by the record's type, so the
tick calls a planar robot, a hexapod or an arm of five axes by the same name at no cost.

Shapes: `pose` (dof,), `joint` (dof,), `motor` (dof,). The pose is the gripper tip in the robot base
{B}: planar (x mm, y mm, phi rad); spatial robots put their three translations first.

The rest of the record is the robot's own affair, but every record has the fields `home_pose`, `box_low`,
`box_high` (in units of the pose) and `joint_low`, `joint_high` (in units of the joints), all (dof,): the errors of
:class:`rtctl.robots.robot.Robot` are made from them.
"""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba.extending import overload

# answers of `reach`
REACHABLE, OUTSIDE_BOX, STROKE_LIMIT, SINGULAR = 0, 1, 2, 3


def inverse(robot, pose, joint, motor):
    """Inverse kinematics: joint values [mm or rad] and motor angles [rad] of `pose`. True if it exists.

    Writes `joint` and `motor`; both are NaN where the pose cannot be assembled.
    """
    raise NotImplementedError


def forward(robot, motor, pose):
    """Forward kinematics by Newton iteration; `pose` is the start value and the result.

    Returns the iterations used, or -1 (and `pose` unchanged) if it does not converge.
    """
    raise NotImplementedError


def jacobian(robot, pose, matrix):
    """d motor / d pose into `matrix` (dof, dof) [rad/mm, rad/rad]."""
    raise NotImplementedError


def rotation(robot, pose, matrix):
    """Rotation of the gripper in the base {B} into `matrix` (3, 3); its first column is the insertion axis."""
    raise NotImplementedError


def translate(robot, pose, offset_in_base):
    """Add a translation (3,) [mm] given in {B} to `pose`, in the directions the robot has."""
    raise NotImplementedError


def reach(robot, pose):
    """One of REACHABLE, OUTSIDE_BOX, STROKE_LIMIT, SINGULAR (also for NaN: OUTSIDE_BOX)."""
    raise NotImplementedError


def implement(function: Callable[..., Any], dtype: np.dtype) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator: the decorated kernel answers `function` for robots whose record has `dtype`."""
    record_type = numba.from_dtype(dtype)

    def register(compiled: Callable[..., Any]) -> Callable[..., Any]:
        python = compiled.py_func  # type: ignore[attr-defined]

        @overload(function, strict=False, jit_options={"error_model": "numpy", "nogil": True})
        def choose(robot, *_):
            return python if robot == record_type else None

        return compiled

    return register
