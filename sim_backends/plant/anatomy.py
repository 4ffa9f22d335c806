"""Where the cochlea really is: entry hole, bone face and the walls of the scala tympani, as tables in {B}.

The modiolar wall is the lateral wall moved inwards by the width of the scala, so one foot point on the lateral wall
tells the distance to both. The kink of the template at 100 deg is smoothed over half a millimetre.
"""

import math

import numpy as np

from hal.kernel import kernel
from rtctl.electrode import cochlea
from sim_backends.plant.options import Anatomy

ARC_STEP_MM = 0.1
LAST_DEG = 700.0
WALL_POINTS = 290

ANATOMY = np.dtype(
    [
        ("entry_mm", "f8", (2,)),
        ("axis", "f8", (2,)),  # unit vector into the bone
        ("hole_radius_mm", "f8"),
        ("stiffness_n_per_mm", "f8"),
        ("friction", "f8"),
        ("friction_travel_mm", "f8"),
        ("drag_n_per_mm", "f8"),
        ("entry_arc_mm", "f8"),
        ("x_mm", "f8", (WALL_POINTS,)),
        ("y_mm", "f8", (WALL_POINTS,)),
        ("tangent", "f8", (WALL_POINTS, 2)),
        ("curvature_per_mm", "f8", (WALL_POINTS,)),
        ("width_mm", "f8", (WALL_POINTS,)),
    ],
    align=True,
)
"""Lateral wall at every `ARC_STEP_MM` of its length from 10.3 deg on, and the width of the scala there."""


def pack(options: Anatomy, record: np.ndarray) -> None:
    """Fill an ANATOMY record from its options."""
    path = cochlea.insertion_path()
    turn = options.insertion_angle_rad - path.direction_rad
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    entry = np.array(options.entry_in_base_mm)

    angles = np.arange(cochlea.FIRST_DEG, LAST_DEG, 0.1)
    wall = cochlea.lateral_wall(angles)
    arc = cochlea.arc_length_mm(wall)
    grid = ARC_STEP_MM * np.arange(WALL_POINTS)
    if arc[-1] < grid[-1]:
        raise ValueError(f"the wall ends at {arc[-1]:.1f} mm, the table at {grid[-1]:.1f} mm")
    in_cochlea = np.stack([np.interp(grid, arc, wall[:, k]) for k in (0, 1)], axis=1)
    in_base = (in_cochlea - cochlea.insertion_point()) @ rotation.T + entry
    bearing = np.unwrap(np.arctan2(*np.gradient(in_base, axis=0).T[::-1]))
    bearing[2:-2] = np.convolve(bearing, np.full(5, 0.2), mode="valid")

    record["entry_mm"] = entry
    record["axis"] = math.cos(options.insertion_angle_rad), math.sin(options.insertion_angle_rad)
    record["hole_radius_mm"] = options.hole_radius_mm
    record["stiffness_n_per_mm"] = 3.0
    record["friction"] = 0.15
    record["friction_travel_mm"] = 0.1
    record["drag_n_per_mm"] = 0.01
    record["entry_arc_mm"] = np.interp(cochlea.COCHLEOSTOMY_DEG, angles, arc)
    record["x_mm"], record["y_mm"] = in_base.T
    record["tangent"] = np.stack((np.cos(bearing), np.sin(bearing)), axis=1)
    record["curvature_per_mm"] = np.gradient(bearing, ARC_STEP_MM)
    record["width_mm"] = cochlea.width_mm(np.interp(grid, arc, angles))


@kernel
def wall_at(anatomy, arc_mm):
    """Lateral wall at an arc length: x, y [mm], tangent x, y, curvature [1/mm], width of the scala [mm]."""
    place = min(max(arc_mm / ARC_STEP_MM, 0.0), WALL_POINTS - 1.001)
    i = int(place)
    t = place - i
    u = 1.0 - t
    return (
        u * anatomy.x_mm[i] + t * anatomy.x_mm[i + 1],
        u * anatomy.y_mm[i] + t * anatomy.y_mm[i + 1],
        u * anatomy.tangent[i, 0] + t * anatomy.tangent[i + 1, 0],
        u * anatomy.tangent[i, 1] + t * anatomy.tangent[i + 1, 1],
        anatomy.curvature_per_mm[i],
        u * anatomy.width_mm[i] + t * anatomy.width_mm[i + 1],
    )
