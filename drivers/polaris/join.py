"""``python -m drivers.polaris.join``: tracked poses and noted motor angles to the file that ``rtctl calibrate backlash`` reads.

For a planar robot. The frames of every pose are averaged, and brought from the reference tool to the robot's base {B} and from the
tracked tool to the gripper by a registration in TOML, which says how the two tools are mounted:

    base_from_reference = { quaternion = [1, 0, 0, 0], position_mm = [0, 0, 0] }   # the reference tool in {B}
    tool_from_gripper = { quaternion = [1, 0, 0, 0], position_mm = [0, 0, 0] }     # the gripper in the tracked tool
"""

import argparse
import csv
import math
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drivers.polaris.geometry import mean_quaternion, transform
from drivers.polaris.record import COLUMNS
from hal.errors import BackendError

EXAMPLES = """example:
  python -m drivers.polaris.join tracked.csv motors.csv --registration mounting.toml --out poses.csv
  rtctl calibrate backlash poses.csv my-robot

motors.csv has one row a pose, in the order of the poses, with the columns motor1_rad ..., extending1 ... of poses.csv; see
docs/reference/formats/calibration.md.
"""


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    p = argparse.ArgumentParser("python -m drivers.polaris.join", description="Join tracked poses with motor angles.", epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    p.add_argument("tracked", type=Path, metavar="TRACKED", help="CSV of `python -m drivers.polaris.record`")
    p.add_argument("motors", type=Path, metavar="MOTORS", help="CSV of motor angles and directions, one row a pose")
    p.add_argument("--registration", required=True, type=Path, metavar="FILE", help="TOML with both mountings")
    p.add_argument("--out", required=True, type=Path, metavar="FILE", help="CSV file to write; it must not exist")
    p.add_argument(
        "--plane", type=float, default=1.0, metavar="MM", help="most that poses may lie beside one plane (1)"
    )
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the joined file; 0, or 2 for what is wrong with the others."""
    given = parser().parse_args(arguments)
    try:
        base, gripper = _registration(given.registration)
        header, motors = _table(given.motors)
        poses, beside_mm = planar(averages(given.tracked), base, gripper)
        if len(poses) != len(motors):
            raise BackendError("there are not as many motor angles as poses", value=len(motors), bound=f"{len(poses)}", remedy="note one row of motor angles at every pose")  # fmt: skip
        if beside_mm > given.plane:
            raise BackendError("the poses do not lie in one plane of {B}", value=f"{beside_mm:.2f} mm", bound=f"{given.plane:g} mm", remedy="check the registration")  # fmt: skip
        rows = [",".join([*(f"{v:.7f}" for v in pose), *motor]) for pose, motor in zip(poses, motors, strict=True)]
        with given.out.open("x") as file:
            print(f"# {given.tracked}, {given.motors}, {given.registration}", file=file)
            print("\n".join([",".join(["x_mm", "y_mm", "phi_rad", *header]), *rows]), file=file)
    except (BackendError, OSError) as error:
        print(f"join: {error}", file=sys.stderr)
        return 2
    print(f"join: {len(rows)} poses in {given.out}, within {beside_mm:.2f} mm of a plane")
    return 0


def averages(path: Path) -> np.ndarray:
    """The mean transform (n, 4, 4) of the frames of every pose. Raises BackendError, OSError."""
    header, rows = _table(path)
    if header != COLUMNS.split(","):
        raise BackendError("this is no file of tracked poses", value=",".join(header), bound=COLUMNS)
    try:
        table = np.array(rows, dtype=float).reshape(-1, len(header))
    except ValueError as error:
        raise BackendError("a number in the tracked poses cannot be read", value=str(path), remedy=str(error)) from None
    numbers = np.unique(table[:, 0])
    if not len(numbers) or not np.array_equal(numbers, np.arange(1, len(numbers) + 1)) or not np.isfinite(table).all():
        raise BackendError("the poses are not numbered from 1 on, or not finite", value=str(path), remedy="use the file as it was recorded")  # fmt: skip
    frames = [table[table[:, 0] == number] for number in numbers]
    return np.array([transform(mean_quaternion(f[:, 5:9]), f[:, 2:5].mean(axis=0)) for f in frames])


def planar(tracked: np.ndarray, base: np.ndarray, gripper: np.ndarray) -> tuple[np.ndarray, float]:
    """Poses (n, 3) [mm, mm, rad] of the gripper in {B}, and how far they lie beside their mean plane z [mm]."""
    placed = base @ tracked @ gripper
    angle = np.arctan2(placed[:, 1, 0], placed[:, 0, 0])
    z = placed[:, 2, 3]
    return np.column_stack([placed[:, 0, 3], placed[:, 1, 3], angle]), float(np.abs(z - z.mean()).max())


def _registration(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Both mountings (4, 4). Raises BackendError, OSError."""
    try:
        tables = tomllib.loads(path.read_text())
    except ValueError as error:
        raise BackendError("the registration cannot be read", value=str(path), remedy=str(error)) from None
    return _mounting(tables, "base_from_reference"), _mounting(tables, "tool_from_gripper")


def _mounting(tables: dict[str, Any], name: str) -> np.ndarray:
    try:
        quaternion, place = (np.array(tables[name][key], dtype=float) for key in ("quaternion", "position_mm"))
    except (KeyError, TypeError, ValueError):
        quaternion = place = np.zeros(0)
    if quaternion.shape != (4,) or place.shape != (3,) or not math.isclose(float(np.linalg.norm(quaternion)), 1.0, abs_tol=0.01):  # fmt: skip
        raise BackendError(f"{name} is no transform", value=tables.get(name), bound="a unit quaternion of four and position_mm of three numbers")  # fmt: skip
    return transform(quaternion, place)


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows; comments and empty lines are left out. Raises BackendError, OSError."""
    lines = [line for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]
    rows = list(csv.reader(lines))
    if not rows or any(len(row) != len(rows[0]) for row in rows):
        raise BackendError("a table's rows are not as long as its header", value=str(path))
    return [name.strip() for name in rows[0]], rows[1:]


if __name__ == "__main__":
    sys.exit(main())
