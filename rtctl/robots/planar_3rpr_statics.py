"""Torques, stiffness, wire tensions and accuracy of the planar 3RPR (01 section 1.1); not for the tick.

`robot` is the record of :mod:`rtctl.robots.planar_3rpr`, shape (1,); poses are (3,) (x mm, y mm, phi rad) in {B},
wrenches (3,) (f_x N, f_y N, m_z N mm) at the gripper tip in {B}.
"""

import numpy as np
from numpy.typing import ArrayLike

from hal.kernel import kernel
from rtctl.robots import planar_3rpr


def wire_jacobian(robot: np.ndarray, pose: ArrayLike) -> np.ndarray:
    """J_u (3, 3), wire lengths against the pose [1, 1, mm/rad]."""
    matrix = np.empty((3, 3))
    _wire_jacobian(robot, np.asarray(pose, dtype=float), matrix)
    return matrix


def wire_forces(robot: np.ndarray, pose: ArrayLike, wrench: ArrayLike) -> np.ndarray:
    """tau_u = J_u^-T w (3,) [N]: the net wire forces that belong to `wrench`."""
    return np.linalg.solve(wire_jacobian(robot, pose).T, np.asarray(wrench, dtype=float))


def motor_torques(robot: np.ndarray, pose: ArrayLike, wrench: ArrayLike) -> np.ndarray:
    """tau_theta = J_theta^-T w (3,) [N mm], at the screw: J_theta = J_u / eta."""
    return robot["eta_mm_per_rad"][0] * wire_forces(robot, pose, wrench)


def error_box(robot: np.ndarray, pose: ArrayLike, motor_error_rad: float) -> np.ndarray:
    """Largest pose errors (3,) [mm, mm, rad] when every motor angle is off by at most `motor_error_rad`."""
    motor_jacobian = wire_jacobian(robot, pose) / robot["eta_mm_per_rad"][0][:, None]
    return motor_error_rad * np.abs(np.linalg.inv(motor_jacobian)).sum(axis=1)


def passive_stiffness(robot: np.ndarray, pose: ArrayLike, wire_stiffness_n_per_mm: ArrayLike) -> np.ndarray:
    """K_p of (III.26), (3, 3) [N/mm, N, N mm/rad]; wire stiffness (3,): EA/h_1 + EA/h_2 while both segments pull."""
    j = wire_jacobian(robot, pose)
    return j.T @ (np.asarray(wire_stiffness_n_per_mm, dtype=float)[:, None] * j)


def active_stiffness(robot: np.ndarray, pose: ArrayLike, wrench: ArrayLike) -> np.ndarray:
    """K_a of (III.26), (3, 3) [N/mm, N, N mm/rad]: sum of tau_u,i times the Hessian of u_i over the pose."""
    forces = wire_forces(robot, pose, wrench)
    return np.sum([forces[i] * _wire_hessian(robot[0], i, np.asarray(pose, dtype=float)) for i in range(3)], axis=0)


@kernel
def segment_tensions(stretch_mm, pretension_n, stiffness_1, stiffness_2):
    """Tensions [N] of the two segments of a wire loop, and its stiffness [N/mm]; a slack segment has none.

    `stretch_mm` is delta = (change of q) - r (change of psi) against the motor; positive tightens segment 1.
    """
    tension_1 = max(0.0, pretension_n + stiffness_1 * stretch_mm)
    tension_2 = max(0.0, pretension_n - stiffness_2 * stretch_mm)
    stiffness = 0.0
    if tension_1 > 0.0:
        stiffness += stiffness_1
    if tension_2 > 0.0:
        stiffness += stiffness_2
    return tension_1, tension_2, stiffness


@kernel
def _wire_jacobian(robot, pose, matrix):
    planar_3rpr.wire_jacobian(robot[0], pose, matrix)


def _wire_hessian(robot: np.void, i: int, pose: np.ndarray) -> np.ndarray:
    """Second derivatives (3, 3) of u_i = q_i - r_i psi_i over the pose.

    psi = bearing of d + beta(q), so u = f(|d|) - r bearing(d) with f = q - r beta. Differentiate in the plane of d
    (radial unit vector n, tangential t), then carry over to the pose: d moves with the tip and turns with e.
    """
    a, sine = robot["a_mm"][i], robot["alpha_sin"][i]
    r = robot["pulley_radius_mm"][i]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    e = np.array([[c, -s], [s, c]]) @ robot["platform_mm"][i]
    d = pose[:2] + e - robot["base_mm"][i]
    length = np.hypot(*d)
    n = d / length
    t = np.array([-n[1], n[0]])

    ds = np.sqrt(length**2 - (a * sine) ** 2)  # d^T s, also q - a cos(alpha)
    q_1, q_2 = length / ds, 1 / ds - length**2 / ds**3  # dq/d|d|, d2q/d|d|2
    beta_1, beta_2 = a * sine / length**2, -2 * a * sine * ds / length**4  # dbeta/dq, d2beta/dq2
    f_1 = q_1 * (1 - r * beta_1)
    f_2 = q_2 * (1 - r * beta_1) - r * q_1**2 * beta_2

    gradient = f_1 * n - r / length * t
    bearing = -(np.outer(n, t) + np.outer(t, n)) / length**2
    hessian = f_2 * np.outer(n, n) + f_1 / length * np.outer(t, t) - r * bearing
    motion = np.array([[1.0, 0.0, -e[1]], [0.0, 1.0, e[0]]])
    result = motion.T @ hessian @ motion
    result[2, 2] -= gradient @ e
    return result
