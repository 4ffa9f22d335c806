"""Stretching, bending and damping of the rod: gradient and Hessian of the energy a time step minimises (08 section 3).

    sum EA/(2l) (|e_i| - l)^2  +  sum B_i/(2l) (phi_i - kappa_i l)^2
    + sum tau B_i/(2 h l) (phi_i - phi_i^n)^2  +  sum c/(2h) |x_i - x_i^n|^2

phi_i is the exact turning angle between the edges before and after node i. Its second derivatives belong to single
edges, where they come together as the difference of the moments at either end, which is the shear force: with them
and the compression of the edges the Hessian knows that a rod buckles.
"""

import math

from hal.kernel import kernel


@kernel
def clear(band, gradient, rows):
    """Nothing pulls on anything."""
    for r in range(rows):
        gradient[r] = 0.0
        for k in range(6):
            band[r, k] = 0.0


@kernel
def assemble(rod, step_s):
    """Write energy, gradient and band matrix of everything elastic and viscous with the nodes where they are."""
    n, edge = rod.segments, rod.edge_mm
    x, before, band, gradient = rod.node_mm, rod.before_mm, rod.band, rod.gradient
    clear(band, gradient, 2 * n + 2)
    drag, energy = rod.drag_n_s_per_mm / step_s, 0.0
    for i in range(n + 1):
        r = 2 * (n - i)
        band[r, 0] = drag
        band[r + 1, 0] = drag
        dx, dy = x[i, 0] - before[i, 0], x[i, 1] - before[i, 1]
        gradient[r] = drag * dx
        gradient[r + 1] = drag * dy
        energy += 0.5 * drag * (dx * dx + dy * dy)

    lag = rod.relaxation_s / step_s
    ax, ay = x[1, 0] - x[0, 0], x[1, 1] - x[0, 1]
    inverse = 1.0 / (ax * ax + ay * ay)
    ux, uy = -ay * inverse, ax * inverse
    moment = 0.0  # at the near end of edge a
    for j in range(1, n):
        bx, by = x[j + 1, 0] - x[j, 0], x[j + 1, 1] - x[j, 1]
        inverse = 1.0 / (bx * bx + by * by)
        wx, wy = -by * inverse, bx * inverse
        turn = rod.turning_rad[j] = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        rate = rod.bending_nmm2[j] / edge
        bent, turned = turn - rod.rest_turn_rad[j], turn - rod.turn_rad[j]
        far = rate * (bent + lag * turned)
        energy += 0.5 * rate * (bent * bent + lag * turned * turned)
        energy += _edge(band, gradient, 2 * (n - j), ax, ay, ux, uy, moment - far, rod.stretch_n_per_mm, edge)
        _joint(band, gradient, 2 * (n - j - 1), ux, uy, wx, wy, far, rate * (1.0 + lag))
        ax, ay, ux, uy, moment = bx, by, wx, wy, far
    energy += _edge(band, gradient, 0, ax, ay, ux, uy, moment, rod.stretch_n_per_mm, edge)
    rod.energy_nmm = energy


@kernel
def _edge(band, gradient, r, ex, ey, px, py, shear, stiffness, length):
    """An edge whose far node has row r: tension, and the moments' geometric part; the energy of its stretch.

    (px, py): the edge turned left, over its length squared. shear: moment at its near end less that at its far end.
    """
    square = ex * ex + ey * ey
    size = math.sqrt(square)
    ratio = length / size
    pull = stiffness * (1.0 - ratio)
    gx, gy = pull * ex, pull * ey
    gradient[r] += gx
    gradient[r + 1] += gy
    gradient[r + 2] -= gx
    gradient[r + 3] -= gy
    along = stiffness * ratio / square
    # the angle of an edge has the second derivatives -(p e^T + e p^T) / |e|^2, with p as above
    twist = -shear / square
    xx = pull + along * ex * ex + twist * 2.0 * px * ex
    xy = along * ex * ey + twist * (px * ey + py * ex)
    yy = pull + along * ey * ey + twist * 2.0 * py * ey
    band[r, 0] += xx
    band[r, 1] += xy
    band[r + 1, 0] += yy
    band[r + 2, 0] += xx
    band[r + 2, 1] += xy
    band[r + 3, 0] += yy
    band[r, 2] -= xx
    band[r, 3] -= xy
    band[r + 1, 1] -= xy
    band[r + 1, 2] -= yy
    return 0.5 * stiffness * (size - length) ** 2


@kernel
def _joint(band, gradient, r, ux, uy, wx, wy, moment, stiffness):
    """A joint whose far node has row r: how its turning angle changes with the far (w), own (v), and near (u) node."""
    vx, vy = -ux - wx, -uy - wy
    gradient[r] += moment * wx
    gradient[r + 1] += moment * wy
    gradient[r + 2] += moment * vx
    gradient[r + 3] += moment * vy
    gradient[r + 4] += moment * ux
    gradient[r + 5] += moment * uy
    kx, ky = stiffness * wx, stiffness * wy
    band[r, 0] += kx * wx
    band[r, 1] += kx * wy
    band[r, 2] += kx * vx
    band[r, 3] += kx * vy
    band[r, 4] += kx * ux
    band[r, 5] += kx * uy
    band[r + 1, 0] += ky * wy
    band[r + 1, 1] += ky * vx
    band[r + 1, 2] += ky * vy
    band[r + 1, 3] += ky * ux
    band[r + 1, 4] += ky * uy
    kx, ky = stiffness * vx, stiffness * vy
    band[r + 2, 0] += kx * vx
    band[r + 2, 1] += kx * vy
    band[r + 2, 2] += kx * ux
    band[r + 2, 3] += kx * uy
    band[r + 3, 0] += ky * vy
    band[r + 3, 1] += ky * ux
    band[r + 3, 2] += ky * uy
    kx, ky = stiffness * ux, stiffness * uy
    band[r + 4, 0] += kx * ux
    band[r + 4, 1] += kx * uy
    band[r + 5, 0] += ky * uy
