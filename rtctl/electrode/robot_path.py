"""From an insertion plan in the cochlea {C} to a path of the gripper in the robot base {B} (spec 02 section 5)."""

import math

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from hal.errors import RtctlError
from rtctl.electrode.array_shape import STYLET_MAX_MM
from rtctl.electrode.path import MAX_CHANNELS, MAX_KNOTS, PATH
from rtctl.electrode.patient import TEMPLATE, Cochlea
from rtctl.electrode.planning import APPROACH_RAD, Plan


def robot_path(plan: Plan, entry_pose_in_base: np.ndarray, number: int) -> np.ndarray:
    """The path (1,) of dtype PATH that a planar robot follows to carry out `plan`.

    Args:
        entry_pose_in_base: registered entry (3,): x, y [mm] of the cochleostomy's centre p_c in {B}, and the gripper's
            angle [rad] in {B} when it has its mean orientation phi_C in {C}.
        number: number of the plan, for the records.
    """
    turn = entry_pose_in_base[2] - APPROACH_RAD
    axis = plan.cochlea.path().direction_rad + turn
    return pack(
        plan.depth_mm,
        poses_in_base(plan.pose_in_cochlea, entry_pose_in_base, plan.cochlea),
        plan.stylet_mm,
        entry_in_base=np.array([entry_pose_in_base[0], entry_pose_in_base[1], 0.0]),
        insertion_axis_in_base=np.array([math.cos(axis), math.sin(axis), 0.0]),
        number=number,
    )


def poses_in_base(
    poses_in_cochlea: np.ndarray, entry_pose_in_base: np.ndarray, cochlea: Cochlea = TEMPLATE
) -> np.ndarray:
    """Gripper poses (n, 3) in {B} from those in {C}: p_B = p_entry + R(phi_entry - phi_C) (p_C - p_c).

    `cochlea` tells where its p_c is.
    """
    turn = entry_pose_in_base[2] - APPROACH_RAD
    c, s = math.cos(turn), math.sin(turn)
    offset = poses_in_cochlea[:, :2] - cochlea.insertion_point()
    place = entry_pose_in_base[:2] + offset @ np.array([[c, s], [-s, c]])
    return np.column_stack((place, poses_in_cochlea[:, 2] + turn))


def pack(
    depth_mm: np.ndarray,
    pose_in_base: np.ndarray,
    stylet_mm: np.ndarray,
    *,
    entry_in_base: np.ndarray,
    insertion_axis_in_base: np.ndarray,
    number: int,
) -> np.ndarray:
    """Splines through n depths as one record (1,) of dtype PATH.

    The pose (n, dof) gets twice continuously differentiable cubics (not-a-knot), the stylet (n,) shape-preserving ones,
    so that it never goes back in between the knots.

    Raises:
        RtctlError: more knots or channels than the record holds, or fewer than four knots.
    """
    knots, dof = pose_in_base.shape
    if not 4 <= knots <= MAX_KNOTS:
        raise RtctlError("cannot pack the path: wrong number of depths", value=knots, bound=f"4 .. {MAX_KNOTS}")
    if dof >= MAX_CHANNELS:
        raise RtctlError("cannot pack the path: too many coordinates", value=dof, bound=f"at most {MAX_CHANNELS - 1}")
    path = np.zeros(1, PATH)
    record = path[0]
    record["number"], record["intervals"], record["channels"] = number, knots - 1, dof + 1
    record["depth_mm"][:knots] = depth_mm
    pose = CubicSpline(depth_mm, pose_in_base, bc_type="not-a-knot").c
    stylet = PchipInterpolator(depth_mm, np.clip(stylet_mm, 0.0, STYLET_MAX_MM)).c
    record["coefficient"][: knots - 1, :dof] = pose.transpose(1, 2, 0)
    record["coefficient"][: knots - 1, dof] = stylet.T
    record["entry_in_base"], record["insertion_axis_in_base"] = entry_in_base, insertion_axis_in_base
    return path
