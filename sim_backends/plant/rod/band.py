"""The linear solve of a Newton step: a symmetric band of half-width 5, eliminated from the tip to the gripper.

Row 2 (n - i) + c of the matrix is coordinate c of node i, and `band[row, k]` its entry in column row + k. The four rows
of the clamped edge come last. Once all others are eliminated they hold the stiffness and the force that the gripper
feels, for nothing more than the solve itself.
"""

from hal.kernel import kernel

WIDTH = 6
FLOOR_N_PER_MM = 1e-4
"""Least pivot: a rod that is buckling has none that is positive, and still must go downhill."""


@kernel
def eliminate(band, gradient, rows):
    """LDL^T of the first `rows` rows in place, and of the gradient with it; how many pivots were not positive.

    band (n + 1, 6), gradient (n + 1,) for n rows in all: the last one only takes zeros. Rows become those of the unit
    triangular factor, with the inverse pivot in front. A pivot that is not positive is turned round, so that the step
    goes downhill.
    """
    turned = 0
    for r in range(rows):
        pivot = band[r, 0]
        if pivot < FLOOR_N_PER_MM:
            turned += 1
            pivot = max(-pivot, FLOOR_N_PER_MM)
        inverse = 1.0 / pivot
        band[r, 0] = inverse
        g = gradient[r]
        a1, a2, a3, a4, a5 = band[r, 1], band[r, 2], band[r, 3], band[r, 4], band[r, 5]
        f1, f2, f3, f4, f5 = a1 * inverse, a2 * inverse, a3 * inverse, a4 * inverse, a5 * inverse
        band[r + 1, 0] -= f1 * a1
        band[r + 1, 1] -= f1 * a2
        band[r + 1, 2] -= f1 * a3
        band[r + 1, 3] -= f1 * a4
        band[r + 1, 4] -= f1 * a5
        band[r + 2, 0] -= f2 * a2
        band[r + 2, 1] -= f2 * a3
        band[r + 2, 2] -= f2 * a4
        band[r + 2, 3] -= f2 * a5
        band[r + 3, 0] -= f3 * a3
        band[r + 3, 1] -= f3 * a4
        band[r + 3, 2] -= f3 * a5
        band[r + 4, 0] -= f4 * a4
        band[r + 4, 1] -= f4 * a5
        band[r + 5, 0] -= f5 * a5
        gradient[r + 1] -= f1 * g
        gradient[r + 2] -= f2 * g
        gradient[r + 3] -= f3 * g
        gradient[r + 4] -= f4 * g
        gradient[r + 5] -= f5 * g
        band[r, 1], band[r, 2], band[r, 3], band[r, 4], band[r, 5] = f1, f2, f3, f4, f5
    return turned


@kernel
def substitute(band, gradient, rows):
    """After :func:`eliminate`: the first `rows` of `gradient` become the solution of (matrix) x = gradient.

    The rows behind them do not move: the clamp is where it is. Returned is gradient times x, the slope of a step by -x.
    """
    slope = x1 = x2 = x3 = x4 = x5 = 0.0
    for r in range(rows - 1, -1, -1):
        g = gradient[r]
        x = g * band[r, 0]
        slope += x * g
        x -= band[r, 1] * x1 + band[r, 2] * x2 + band[r, 3] * x3 + band[r, 4] * x4 + band[r, 5] * x5
        x1, x2, x3, x4, x5 = x, x1, x2, x3, x4
        gradient[r] = x
    return slope
