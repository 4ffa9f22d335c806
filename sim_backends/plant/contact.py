"""What the electrode array does to the gripper: wrench from gripper pose, stylet and the array's own memory.

This stands in for an elastic rod. The array keeps the free shape its stylet withdrawal gives it and is laid over the
anatomy; where a node would be inside bone it is pushed back by two springs in series, the tissue and the array's own
resistance against being bent aside, which yields when the deflection grows large. Entry lips press on the shaft, whose
resistance is that of a cantilever from the gripper, 3 B / L^3, and so grows as the free length shortens. What it cannot
show is everything the deflected shape decides: buckling, tip folding, and the sharing of load between contacts.

The insertion path of the planner lies on the modiolar wall itself, so the centre line touches that wall; the lateral
wall and the lips touch the array's surface.
"""

import math

import numpy as np

from hal.kernel import kernel
from rtctl.electrode.array_shape import LENGTH_MM, STYLET_MAX_MM
from rtctl.electrode.synthetic_arrays import SYNTHETIC_ARRAYS
from sim_backends.plant.anatomy import wall_at
from sim_backends.plant.options import Array

NODES = 37
NODE_STEP_MM = LENGTH_MM / (NODES - 1)
STYLET_STEP_MM = 0.25
SHAPES = int(STYLET_MAX_MM / STYLET_STEP_MM) + 1
FOOT_WINDOW_MM = 2.5
"""A node's foot on the wall lies at most so far beyond its neighbour's: it can never jump to the next turn, 7 mm on."""
FOOT_STEPS, FOOT_TOLERANCE_MM = 4, 0.001
"""A node that has just come in takes a few Newton steps to find its foot, later one a tick follows it."""
FOOT_PACE_MM = 0.25
"""A foot moves at most so far in a tick, many times as fast as an array is ever moved."""
FOOT_UNIQUE = 0.8
"""Nearer to the wall's centre of curvature than this share of its radius a node keeps the foot it has."""
ENTRY_MARGIN_MM = 1.0
"""Feet of the first nodes may lie so far before that of the entry itself, which is wide and oblique."""
FIND_MM = 1.0
"""The tip finds the hole while no more than this is below the surface; later it can only be pulled out again."""

ARRAY = np.dtype(
    [
        ("shaft_bending_nmm2", "f8"),
        ("yield_mm", "f8"),
        ("node_n_per_mm", "f8", (NODES,)),
        ("radius_mm", "f8", (NODES,)),
        ("free_shape_mm", "f8", (SHAPES, NODES, 2)),
        ("node_mm", "f8", (NODES, 2)),  # in {B}
        ("foot_mm", "f8", (NODES,)),  # arc length on the lateral wall
        ("bristle_mm", "f8", (NODES, 2)),  # how far friction holds a node back
        ("stiffness", "f8", (6,)),  # upper triangle of -d wrench / d pose [N/mm, N, N mm]
        ("depth_mm", "f8"),
        ("contacts", "i4"),
        ("placed", "u1"),  # the nodes of the last tick are known
        ("in_hole", "u1"),
        ("wall_contact", "u1"),
        ("lip_contact", "u1"),
        ("face_contact", "u1"),
    ],
    align=True,
)
"""Parameters, then state. Node 0 is at the gripper, the last one is the tip."""


def pack(options: Array, record: np.ndarray) -> None:
    """Fill an ARRAY record from its options."""
    share = np.linspace(0.0, 1.0, NODES)
    record["shaft_bending_nmm2"] = 3.0
    record["yield_mm"] = 1.5
    record["node_n_per_mm"] = np.interp(
        share, (0, 1), (0.05, 0.015)
    )
    record["radius_mm"] = np.interp(share, (0, 1), (0.4, 0.25))
    record["free_shape_mm"] = free_shapes(options)


def free_shapes(options: Array) -> np.ndarray:
    """Nodes (SHAPES, NODES, 2) [mm] of the array in the gripper's frame, one shape per stylet step."""
    fine = 20
    s = np.linspace(0.0, LENGTH_MM, fine * (NODES - 1) + 1)
    angle = SYNTHETIC_ARRAYS[0].angle_rad(s, STYLET_STEP_MM * np.arange(SHAPES))
    angle = options.grip_angle_rad + (1.0 + options.curvature_error) * angle
    slope = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    steps = (slope[1:] + slope[:-1]) / 2 * (s[1] - s[0])
    points = np.concatenate((np.zeros((1, SHAPES, 2)), np.cumsum(steps, axis=0)))
    return np.swapaxes(points[::fine], 0, 1)


