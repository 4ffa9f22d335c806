"""Orientation in space, for robots that turn about more than one axis: Euler angles, unit quaternions, matrices.

Poses carry Euler angles (alpha, beta, gamma) [rad], R = R_z(gamma) R_y(beta) R_x(alpha): turns about the fixed axes x,
then y, then z of {B} (01 section 2). They lose a direction at beta = +-90 deg, so what iterates holds a unit quaternion
(w, x, y, z) of the same turn. Everything is passed as scalars and tuples, which live in registers; a matrix is the
tuple of its nine entries, row by row.
"""

import math

from hal.kernel import kernel


@kernel
def matrix_of_euler(alpha, beta, gamma):
    """R_z(gamma) R_y(beta) R_x(alpha)."""
    ca, sa = math.cos(alpha), math.sin(alpha)
    cb, sb = math.cos(beta), math.sin(beta)
    cg, sg = math.cos(gamma), math.sin(gamma)
    return (
        cg * cb, cg * sb * sa - sg * ca, cg * sb * ca + sg * sa,
        sg * cb, sg * sb * sa + cg * ca, sg * sb * ca - cg * sa,
        -sb, cb * sa, cb * ca,
    )  # fmt: skip


@kernel
def quaternion_of_euler(alpha, beta, gamma):
    """Unit quaternion of R_z(gamma) R_y(beta) R_x(alpha)."""
    ca, sa = math.cos(0.5 * alpha), math.sin(0.5 * alpha)
    cb, sb = math.cos(0.5 * beta), math.sin(0.5 * beta)
    cg, sg = math.cos(0.5 * gamma), math.sin(0.5 * gamma)
    return (
        ca * cb * cg + sa * sb * sg,
        sa * cb * cg - ca * sb * sg,
        ca * sb * cg + sa * cb * sg,
        ca * cb * sg - sa * sb * cg,
    )


@kernel
def matrix_of_quaternion(q):
    """Rotation matrix of the unit quaternion `q`."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@kernel
def euler_of_quaternion(q):
    """(alpha, beta, gamma) of the unit quaternion `q`: beta in [-pi/2, pi/2], the others in [-pi, pi]."""
    w, x, y, z = q
    alpha = math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    beta = math.asin(min(max(2.0 * (w * y - x * z), -1.0), 1.0))
    gamma = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return alpha, beta, gamma


@kernel
def turned(q, x, y, z):
    """The unit quaternion `q` followed by a small turn by the rotation vector (x, y, z) [rad] in {B}, normalised.

    The turn is (1, v / 2) before it is normalised, right to the third order in |v|: enough for Newton, whose steps
    are right to the first, and without a sine.
    """
    w, a, b, c = q
    x, y, z = 0.5 * x, 0.5 * y, 0.5 * z
    turn_w = w - x * a - y * b - z * c
    turn_x = a + x * w + y * c - z * b
    turn_y = b + y * w + z * a - x * c
    turn_z = c + z * w + x * b - y * a
    scale = 1.0 / math.sqrt(turn_w * turn_w + turn_x * turn_x + turn_y * turn_y + turn_z * turn_z)
    return scale * turn_w, scale * turn_x, scale * turn_y, scale * turn_z


@kernel
def per_euler_rates(beta, gamma, x, y, z):
    """The row (x, y, z) T: a row per angular velocity in {B} becomes one per rates of (alpha, beta, gamma)."""
    cb, sb = math.cos(beta), math.sin(beta)
    cg, sg = math.cos(gamma), math.sin(gamma)
    return cb * (cg * x + sg * y) - sb * z, cg * y - sg * x, z
