"""Where the specimen really is: walls of the scala, entry, lips and facial recess in {B}, as tables and circles.

The modiolar wall is the lateral wall moved inwards by the width of the scala, so one foot point on the lateral wall
tells the distance to both. The kink of the template at 100 deg is smoothed over half a millimetre. A patient's
cochlea is the template scaled about the entry by A (02 section 1).
"""

import math

import numpy as np

from hal.kernel import kernel
from rtctl.electrode import cochlea
from sim_backends.plant.options import Anatomy, Phantom
from sim_backends.plant.rod.state import POSTS

ARC_STEP_MM = 0.1
LAST_DEG = 700.0
WALL_POINTS = 290
_MEAN = np.full(5, 0.2)
SMOOTHING = 2 * np.pad(_MEAN, 2) - np.convolve(_MEAN, _MEAN)
"""Rounds off a kink and leaves circles where they are."""
ACCESS_RAD = math.radians(12.0)
"""The facial recess is looked through so far beside the insertion direction: the gripper's mean orientation (02 section 5)."""
RECESS_RADIUS_MM = 0.5
"""Rounding of the bone at the recess."""
LEFT_LIP, RIGHT_LIP, LEFT_RECESS, RIGHT_RECESS = range(POSTS)

SCALA = np.dtype(
    [
        ("entry_mm", "f8", (2,)),
        ("axis", "f8", (2,)),  # unit vector into the bone
        ("hole_radius_mm", "f8"),
        ("lip_radius_mm", "f8"),
        ("stiffness_n_per_mm2", "f8"),
        ("friction", "f8"),
        ("friction_static", "f8"),
        ("stribeck_mm_per_s", "f8"),
        ("viscous_n_s_per_mm2", "f8"),
        ("floor_load_n_per_mm", "f8"),
        ("out_of_plane_mm", "f8"),
        ("height_mm", "f8"),  # of the scala behind the entry
        ("entry_arc_mm", "f8"),
        ("arc_step_mm", "f8"),
        ("post_mm", "f8", (POSTS, 2)),
        ("post_radius_mm", "f8", (POSTS,)),
        ("post_normal", "f8", (POSTS, 2)),  # from the post towards where the array may be
        ("wall", "f8", (WALL_POINTS - 1, 4, 3)),  # cubics in arc length for x, y and width, one set for every step
    ],
    align=True,
)
"""Lateral wall at every `arc_step_mm` of its length from 10.3 deg on, and the width of the scala there."""


def pack(anatomy: Anatomy, tissue: Phantom, record: np.ndarray) -> None:
    """Fill a SCALA record."""
    path = cochlea.insertion_path()
    turn = anatomy.insertion_angle_rad - path.direction_rad
    scale = anatomy.spiral_a_mm / cochlea.SPIRAL_A_MM
    rotation = scale * np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    entry = np.array(anatomy.entry_in_base_mm)

    angles = np.arange(cochlea.FIRST_DEG, LAST_DEG, 0.1)
    wall = cochlea.lateral_wall(angles)
    arc = cochlea.arc_length_mm(wall)
    grid = ARC_STEP_MM * np.arange(WALL_POINTS)
    if arc[-1] < grid[-1]:
        raise ValueError(f"the wall ends at {arc[-1]:.1f} mm, the table at {grid[-1]:.1f} mm")
    in_cochlea = np.stack([np.interp(grid, arc, wall[:, k]) for k in (0, 1)], axis=1)
    in_base = (in_cochlea - cochlea.insertion_point()) @ rotation.T + entry
    width = scale * cochlea.width_mm(np.interp(grid, arc, angles))
    put_walls(record, in_base, width, scale * ARC_STEP_MM)

    record["entry_arc_mm"] = scale * np.interp(cochlea.COCHLEOSTOMY_DEG, angles, arc)
    record["height_mm"] = scale * float(cochlea.height_mm(cochlea.COCHLEOSTOMY_DEG))
    record["out_of_plane_mm"] = anatomy.out_of_plane_mm
    record["entry_mm"] = entry
    record["axis"] = axis = np.array([math.cos(anatomy.insertion_angle_rad), math.sin(anatomy.insertion_angle_rad)])
    record["hole_radius_mm"], record["lip_radius_mm"] = anatomy.hole_radius_mm, anatomy.lip_radius_mm
    put_tissue(record, tissue)
    _put_posts(record, anatomy, entry, axis)


