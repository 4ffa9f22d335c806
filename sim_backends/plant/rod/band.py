"""The linear solve of a Newton step: a symmetric band of half-width 5, eliminated from the tip to the gripper.

Row 2 (n - i) + c of the matrix is coordinate c of node i, and `band[row, k]` its entry in column row + k. The four rows
of the clamped edge come last. Once all others are eliminated they hold the stiffness and the force that the gripper
feels, for nothing more than the solve itself.
"""

from hal.kernel import kernel

FLOOR_N_PER_MM = 1e-4
"""Least pivot: a rod that is buckling has none that is positive, and still must go downhill."""


@kernel
def eliminate(band, gradient, rows):
    """LDL^T of the first `rows` rows in place, and of the gradient with it; how many pivots were not positive.

    A node's two rows go together, which halves the divisions that wait for each other. Their first four columns behind
    the diagonal block become those of its inverse times them, their gradient its inverse times that. A pivot that is
    not positive is turned round, so that the step goes downhill.
    """
    turned = 0
    for r in range(0, rows, 2):
        first, second = band[r], band[r + 1]
        a, b, c = first[0], first[1], second[0]
        if not (a >= FLOOR_N_PER_MM and a * c - b * b >= FLOOR_N_PER_MM * a):
            times, a, c = _turn(a, b, c)
            turned += times
        inverse = 1.0 / (a * c - b * b)
        s0, s1, s2, s3 = first[2], first[3], first[4], first[5]
        t0, t1, t2, t3 = second[1], second[2], second[3], second[4]
        g, h = gradient[r], gradient[r + 1]
        a, b, c = c * inverse, -b * inverse, a * inverse
        u0, u1, u2, u3 = a * s0 + b * t0, a * s1 + b * t1, a * s2 + b * t2, a * s3 + b * t3
        v0, v1, v2, v3 = b * s0 + c * t0, b * s1 + c * t1, b * s2 + c * t2, b * s3 + c * t3
        x, y = a * g + b * h, b * g + c * h
        row = band[r + 2]
        row[0] -= s0 * u0 + t0 * v0
        row[1] -= s0 * u1 + t0 * v1
        row[2] -= s0 * u2 + t0 * v2
        row[3] -= s0 * u3 + t0 * v3
        row = band[r + 3]
        row[0] -= s1 * u1 + t1 * v1
        row[1] -= s1 * u2 + t1 * v2
        row[2] -= s1 * u3 + t1 * v3
        row = band[r + 4]
        row[0] -= s2 * u2 + t2 * v2
        row[1] -= s2 * u3 + t2 * v3
        row = band[r + 5]
        row[0] -= s3 * u3 + t3 * v3
        gradient[r + 2] -= s0 * x + t0 * y
        gradient[r + 3] -= s1 * x + t1 * y
        gradient[r + 4] -= s2 * x + t2 * y
        gradient[r + 5] -= s3 * x + t3 * y
        first[0], first[1], second[0] = a, b, c
        first[2], first[3], first[4], first[5] = u0, u1, u2, u3
        second[1], second[2], second[3], second[4] = v0, v1, v2, v3
        gradient[r], gradient[r + 1] = x, y
    return turned


@kernel
def _turn(a, b, c):
    """Pivots of a block ((a, b), (b, c)) that are not positive, turned round: how many; a and c that have the others."""
    turned = 0
    if a < FLOOR_N_PER_MM:
        turned += 1
        a = max(-a, FLOOR_N_PER_MM)
    pivot = c - b * b / a
    if pivot < FLOOR_N_PER_MM:
        turned += 1
        pivot = max(-pivot, FLOOR_N_PER_MM)
    return turned, a, pivot + b * b / a


@kernel
def substitute(band, gradient, rows):
    """After :func:`eliminate`: the first `rows` of `gradient` become the solution of (matrix) x = gradient.

    The rows behind them do not move: the clamp is where it is.
    """
    x0 = y0 = x1 = y1 = 0.0
    for r in range(rows - 2, -2, -2):
        first, second = band[r], band[r + 1]
        x = gradient[r] - (first[4] * x1 + first[5] * y1) - (first[2] * x0 + first[3] * y0)
        y = gradient[r + 1] - (second[3] * x1 + second[4] * y1) - (second[1] * x0 + second[2] * y0)
        x0, y0, x1, y1 = x, y, x0, y0
        gradient[r], gradient[r + 1] = x, y
