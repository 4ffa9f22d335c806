"""How an insertion passes the facial recess (II.2): a cone from the entry outwards, about the gripper's mean orientation.

The cone is as wide as the recess at a distance of clearance / tan(angle) before the entry; there the bone is.
"""

import math

import numpy as np

from rtctl.electrode.array_shape import LENGTH_MM, shape_points

NODE_MM = 0.25
"""Distance along the array of the points that are looked at."""


def directions_rad(poses_in_base: np.ndarray, entry_pose_in_base: np.ndarray) -> np.ndarray:
    """Angles (n,) [rad] of the gripper at poses (n, 3) to the registered direction, that of the entry pose (3,)."""
    return poses_in_base[:, 2] - entry_pose_in_base[2]


def passages_rad(
    modal_matrix: np.ndarray,
    depth_mm: np.ndarray,
    poses_in_base: np.ndarray,
    stylet_mm: np.ndarray,
    entry_pose_in_base: np.ndarray,
    recess_mm: float,
) -> np.ndarray:
    """Angles (n,) [rad] under which the entry sees the array where it passes the recess, `recess_mm` before the entry.

    For depths, poses and withdrawals of n rows, of the array `modal_matrix` (4, 4) free of contact. Left of the
    registered direction is positive; NaN where the gripper itself has come to the recess.
    """
    return np.array(
        [
            _passage(modal_matrix, depth, pose, stylet, entry_pose_in_base, recess_mm)
            for depth, pose, stylet in zip(depth_mm, poses_in_base, stylet_mm, strict=True)
        ]
    )


def _passage(
    modal_matrix: np.ndarray, depth: float, pose: np.ndarray, stylet: float, entry: np.ndarray, recess_mm: float
) -> float:
    outside = max(LENGTH_MM - depth, NODE_MM)
    nodes = np.linspace(0.0, outside, max(2, math.ceil(outside / NODE_MM) + 1))
    points = np.empty((len(nodes), 2))
    shape_points(modal_matrix, stylet, nodes, points)
    points = pose[:2] - entry[:2] + points @ _turn(pose[2]).T
    along, aside = (points @ _turn(entry[2])).T  # in the frame of the entry: x into the bone
    before = along < -recess_mm
    if not before[0]:
        return math.nan
    (crossings,) = np.nonzero(before[:-1] != before[1:])
    if not len(crossings):
        return math.nan
    share = (-recess_mm - along[crossings]) / (along[crossings + 1] - along[crossings])
    offsets = aside[crossings] + share * (aside[crossings + 1] - aside[crossings])
    return math.atan2(float(offsets[np.argmax(np.abs(offsets))]), recess_mm)


def _turn(angle_rad: float) -> np.ndarray:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])
