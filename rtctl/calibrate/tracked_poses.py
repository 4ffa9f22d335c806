"""Tracked poses as a CSV file: where the gripper was, how the motors stood, and from which side each leg had come.

One row a pose: the pose by the robot's names (`x_mm,y_mm,phi_rad`, gripper in {B}, as a tracker saw it), the motor angles
from home (`motor1_rad,...`), and 1 or 0 for every leg that was extending or retracting when it came to rest
(`extending1,...`). A header names the columns, in any order; lines that begin with # are comments.
"""

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rtctl.calibrate import fragment
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
        CalibrationFileError: it cannot be read, a column is missing or unknown, or a line is not what it should be.
    """
    try:
        lines = path.read_text().splitlines()
    except (OSError, ValueError) as error:
        raise CalibrationFileError("the file cannot be read", value=str(path), remedy=str(error)) from None
    numbered = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    names, dof = columns(robot), robot.dof
    if not numbered:
        raise CalibrationFileError("the file is empty", value=str(path), remedy=f"its columns are {','.join(names)}")
    header = [name.strip() for name in next(csv.reader([numbered[0][1]]))]
    if sorted(header) != sorted(names):
        wrong = sorted(set(header) ^ set(names)) or sorted({n for n in header if header.count(n) > 1})
        raise CalibrationFileError(f"{path}: the columns are not those of {robot.kind}", value=wrong, bound=",".join(names))  # fmt: skip
    rows = [_row(path, number, line, header, names[2 * dof :]) for number, line in numbered[1:]]
    table = np.array(rows).reshape(-1, len(header))[:, [header.index(name) for name in names]]
    return TrackedPoses(table[:, :dof], table[:, dof : 2 * dof], table[:, 2 * dof :] != 0)


def _row(path: Path, number: int, line: str, header: list[str], switches: list[str]) -> list[float]:
    cells = next(csv.reader([line]))
    if len(cells) != len(header):
        raise CalibrationFileError(f"{path}, line {number} has another number of columns than the header", value=len(cells), bound=f"{len(header)}")  # fmt: skip
    values = []
    for name, cell in zip(header, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise CalibrationFileError(f"{path}, line {number}: {name} is not a finite number", value=cell)
        if name in switches and value not in (0.0, 1.0):
            raise CalibrationFileError(f"{path}, line {number}: {name} is neither 0 nor 1", value=cell)
        values.append(value)
    return values
