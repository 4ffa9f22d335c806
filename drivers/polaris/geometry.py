"""Rigid transforms of tracked poses: unit quaternions (w, x, y, z), positions in mm."""

import numpy as np

from drivers.polaris.protocol import Pose


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) of a unit quaternion (4,)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def transform(quaternion: np.ndarray, position_mm: np.ndarray) -> np.ndarray:
    """The homogeneous matrix (4, 4); the quaternion is normalised."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(np.asarray(quaternion) / np.linalg.norm(quaternion))
    matrix[:3, 3] = position_mm
    return matrix


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The quaternion (4,) of first q, then p."""
    w, v = p[0], p[1:]
    return np.array([w * q[0] - v @ q[1:], *(w * q[1:] + q[0] * v + np.cross(v, q[1:]))])


def relative(tool: Pose, reference: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Quaternion and position [mm] of `tool` in the frame of `reference`."""
    back = np.array(reference.quaternion) * (1, -1, -1, -1)
    offset = np.array(tool.position_mm) - np.array(reference.position_mm)
    return product(back, np.array(tool.quaternion)), rotation(back) @ offset


def mean_quaternion(quaternions: np.ndarray) -> np.ndarray:
    """The mean (4,) of nearly equal unit quaternions (n, 4), whatever their signs."""
    signs = np.where(quaternions @ quaternions[0] < 0, -1.0, 1.0)
    mean = (signs[:, None] * quaternions).sum(axis=0)
    return mean / np.linalg.norm(mean)
