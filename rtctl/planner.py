"""From the registered entry to the path the tick follows: plan, place, pack, check.

Takes seconds; called by the gateway, by lockstep simulation and by scripts, never in the loop.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from hal.errors import RtctlError
from rtctl.electrode.path import evaluate_path
from rtctl.electrode.path_validation import validate_path
from rtctl.electrode.planning import Plan, Progress, plan_insertion
from rtctl.electrode.robot_path import robot_path
from rtctl.robots import Robot
from rtctl.settings import Settings

SAMPLE_MM = 0.1
"""Distance in depth of the poses that are checked."""


class PlanError(RtctlError):
    """There is no insertion plan the robot can carry out."""


def plan_of(settings: Settings, progress: Progress | None = None) -> Plan:
    """The insertion relative to the cochlea: it depends on the model of the array alone, so many runs may share it."""
    return plan_insertion(np.array(settings.electrode.modal_matrix), progress)


def make_plan(
    settings: Settings,
    robot: Robot,
    pose_entry: ArrayLike,
    number: int,
    progress: Progress | None = None,
    *,
    known: Plan | None = None,
) -> np.ndarray:
    """The insertion path (1,) of dtype PATH from the registered entry.

    Args:
        pose_entry: gripper pose (dof,) in {B} [mm, rad] when it pointed at the entry along the approach.
        number: number of the plan, for the records.
        progress: called as progress(done, total); what it raises ends the planning.
        known: what :func:`plan_of` has given for these settings; computed if None.

    Raises:
        PlanError: the entry is not registered, a pose of the path is out of reach, or the path is too fast for
            the limits at the insertion speed of the workflow.
    """
    entry = np.asarray(pose_entry, dtype=float)
    if entry.shape != (robot.dof,) or not np.isfinite(entry).all():
        raise PlanError("the entry is not registered", remedy="move the gripper to the entry and run `rtctl register`")
    plan = plan_of(settings, progress) if known is None else known
    path = robot_path(plan, entry, number)
    validate_path(path, robot.dof)
    check_reach(robot, path)
    check_speed(settings, robot, path)
    return path


def sample(path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths (n,) [mm] every 0.1 mm, the channels (n, dof + 1) there and their slopes by depth (n, dof + 1)."""
    record = path[0]
    end = float(record["depth_mm"][record["intervals"]])
    depth = np.append(np.arange(0.0, end, SAMPLE_MM), end)
    values, slopes = np.empty((2, len(depth), int(record["channels"])))
    for i, d in enumerate(depth):
        evaluate_path(record, d, values[i], slopes[i])
    return depth, values, slopes


def check_reach(robot: Robot, path: np.ndarray) -> None:
    """Raises PlanError at the first sampled pose of the path that the robot cannot reach."""
    depth, values, _ = sample(path)
    for d, pose in zip(depth, values[:, :-1], strict=True):
        problem = robot.explain(pose)
        if problem is not None:
            raise PlanError(
                f"at depth {d:.1f} mm the robot cannot follow the plan: {problem.what}",
                value=problem.value,
                bound=problem.bound,
                remedy="register an entry nearer to the middle of the workspace",
            )


def check_speed(settings: Settings, robot: Robot, path: np.ndarray) -> None:
    """Raises PlanError if the path, followed at workflow.speed_mm_per_s, is too fast for a limit of the settings."""
    depth, _, slopes = sample(path)
    lengths = robot.length_dofs
    trajectory, speed = settings.trajectory, settings.workflow.speed_mm_per_s
    rates = (
        ("the gripper", np.linalg.norm(slopes[:, :lengths], axis=1), trajectory.speed_mm_per_s, "mm/s"),
        ("the rotation", np.linalg.norm(slopes[:, lengths:-1], axis=1), trajectory.speed_rad_per_s, "rad/s"),
        ("the stylet", np.abs(slopes[:, -1]), settings.stylet.speed_mm_per_s, "mm/s"),
    )
    for what, per_mm, limit, unit in rates:
        worst = int(np.argmax(per_mm))
        fastest = speed * float(per_mm[worst])
        if fastest > limit:
            slower = math.floor(100 * limit / float(per_mm[worst])) / 100
            raise PlanError(
                f"at depth {depth[worst]:.1f} mm {what} would be too fast",
                value=round(fastest, 4),
                bound=f"at most {limit:g} {unit}",
                remedy=f"set workflow.speed_mm_per_s to {slower:g} or less",
            )
