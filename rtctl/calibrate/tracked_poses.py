"""Tracked poses as a CSV file: where the gripper was, how the motors stood, and from which side each leg had come.

One row a pose: the pose by the robot's names (`x_mm,y_mm,phi_rad`, gripper in {B}, as a tracker saw it), the motor angles
from home (`motor1_rad,...`), and 1 or 0 for every leg that was extending or retracting when it came to rest
(`extending1,...`). A header names the columns, in any order; lines that begin with # are comments.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rtctl.calibrate import fragment, table_file
from rtctl.calibrate.errors import CalibrationFileError
from rtctl.robots import Robot


@dataclass(frozen=True)
class TrackedPoses:
    """Poses (n, dof) [mm, rad] in {B}, motor angles (n, dof) [rad] from home, and directions (n, dof), True extending."""

    pose: np.ndarray
    motor_rad: np.ndarray
    extending: np.ndarray


def columns(robot: Robot) -> list[str]:
    """Names of the columns, in the order they are written."""
    legs = range(1, robot.dof + 1)
    return [*robot.pose_names, *(f"motor{i}_rad" for i in legs), *(f"extending{i}" for i in legs)]


def write(path: Path, robot: Robot, tracked: TrackedPoses, comments: Iterable[str] = ()) -> None:
    """Write a new file. Raises CalibrationFileError if it exists already or cannot be written."""
    lines = [*(f"# {comment}" for comment in comments), ",".join(columns(robot))]
    for pose, motor, extending in zip(tracked.pose, tracked.motor_rad, tracked.extending, strict=True):
        lines.append(",".join([*(f"{v:.7f}" for v in (*pose, *motor)), *(str(int(e)) for e in extending)]))
    fragment.write(path, "\n".join(lines) + "\n")


def read(path: Path, robot: Robot) -> TrackedPoses:
    """The poses in a file.

    Raises:
        CalibrationFileError: as :func:`rtctl.calibrate.table_file.read`, or a direction that is neither 0 nor 1.
    """
    names, dof = columns(robot), robot.dof
    table, lines = table_file.read(path, names)
    for row, number in zip(table, lines, strict=True):
        for name, value in zip(names[2 * dof :], row[2 * dof :], strict=True):
            if value not in (0.0, 1.0):
                raise CalibrationFileError(f"{path}, line {number}: {name} is neither 0 nor 1", value=float(value))
    return TrackedPoses(table[:, :dof], table[:, dof : 2 * dof], table[:, 2 * dof :] != 0)
