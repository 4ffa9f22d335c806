"""Cost of one depth of an insertion, with its gradient (spec 02 section 5; (II.20)-(II.22))."""

import math

import numpy as np

from hal.kernel import kernel
from rtctl.electrode.array_shape import LENGTH_MM, shape_points_and_jacobians

STEP_MM = 0.5
NODES_MM = np.arange(0.0, LENGTH_MM + STEP_MM / 2, STEP_MM)
"""Arc lengths of the nodes that are compared with the path; one more of them is inside per step of depth."""


@kernel
def insertion_cost(modal_matrix, path, wall, inserted, x, gradient, hessian):
    """Cost f = (T^T T + U^T U) / 2 [mm^2] at x = (b_x, b_y, phi, q_s), the last `inserted` + 1 nodes counting.

    T: from the nodes to their points of `path` (n, 2); U: distances to the polyline `wall` (m, 2) of the nodes that are
    inside the modiolus. Adds J^T r to `gradient` (4,) and J^T J to `hessian` (4, 4).
    """
    nodes = NODES_MM[NODES_MM.shape[0] - 1 - inserted :]
    points, jacobians = np.empty((inserted + 1, 2)), np.empty((inserted + 1, 2))
    shape_points_and_jacobians(modal_matrix, x[3], nodes, points, jacobians)
    c, s = math.cos(x[2]), math.sin(x[2])
    columns_x, columns_y, row = np.zeros(4), np.zeros(4), np.zeros(4)
    columns_x[0] = columns_y[1] = 1.0
    cost = 0.0
    for k in range(inserted + 1):
        turned_x, turned_y = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        px, py = x[0] + turned_x, x[1] + turned_y
        columns_x[2], columns_y[2] = -turned_y, turned_x
        columns_x[3] = c * jacobians[k, 0] - s * jacobians[k, 1]
        columns_y[3] = s * jacobians[k, 0] + c * jacobians[k, 1]
        cost += _accumulate(px - path[k, 0], columns_x, gradient, hessian)
        cost += _accumulate(py - path[k, 1], columns_y, gradient, hessian)
        wall_x, wall_y = _closest(wall, px, py)
        distance = math.hypot(px - wall_x, py - wall_y)
        if distance > 0.0 and math.hypot(wall_x, wall_y) > math.hypot(px, py):
            for i in range(4):
                row[i] = ((px - wall_x) * columns_x[i] + (py - wall_y) * columns_y[i]) / distance
            cost += _accumulate(distance, row, gradient, hessian)
    return cost


@kernel
def _accumulate(residual, row, gradient, hessian):
    for i in range(4):
        gradient[i] += residual * row[i]
        for j in range(4):
            hessian[i, j] += row[i] * row[j]
    return 0.5 * residual * residual


@kernel
def _closest(polyline, x, y):
    """Closest point of the polyline (n, 2) to (x, y)."""
    best, best_x, best_y = math.inf, math.nan, math.nan
    for i in range(polyline.shape[0] - 1):
        ax, ay = polyline[i, 0], polyline[i, 1]
        ux, uy = polyline[i + 1, 0] - ax, polyline[i + 1, 1] - ay
        share = ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)
        share = min(max(share, 0.0), 1.0)
        fx, fy = ax + share * ux, ay + share * uy
        squared = (x - fx) ** 2 + (y - fy) ** 2
        if squared < best:
            best, best_x, best_y = squared, fx, fy
    return best_x, best_y