@kernel
def lift(array):
    """Take the array out of the gripper: nothing touches anything."""
    array.placed = array.in_hole = 0
    array.wall_contact = array.lip_contact = array.face_contact = 0
    array.contacts, array.depth_mm = 0, 0.0
    for i in range(NODES):
        array.bristle_mm[i, 0] = array.bristle_mm[i, 1] = 0.0
    for k in range(6):
        array.stiffness[k] = 0.0


@kernel
def array_wrench(array, anatomy, pose, stylet_mm, wrench):
    """Wrench (f_x, f_y, m_z) [N, N mm] of the array on the gripper in {B}, about the gripper tip, into `wrench`.

    pose: gripper (x mm, y mm, phi rad) in {B}; the array starts at its tip, along its x axis. stylet_mm: withdrawal.
    `array.stiffness` becomes how fast the wrench changes with the pose.
    """
    wrench[0] = wrench[1] = wrench[2] = 0.0
    for k in range(6):
        array.stiffness[k] = 0.0
    array.contacts = 0
    array.wall_contact = array.lip_contact = array.face_contact = 0
    ex, ey, ax, ay = anatomy.entry_mm[0], anatomy.entry_mm[1], anatomy.axis[0], anatomy.axis[1]

    c, s = math.cos(pose[2]), math.sin(pose[2])
    place = min(stylet_mm / STYLET_STEP_MM, SHAPES - 1.001)
    row = int(place)
    t = place - row
    low, high = array.free_shape_mm[row], array.free_shape_mm[row + 1]

    array.depth_mm = 0.0
    before = 0.0  # depth of the node before, and whether the array has gone below the surface of the bone
    below = False
    foot = anatomy.entry_arc_mm - ENTRY_MARGIN_MM
    for i in range(NODES):
        lx, ly = low[i, 0] + t * (high[i, 0] - low[i, 0]), low[i, 1] + t * (high[i, 1] - low[i, 1])
        rx, ry = c * lx - s * ly, s * lx + c * ly
        x, y = pose[0] + rx, pose[1] + ry
        if array.placed:
            array.bristle_mm[i, 0] += x - array.node_mm[i, 0]
            array.bristle_mm[i, 1] += y - array.node_mm[i, 1]
        array.node_mm[i, 0], array.node_mm[i, 1] = x, y
        depth = (x - ex) * ax + (y - ey) * ay
        if not below and depth <= 0.0:
            array.foot_mm[i] = anatomy.entry_arc_mm
            array.bristle_mm[i, 0] = array.bristle_mm[i, 1] = 0.0
            before = depth
            continue
        normal = 0.0
        if not below:
            below = True
            share = before / (before - depth) if before < 0.0 else 0.0
            out = max((i - 1 + share) * NODE_STEP_MM, 1.0)
            array.depth_mm = LENGTH_MM - out
            aside = (y - ey) * ax - (x - ex) * ay
            if array.depth_mm < FIND_MM and abs(aside) < anatomy.hole_radius_mm:
                array.in_hole = 1
            if array.in_hole:
                normal += _lip(array, anatomy, i, out, rx, ry, aside, wrench)
        if array.in_hole:
            foot, force = _wall(array, anatomy, i, foot, x, y, rx, ry, wrench)
            normal += force
        else:
            array.face_contact = 1
            normal += _press(array, anatomy, i, depth, -ax, -ay, rx, ry, wrench)
        _rub(array, anatomy, i, normal, rx, ry, wrench)
    array.placed = 1
    if not below:
        array.in_hole = 0


