"""Motor torques that hold CochleRob against gravity (01 section 3.2).

The Delta's are those of the paper, (13)-(26) corrected: half of the rods' mass rides on the elbows, half on the
nacelle. The slider's is that of the exact centre of mass, where (27)-(35) leave out terms as large as the torque.
The arc turns about the vertical and has nothing to hold. Each is dV/d(motor angle) of the potential energy V.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from hal.kernel import kernel
from rtctl.robots.cochlerob import chain, nacelle

GRAVITY_M_PER_S2 = 9.81
NM_PER_N_MM = 1e-3


def gravity_torques(robot: np.ndarray, pose: ArrayLike) -> np.ndarray:
    """Torques (5,) [N m] the motors hold at rest at `pose` (5,); NaN for the Delta where it cannot be assembled.

    `robot` is the record of :mod:`rtctl.robots.cochlerob`, shape (1,).
    """
    torque = np.empty(5)
    _gravity(robot, np.asarray(pose, dtype=float), torque)
    return torque


@kernel
def _gravity(robot, pose, torque):
    gravity(robot[0], pose, torque)


@kernel
def gravity(robot, pose, torque):
    """As `gravity_torques`, for a record and in place, for kernels."""
    c_psi, s_psi, _, _, x, y, z = nacelle(robot, pose)
    # g_1 = A_0^T (0, 0, -g): weight per mass in the axes of R_1, without an x component
    gy, gz = -GRAVITY_M_PER_S2 * s_psi, -GRAVITY_M_PER_S2 * c_psi
    share = robot.arm_centre_mm / robot.arm_mm
    on_elbow = share * robot.arm_kg + 0.5 * robot.rods_kg
    on_nacelle = robot.nacelle_kg + 1.5 * robot.rods_kg

    a, b, c = chain(robot, 0, x, y, z), chain(robot, 1, x, y, z), chain(robot, 2, x, y, z)
    rod_a, rod_b, rod_c = _along_rods(a, b, c, on_nacelle * gy, on_nacelle * gz)
    torque[0] = _arm(robot, 0, a, rod_a, on_elbow * gy, on_elbow * gz)
    torque[1] = _arm(robot, 1, b, rod_b, on_elbow * gy, on_elbow * gz)
    torque[2] = _arm(robot, 2, c, rod_c, on_elbow * gy, on_elbow * gz)

    # first moment in R_1 from the centre of the arc: elbows at P_n - l_2 u_i, the Delta's frame at (0, 0, R); what of the
    # arms' mass stays at their axes is in balance
    moving = on_nacelle + 3.0 * on_elbow
    l2 = robot.rod_mm
    my = moving * y - on_elbow * l2 * (a[2] + b[2] + c[2])
    mz = moving * z - on_elbow * l2 * (a[3] + b[3] + c[3])
    mz += robot.arc_radius_mm * (robot.slider_kg + robot.nacelle_kg + 3.0 * (robot.arm_kg + robot.rods_kg))
    torque[3] = NM_PER_N_MM * GRAVITY_M_PER_S2 * (c_psi * my - s_psi * mz) / robot.ratio[3]
    torque[4] = 0.0


@kernel
def _along_rods(a, b, c, fy, fz):
    """Z_u of [u_1 u_2 u_3] Z_u = (0, f_y, f_z): what of the nacelle's weight each rod passes on [N]."""
    determinant = (
        a[1] * (b[2] * c[3] - b[3] * c[2]) + a[2] * (b[3] * c[1] - b[1] * c[3]) + a[3] * (b[1] * c[2] - b[2] * c[1])
    )
    return (
        (fy * (b[3] * c[1] - b[1] * c[3]) + fz * (b[1] * c[2] - b[2] * c[1])) / determinant,
        (fy * (c[3] * a[1] - c[1] * a[3]) + fz * (c[1] * a[2] - c[2] * a[1])) / determinant,
        (fy * (a[3] * b[1] - a[1] * b[3]) + fz * (a[1] * b[2] - a[2] * b[1])) / determinant,
    )


@kernel
def _arm(robot, i, rod, along_rod, fy, fz):
    """T_ig [N m]: minus the work per turn of motor i of the weight at its elbow and of what its rod passes on.

    y (AC_i x A_i^T f) of the paper is f dC_i/dalpha, with the rod's share of it l_1 times what `chain` returns.
    """
    alpha = rod[0]
    turn_y = -math.sin(alpha) * robot.arm_axis[i, 1]
    work = robot.arm_mm * (along_rod * rod[4] + fy * turn_y - fz * math.cos(alpha))
    return -NM_PER_N_MM * work / robot.ratio[i]
