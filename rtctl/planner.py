"""From the registered entry to the path the tick follows: plan, place, pack, check.

Takes a third of a second; called by the gateway, by lockstep simulation and by scripts, never in the loop.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from hal.errors import RtctlError
from rtctl.electrode.path import evaluate_path
from rtctl.electrode.path_validation import validate_path
from rtctl.electrode.patient import Cochlea
from rtctl.electrode.planning import Plan, Progress, plan_insertion
from rtctl.electrode.recess import directions_rad, passages_rad
from rtctl.electrode.robot_path import robot_path
from rtctl.robots import Robot
from rtctl.settings import Settings

SAMPLE_MM = 0.1
"""Distance in depth of the poses that are checked."""
SWING_RAD = 0.025
"""A smooth path through depths at the bound of the gripper's direction swings beyond it in between: 0.16 mm at the recess."""


class PlanError(RtctlError):
    """There is no insertion plan the robot can carry out."""


def cochlea_of(settings: Settings) -> Cochlea:
    """The patient's cochlea as the settings describe it."""
    return Cochlea(settings.cochlea.spiral_a_mm, settings.cochlea.side)


def plan_of(settings: Settings, progress: Progress | None = None) -> Plan:
    """The insertion relative to the cochlea: it depends on the models of array and patient alone, so runs may share it."""
    return plan_insertion(
        np.array(settings.electrode.modal_matrix),
        progress,
        cochlea=cochlea_of(settings),
        window_rad=settings.cochlea.recess_angle_rad,
    )


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
        known: a plan for the same models, of :func:`plan_of` or of a file; computed if None.

    Raises:
        PlanError: the entry is not registered, `known` is for another array or cochlea, the path is too short for the
            depth of the workflow, leaves the robot's limits or the facial recess, or is too fast at the workflow's
            speed.
    """
    entry = np.asarray(pose_entry, dtype=float)
    if entry.shape != (robot.dof,) or not np.isfinite(entry).all():
        raise PlanError("the entry is not registered", remedy="move the gripper to the entry and run `rtctl register`")
    plan = plan_of(settings, progress) if known is None else known
    check_models(settings, plan)
    path = robot_path(plan, entry, number)
    validate_path(path, robot.dof)
    check_depth(settings, path)
    check_reach(settings, robot, path)
    check_recess(settings, path, entry)
    check_speed(settings, robot, path)
    return path


def check_models(settings: Settings, plan: Plan) -> None:
    """Raises PlanError if `plan` is for another array or another cochlea than those of the settings."""
    remedy = "make the plan anew with `rtctl plan make`, or use the settings it was made with"
    matrix, wanted = plan.modal_matrix, np.array(settings.electrode.modal_matrix)
    if not np.array_equal(matrix, wanted):
        row, column = np.unravel_index(np.argmax(matrix != wanted), matrix.shape)
        what = f"the plan is for another array: its modal matrix differs from electrode.modal_matrix in row {row}, column {column} (from 0)"
        raise PlanError(what, value=float(matrix[row, column]), bound=f"{float(wanted[row, column])!r}", remedy=remedy)
    for name in ("spiral_a_mm", "side"):
        value, bound = getattr(plan.cochlea, name), getattr(settings.cochlea, name)
        if value != bound:
            raise PlanError(
                "the plan is for another cochlea", value=value, bound=f"cochlea.{name} = {bound}", remedy=remedy
            )


def sample(path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths (n,) [mm] every 0.1 mm, the channels (n, dof + 1) there and their slopes by depth (n, dof + 1)."""
    record = path[0]
    end = float(record["depth_mm"][record["intervals"]])
    depth = np.append(np.arange(0.0, end, SAMPLE_MM), end)
    values, slopes = np.empty((2, len(depth), int(record["channels"])))
    for i, d in enumerate(depth):
        evaluate_path(record, d, values[i], slopes[i])
    return depth, values, slopes


def check_depth(settings: Settings, path: np.ndarray) -> None:
    """Raises PlanError if the path ends before the depth of the workflow."""
    end, wanted = float(path[0]["depth_mm"][path[0]["intervals"]]), settings.workflow.depth_mm
    if wanted > end:
        raise PlanError(
            "the plan ends before the insertion does: the cochlea is too small, its wall too tight beyond",
            value=wanted,
            bound=f"at most {end:g} mm with cochlea.spiral_a_mm = {settings.cochlea.spiral_a_mm:g}",
            remedy=f"set workflow.depth_mm to {end:g} or less",
        )


def check_reach(settings: Settings, robot: Robot, path: np.ndarray) -> None:
    """Raises PlanError at the first sampled pose of the path beyond the workspace, the joints or the stylet's stroke."""
    depth, values, _ = sample(path)
    stroke = settings.stylet.stroke_mm
    for d, channels in zip(depth, values, strict=True):
        problem = robot.explain(channels[:-1])
        if problem is not None:
            raise PlanError(
                f"at depth {d:.1f} mm the robot cannot follow the plan: {problem.what}",
                value=problem.value,
                bound=problem.bound,
                remedy="register an entry nearer to the middle of the workspace",
            )
        if channels[-1] > stroke + 1e-6:
            raise PlanError(
                f"at depth {d:.1f} mm the plan withdraws the stylet beyond its stroke",
                value=round(float(channels[-1]), 3),
                bound=f"at most stylet.stroke_mm = {stroke:g} mm",
                remedy="set stylet.stroke_mm if the drive can do more, or insert with another array",
            )


def check_recess(settings: Settings, path: np.ndarray, pose_entry: np.ndarray) -> None:
    """Raises PlanError where the gripper's direction or the array leaves the cone through the facial recess (II.2)."""
    depth, values, _ = sample(path)
    poses, patient = values[:, :-1], settings.cochlea
    angle = patient.recess_angle_rad
    matrix = np.array(settings.electrode.modal_matrix)
    recess_mm = patient.recess_clearance_mm / math.tan(angle)
    passages = passages_rad(matrix, depth, poses, values[:, -1], pose_entry, recess_mm)
    for what, angles, bound in (
        ("the gripper points", directions_rad(poses, pose_entry), angle + SWING_RAD),
        ("the array passes the facial recess", np.nan_to_num(passages), angle),
    ):
        worst = int(np.argmax(np.abs(angles)))
        if abs(angles[worst]) > bound:
            raise PlanError(
                f"at depth {depth[worst]:.1f} mm {what} too far beside the registered direction",
                value=round(float(angles[worst]), 4),
                bound=f"at most {bound:.4g} rad either way, from cochlea.recess_angle_rad",
                remedy="make the plan anew for this recess, correct cochlea.recess_angle_rad, or take another array",
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
