"""An independent solver of the pair model: quadratic finite elements on a graded mesh of its trapezoid (scipy)."""

import itertools

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

CORNERS_MM = (0.0, 0.2, 0.62, 0.82)
SIGMA_W = 1.6e-3
GAUSS, WEIGHT = np.polynomial.legendre.leggauss(4)


def graded(start, end, cells, power):
    """Edges from start to end, crowded at both."""
    t = np.linspace(0.0, 1.0, cells + 1)
    half = np.where(t < 0.5, 0.5 * (2 * t) ** power, 1.0 - 0.5 * (2 - 2 * t) ** power)
    return start + (end - start) * half


def shapes(u):
    """Quadratic Lagrange polynomials on [-1, 1] and their slopes, (3, ...)."""
    value = np.array([0.5 * u * (u - 1), 1 - u * u, 0.5 * u * (u + 1)])
    return value, np.array([u - 0.5, -2 * u, u + 0.5])


def impedance_ohm(h_mm, alpha_rad, cells=20, rows=30, power=5.0):
    """Mean potential of the source [V] over the current [A], on 3 * cells by rows elements."""
    edges = np.concatenate([graded(a, b, cells, power)[:-1] for a, b in itertools.pairwise(CORNERS_MM)] + [[0.82]])
    x = np.empty(2 * len(edges) - 1)
    x[::2], x[1::2] = edges, 0.5 * (edges[:-1] + edges[1:])
    levels = np.linspace(0.0, 1.0, rows + 1) ** power
    y = np.empty(2 * rows + 1)
    y[::2], y[1::2] = levels, 0.5 * (levels[:-1] + levels[1:])
    height = h_mm + x * np.tan(alpha_rad)
    points = np.stack((np.repeat(x[:, None], len(y), 1), height[:, None] * y[None, :]), -1)
    number = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])

    i, j = np.meshgrid(2 * np.arange(len(edges) - 1), 2 * np.arange(rows), indexing="ij")
    nodes = np.stack([number[i + a, j + b].ravel() for a in range(3) for b in range(3)], 1)
    place = points.reshape(-1, 2)[nodes]
    local = np.zeros((len(nodes), 9, 9))
    for (u, wu), (v, wv) in itertools.product(zip(GAUSS, WEIGHT, strict=True), repeat=2):
        (nu, du), (nv, dv) = shapes(u), shapes(v)
        slope = np.stack((np.outer(du, nv).ravel(), np.outer(nu, dv).ravel()), 1)
        jacobian = np.einsum("ena,nb->eab", place, slope)
        gradient = np.einsum("nb,eba->ena", slope, np.linalg.inv(jacobian))
        local += wu * wv * np.linalg.det(jacobian)[:, None, None] * np.einsum("ena,ema->enm", gradient, gradient)
    total = number.size
    rows_, columns = np.repeat(nodes, 9, 1).ravel(), np.tile(nodes, (1, 9)).ravel()
    matrix = coo_array((SIGMA_W * local.ravel(), (rows_, columns)), (total, total)).tocsr()

    weight = np.zeros(total)  # of every node in the integral over the source, over its length
    for k in range(cells):
        simpson = (edges[k + 1] - edges[k]) / 6.0 / 0.2 * np.array([1.0, 4.0, 1.0])
        weight[number[2 * k : 2 * k + 3, 0]] += simpson
    free = np.ones(total, dtype=bool)
    free[number[x >= 0.62 - 1e-12, 0]] = False
    potential = spsolve(matrix[free][:, free].tocsc(), weight[free])  # of 1 A
    return float(weight[free] @ potential)