def put_walls(record: np.ndarray, lateral_mm: np.ndarray, width_mm: np.ndarray, arc_step_mm: float) -> None:
    """A channel from points (WALL_POINTS, 2) of its right wall in {B}, `arc_step_mm` apart, and its widths."""
    table = np.column_stack((lateral_mm, width_mm))
    table[4:-4, :2] = np.stack([np.convolve(p, SMOOTHING, mode="valid") for p in lateral_mm.T], axis=1)
    slope = np.gradient(table, arc_step_mm, axis=0)
    chord = np.diff(table, axis=0) / arc_step_mm
    record["arc_step_mm"] = arc_step_mm
    wall = record["wall"]
    wall[:, 0], wall[:, 1] = table[:-1], slope[:-1]
    wall[:, 2] = (3 * chord - 2 * slope[:-1] - slope[1:]) / arc_step_mm
    wall[:, 3] = (slope[:-1] + slope[1:] - 2 * chord) / arc_step_mm**2


def put_tissue(record: np.ndarray, tissue: Phantom) -> None:
    """Stiffness and friction of the specimen."""
    record["stiffness_n_per_mm2"] = tissue.wall_stiffness_n_per_mm2
    for name in ("friction", "friction_static", "stribeck_mm_per_s", "viscous_n_s_per_mm2", "floor_load_n_per_mm"):
        record[name] = getattr(tissue, name)


def _put_posts(record: np.ndarray, anatomy: Anatomy, entry: np.ndarray, axis: np.ndarray) -> None:
    """Lips of the hole, tangent to its bore and to the face; sides of the recess where its cone is 2 mm wide."""
    left = np.array([-axis[1], axis[0]])
    aside = anatomy.hole_radius_mm + anatomy.lip_radius_mm
    bearing = anatomy.insertion_angle_rad - ACCESS_RAD
    access = np.array([math.cos(bearing), math.sin(bearing)])
    access_left = np.array([-access[1], access[0]])
    window = entry - access * anatomy.recess_clearance_mm / math.tan(anatomy.recess_angle_rad)
    reach = anatomy.recess_clearance_mm + RECESS_RADIUS_MM
    for post, side in ((LEFT_LIP, 1.0), (RIGHT_LIP, -1.0)):
        record["post_mm"][post] = entry + anatomy.lip_radius_mm * axis + side * aside * left
        record["post_radius_mm"][post], record["post_normal"][post] = anatomy.lip_radius_mm, -side * left
    for post, side in ((LEFT_RECESS, 1.0), (RIGHT_RECESS, -1.0)):
        record["post_mm"][post] = window + side * reach * access_left
        record["post_radius_mm"][post], record["post_normal"][post] = RECESS_RADIUS_MM, -side * access_left


@kernel
def wall_at(scala, arc_mm):
    """Lateral wall at an arc length: x, y [mm], tangent x, y, curvature [1/mm], width of the scala [mm], its slope."""
    i = int(min(max(arc_mm / scala.arc_step_mm, 0.0), WALL_POINTS - 2.0))
    s = min(max(arc_mm, 0.0), (WALL_POINTS - 1) * scala.arc_step_mm) - i * scala.arc_step_mm
    c = scala.wall[i]
    x = c[0, 0] + s * (c[1, 0] + s * (c[2, 0] + s * c[3, 0]))
    y = c[0, 1] + s * (c[1, 1] + s * (c[2, 1] + s * c[3, 1]))
    width = c[0, 2] + s * (c[1, 2] + s * (c[2, 2] + s * c[3, 2]))
    tx = c[1, 0] + s * (2.0 * c[2, 0] + s * 3.0 * c[3, 0])
    ty = c[1, 1] + s * (2.0 * c[2, 1] + s * 3.0 * c[3, 1])
    slope = c[1, 2] + s * (2.0 * c[2, 2] + s * 3.0 * c[3, 2])
    kx, ky = 2.0 * c[2, 0] + s * 6.0 * c[3, 0], 2.0 * c[2, 1] + s * 6.0 * c[3, 1]
    size = 1.0 / math.sqrt(tx * tx + ty * ty)
    curvature = (tx * ky - ty * kx) * size * size * size
    return x, y, tx * size, ty * size, curvature, width, slope * size
