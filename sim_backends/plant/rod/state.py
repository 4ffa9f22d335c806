"""The record of the rod: parameters of the array, its nodes, and what its material remembers.

Nodes 0 .. n are joined by n edges of equal length l. The gripper holds the first edge, and its tip is that edge's
middle, for a clamp acts in the middle of the edge it holds: arc lengths are counted from there, joint i lies at
(i - 1/2) l and the tip at (n - 1/2) l = L.

The line of nodes is the modiolar edge of the array, which is what shape models and plans describe (D section II.3);
the array's body lies on its right, as wide as its diameter.
"""

import numpy as np

from sim_backends.plant.options import Array

MAX_NODES = 81
POSTS = 4
"""Round edges that segments can touch: two lips of the entry, two sides of the facial recess."""
BASE_MM = 15.0
"""Distance from the tip at which the properties "at the base" hold."""

ROD = np.dtype(
    [
        # parameters
        ("segments", "i8"),
        ("edge_mm", "f8"),
        ("grip_angle_rad", "f8"),
        ("stretch_n_per_mm", "f8"),  # EA / l
        ("relaxation_s", "f8"),
        ("drag_n_s_per_mm", "f8"),
        ("stylet_nmm2", "f8"),
        ("soft_tip_mm", "f8"),
        ("blend_mm", "f8"),
        ("stylet_offset_mm", "f8"),
        ("stylet_yield_per_mm", "f8"),
        ("array_yield_per_mm", "f8"),
        ("array_nmm2", "f8", (MAX_NODES,)),  # of joint i
        ("rest_per_mm", "f8", (MAX_NODES,)),
        ("radius_mm", "f8", (MAX_NODES,)),  # of node i
        # material memory
        ("stylet_set_per_mm", "f8", (MAX_NODES,)),
        ("array_set_per_mm", "f8", (MAX_NODES,)),
        # joints with the stylet where it is now
        ("bending_nmm2", "f8", (MAX_NODES,)),
        ("rest_turn_rad", "f8", (MAX_NODES,)),
        ("stylet_mm", "f8"),
        # nodes
        ("node_mm", "f8", (MAX_NODES, 2)),  # in {B}
        ("before_mm", "f8", (MAX_NODES, 2)),  # at the start of the step
        ("pace_mm", "f8", (MAX_NODES, 2)),  # what they moved in the step before, per full step
        ("turn_rad", "f8", (MAX_NODES,)),  # of joints, at the start of the step
        ("turning_rad", "f8", (MAX_NODES,)),  # where gradient and band are taken
        ("normal", "f8", (MAX_NODES, 2)),  # left of the line, at the start of the step
        ("pose", "f8", (3,)),
        # contacts
        ("floor_friction", "f8"),  # of floor and lid in this step, at the speed of the gripper in the last
        ("inside_from", "i8"),  # first node beyond the entry, segments + 1 for none
        ("modiolar_gap_mm", "f8", (MAX_NODES,)),  # from the modiolar edge to the wall, of nodes inside
        ("foot_mm", "f8", (MAX_NODES,)),  # arc length of the node's foot on the lateral wall
        ("foot_before_mm", "f8", (MAX_NODES,)),  # the same at the start of the step
        ("free_mm", "f8", (MAX_NODES,)),  # from the nearer wall, of a node that looked in this step; else negative
        ("clear_mm", "f8", (MAX_NODES,)),  # node i can move so far and touch no wall
        ("grip_n", "f8", (MAX_NODES,)),  # friction node i may take: mu N of the step before
        ("press_n", "f8", (MAX_NODES,)),  # normal force of node i in this one
        ("tangent", "f8", (MAX_NODES, 2)),  # along which it rubs
        ("touch_tangent", "f8", (MAX_NODES, 2)),  # of what it touches in this step
        ("force_n", "f8", (MAX_NODES, 2)),  # of everything around on node i
        ("post_edge", "i8", (POSTS,)),  # edge nearest to the post
        ("post_side", "i8", (POSTS,)),  # left (1) or right (-1) of the line, where it stays; 0: beyond the tip
        ("post_met", "u1", (POSTS,)),  # it has lain on the right side of the post, which counts from then on
        ("post_grip_n", "f8", (POSTS,)),
        ("post_reach_mm", "f8", (POSTS,)),  # radius of post and array together, the same all through a step
        ("post_share", "f8", (POSTS,)),  # of its stiffness: none where the gripper is
        ("post_press_n", "f8", (POSTS,)),
        ("post_rub", "f8", (POSTS, 4)),  # where it rubs: edge, share of it, tangent
        ("self_from", "i8"),  # first node of a folded tip that can touch the shaft
        ("self_edge", "i8", (MAX_NODES,)),  # the edge of the shaft that node i lies against, 0 for none
        ("self_at", "f8", (MAX_NODES, 4)),  # share of that edge, normal from it to the node, overlap before the step
        ("modiolar_n", "f8"),
        ("lateral_n", "f8"),
        ("face_n", "f8"),
        ("self_n", "f8"),
        # work space of the solver: rows from the tip to the gripper
        ("band", "f8", (2 * MAX_NODES + 1, 6)),
        ("gradient", "f8", (2 * MAX_NODES + 1,)),
        ("move_mm", "f8", (2 * MAX_NODES + 1,)),  # the last Newton step, in the order of the rows
        ("energy_nmm", "f8"),
        # what comes out
        ("wrench", "f8", (3,)),  # (f_x, f_y, m_z) on the gripper in {B}, about its tip
        ("stiffness", "f8", (6,)),  # upper triangle of -d wrench / d pose [N/mm, N, N mm], damping included
        ("lift_n", "f8"),  # out of the plane, on the gripper
        ("depth_mm", "f8"),
        ("set_per_mm", "f8"),  # largest permanent curvature
        ("iterations", "i8"),  # in this tick
        ("retries", "i8"),  # steps so far that did not converge and were cut up
        ("failed", "u1"),  # the last step did not converge however small it was made
        ("placed", "u1"),
        ("folded", "u1"),
        ("buckled", "u1"),
    ],
    align=True,
)