@kernel
def _wall(array, anatomy, i, foot_before, x, y, rx, ry, wrench):
    """Contact of node i with either wall: arc length of its foot on the lateral wall, and the normal force."""
    last = array.foot_mm[i]
    foot = min(max(last, foot_before), foot_before + FOOT_WINDOW_MM)
    gap = width = tx = ty = 0.0
    for _ in range(FOOT_STEPS):
        wx, wy, tx, ty, curvature, width = wall_at(anatomy, foot)
        gap = (y - wy) * tx - (x - wx) * ty
        along = (x - wx) * tx + (y - wy) * ty
        if curvature * gap > FOOT_UNIQUE or abs(along) < FOOT_TOLERANCE_MM:
            break
        foot += along / (1.0 - curvature * gap)
        foot = min(max(foot, last - FOOT_PACE_MM), last + FOOT_PACE_MM)
        foot = min(max(foot, foot_before), foot_before + FOOT_WINDOW_MM)
    array.foot_mm[i] = foot
    force = 0.0
    if gap < array.radius_mm[i]:
        array.wall_contact = 1
        force = _press(array, anatomy, i, array.radius_mm[i] - gap, -ty, tx, rx, ry, wrench)
    elif gap > width:
        array.wall_contact = 1
        force = _press(array, anatomy, i, gap - width, ty, -tx, rx, ry, wrench)
    return foot, force


@kernel
def _lip(array, anatomy, i, out_mm, rx, ry, aside, wrench):
    """A lip of the hole presses on the shaft, which is held by the gripper `out_mm` away; the normal force."""
    depth = abs(aside) - (anatomy.hole_radius_mm - array.radius_mm[i])
    if depth <= 0.0:
        return 0.0
    array.lip_contact = 1
    side = -math.copysign(1.0, aside)
    shaft = 3.0 * array.shaft_bending_nmm2 / out_mm**3
    return _push(array, anatomy, shaft, depth, -anatomy.axis[1] * side, anatomy.axis[0] * side, rx, ry, wrench)


@kernel
def _press(array, anatomy, i, depth_mm, nx, ny, rx, ry, wrench):
    """Node i is pushed back along n from `depth_mm` inside a surface; the normal force."""
    return _push(array, anatomy, array.node_n_per_mm[i], depth_mm, nx, ny, rx, ry, wrench)


@kernel
def _push(array, anatomy, array_n_per_mm, depth_mm, nx, ny, rx, ry, wrench):
    """Tissue and array as springs in series, of which the array yields; the normal force along n at r from the tip."""
    array.contacts += 1
    stiffness = array_n_per_mm * anatomy.stiffness_n_per_mm / (array_n_per_mm + anatomy.stiffness_n_per_mm)
    force = stiffness * depth_mm / (1.0 + depth_mm / array.yield_mm)
    _add(wrench, force * nx, force * ny, rx, ry)
    _stiffen(array, stiffness, nx, ny, rx * ny - ry * nx)
    return force


@kernel
def _rub(array, anatomy, i, normal_n, rx, ry, wrench):
    """Friction of node i: a bristle that bends with the node up to a small travel, and slides beyond it.

    Unlike a law of speed it holds at rest, and it has a finite stiffness against a robot that gives way.
    """
    bx, by, travel = array.bristle_mm[i, 0], array.bristle_mm[i, 1], anatomy.friction_travel_mm
    bend = math.sqrt(bx * bx + by * by)
    if bend > travel:
        bx, by = bx * travel / bend, by * travel / bend
        array.bristle_mm[i, 0], array.bristle_mm[i, 1] = bx, by
    stiffness = (anatomy.drag_n_per_mm * NODE_STEP_MM + anatomy.friction * normal_n) / travel
    _add(wrench, -stiffness * bx, -stiffness * by, rx, ry)
    _stiffen(array, stiffness, 1.0, 0.0, -ry)
    _stiffen(array, stiffness, 0.0, 1.0, rx)


@kernel
def _add(wrench, fx, fy, rx, ry):
    """Add a force at r from the gripper tip."""
    wrench[0] += fx
    wrench[1] += fy
    wrench[2] += rx * fy - ry * fx


@kernel
def _stiffen(array, stiffness, nx, ny, lever):
    """Add a spring along n, with the lever of n about the gripper tip, to the stiffness (xx, xy, xp, yy, yp, pp)."""
    k = array.stiffness
    k[0] += stiffness * nx * nx
    k[1] += stiffness * nx * ny
    k[2] += stiffness * nx * lever
    k[3] += stiffness * ny * ny
    k[4] += stiffness * ny * lever
    k[5] += stiffness * lever * lever
