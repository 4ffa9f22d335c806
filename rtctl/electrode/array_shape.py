"""Shape of a free electrode array: bending angle as a polynomial in arc length and stylet withdrawal.

theta(s, q) = psi(s)^T A eta(q), psi = (1, s, s^2, s^3), eta = (1, q, q^2, q^3) (spec 02 section 2; (II.4)-(II.8)).
`modal_matrix` is A (4, 4): rows powers of s [mm], columns powers of q [mm]. Positions are in the array frame {E}:
origin at the grip ribs (s = 0), x along the straight array, z out of the plane of bending.
"""

import math

from hal.kernel import kernel

ORDER = 4
LENGTH_MM = 18.0
"""L, from the grip ribs to the tip."""
STYLET_MAX_MM = 15.0
"""Largest withdrawal q_s of the stylet."""

PANEL_MM = 0.5
"""Longest interval of one quadrature; four Gauss points integrate it to below 1e-11 mm."""
GAUSS = (
    (0.5 - 0.5 * 0.8611363115940526, 0.5 * 0.34785484513745385),
    (0.5 - 0.5 * 0.3399810435848563, 0.5 * 0.6521451548625462),
    (0.5 + 0.5 * 0.3399810435848563, 0.5 * 0.6521451548625462),
    (0.5 + 0.5 * 0.8611363115940526, 0.5 * 0.34785484513745385),
)
"""Four-point Gauss-Legendre rule on [0, 1]: (node, weight)."""


@kernel
def modes(modal_matrix, stylet_mm):
    """Coefficients A eta(q) of the powers of s in theta, lowest first."""
    a, q = modal_matrix, stylet_mm
    return (
        a[0, 0] + q * (a[0, 1] + q * (a[0, 2] + q * a[0, 3])),
        a[1, 0] + q * (a[1, 1] + q * (a[1, 2] + q * a[1, 3])),
        a[2, 0] + q * (a[2, 1] + q * (a[2, 2] + q * a[2, 3])),
        a[3, 0] + q * (a[3, 1] + q * (a[3, 2] + q * a[3, 3])),
    )


@kernel
def mode_slopes(modal_matrix, stylet_mm):
    """Coefficients A eta'(q) of the powers of s in d theta / d q, lowest first."""
    a, q = modal_matrix, stylet_mm
    return (
        a[0, 1] + q * (2 * a[0, 2] + q * 3 * a[0, 3]),
        a[1, 1] + q * (2 * a[1, 2] + q * 3 * a[1, 3]),
        a[2, 1] + q * (2 * a[2, 2] + q * 3 * a[2, 3]),
        a[3, 1] + q * (2 * a[3, 2] + q * 3 * a[3, 3]),
    )


@kernel
def polynomial(c, s):
    """c0 + c1 s + c2 s^2 + c3 s^3."""
    return c[0] + s * (c[1] + s * (c[2] + s * c[3]))


@kernel
def bending_angle(modal_matrix, s_mm, stylet_mm):
    """theta(s, q) [rad], (II.4)."""
    return polynomial(modes(modal_matrix, stylet_mm), s_mm)


@kernel
def advance(mode, slope, s_from, s_to):
    """Increments of (x, y, dx/dq, dy/dq) from arc length `s_from` to `s_to`."""
    panels = max(1, math.ceil(abs(s_to - s_from) / PANEL_MM - 1e-9))
    h = (s_to - s_from) / panels
    x = y = dx = dy = 0.0
    for i in range(panels):
        for node, weight in GAUSS:
            s = s_from + (i + node) * h
            theta = polynomial(mode, s)
            rate = weight * polynomial(slope, s)
            c, n = math.cos(theta), math.sin(theta)
            x += weight * c
            y += weight * n
            dx -= rate * n
            dy += rate * c
    return h * x, h * y, h * dx, h * dy


@kernel
def shape_point(modal_matrix, stylet_mm, s_mm):
    """Position p_e(s, q) as (x, y) in {E} [mm], (II.6)."""
    x, y, _, _ = advance(modes(modal_matrix, stylet_mm), mode_slopes(modal_matrix, stylet_mm), 0.0, s_mm)
    return x, y


@kernel
def tip(modal_matrix, stylet_mm):
    """Position p_e(L, q) of the tip as (x, y) in {E} [mm]."""
    return shape_point(modal_matrix, stylet_mm, LENGTH_MM)


@kernel
def stylet_jacobian(modal_matrix, stylet_mm, s_mm):
    """d p_e / d q as (x, y) in {E} [mm/mm], (II.8)."""
    _, _, dx, dy = advance(modes(modal_matrix, stylet_mm), mode_slopes(modal_matrix, stylet_mm), 0.0, s_mm)
    return dx, dy


@kernel
def shape_points(modal_matrix, stylet_mm, s_nodes_mm, points):
    """Positions p_e of the nodes (n,), ascending arc lengths, into `points` (n, 2) in {E} [mm]."""
    mode, slope = modes(modal_matrix, stylet_mm), mode_slopes(modal_matrix, stylet_mm)
    s = x = y = 0.0
    for k in range(s_nodes_mm.shape[0]):
        step_x, step_y, _, _ = advance(mode, slope, s, s_nodes_mm[k])
        s, x, y = s_nodes_mm[k], x + step_x, y + step_y
        points[k, 0], points[k, 1] = x, y


@kernel
def shape_points_and_jacobians(modal_matrix, stylet_mm, s_nodes_mm, points, jacobians):
    """As :func:`shape_points`, and d p_e / d q of every node into `jacobians` (n, 2) [mm/mm]."""
    mode, slope = modes(modal_matrix, stylet_mm), mode_slopes(modal_matrix, stylet_mm)
    s = x = y = dx = dy = 0.0
    for k in range(s_nodes_mm.shape[0]):
        step_x, step_y, step_dx, step_dy = advance(mode, slope, s, s_nodes_mm[k])
        s, x, y, dx, dy = s_nodes_mm[k], x + step_x, y + step_y, dx + step_dx, dy + step_dy
        points[k, 0], points[k, 1] = x, y
        jacobians[k, 0], jacobians[k, 1] = dx, dy