def pack(options: Array, record: np.ndarray) -> None:
    """Fill a ROD record from its options; nothing is in the gripper yet."""
    n = options.segments
    edge = options.length_mm / (n - 0.5)
    record["segments"], record["edge_mm"] = n, edge
    record["stretch_n_per_mm"] = options.axial_stiffness_n / edge
    record["stylet_nmm2"] = options.stylet_bending_nmm2
    record["blend_mm"] = options.stylet_blend_mm
    for name in (
        "grip_angle_rad", "relaxation_s", "drag_n_s_per_mm", "soft_tip_mm", "stylet_offset_mm", "stylet_yield_per_mm",
        "array_yield_per_mm",
    ):  # fmt: skip
        record[name] = getattr(options, name)
    from_tip = options.length_mm - (np.arange(MAX_NODES) - 0.5) * edge
    record["array_nmm2"] = array_bending(options, from_tip)
    record["rest_per_mm"] = rest_curvature(options, from_tip)
    share = np.clip(from_tip / BASE_MM, 0.0, 1.0)
    diameter = options.tip_diameter_mm + (options.base_diameter_mm - options.tip_diameter_mm) * share
    record["radius_mm"] = diameter / 2
    record["inside_from"] = n + 1


def array_bending(options: Array, from_tip_mm: np.ndarray) -> np.ndarray:
    """Bending stiffness (k,) [N mm^2] without stylet, at distances (k,) from the tip."""
    share = np.clip(from_tip_mm / BASE_MM, 0.0, None)
    return options.bending_tip_nmm2 + (options.bending_base_nmm2 - options.bending_tip_nmm2) * share


def rest_curvature(options: Array, from_tip_mm: np.ndarray) -> np.ndarray:
    """Curvature (k,) [1/mm] of the released array, at distances (k,) from the tip."""
    base, tip = options.curvature_base_per_mm, options.curvature_tip_per_mm
    share = np.clip(1.0 - from_tip_mm / BASE_MM, 0.0, 1.0)
    return (1.0 + options.curvature_error) * (base + (tip - base) * share**2)
