"""Stretching, bending and damping of the rod: gradient and Hessian of the energy a time step minimises (08 section 3).

    sum EA/(2l) (|e_i| - l)^2  +  sum B_i/(2l) (phi_i - kappa_i l)^2
    + sum tau B_i/(2 h l) (phi_i - phi_i^n)^2  +  sum c/(2h) |x_i - x_i^n|^2

phi_i is the exact turning angle between the edges before and after node i. Its second derivatives belong to single
edges, where they come together as the difference of the moments at either end, which is the shear force: with them
and the compression of the edges the Hessian knows that a rod buckles.
"""

import math

from hal.kernel import kernel

SMALL_TANGENT_SQUARE = 0.0256
"""Half a turning angle with a tangent below 0.16 is as good as exact, to 1e-15 rad, after eight terms of its series."""


@kernel
def turning(tangent, cross, dot):
    """Angle whose half has this tangent: twice its arc tangent, or where that is large atan2(cross, dot)."""
    q = tangent * tangent
    if q > SMALL_TANGENT_SQUARE:
        return math.atan2(cross, dot)
    far = 1.0 / 9.0 - q * (1.0 / 11.0 - q * (1.0 / 13.0 - q * (1.0 / 15.0)))
    return 2.0 * tangent * (1.0 - q * (1.0 / 3.0 - q * (1.0 / 5.0 - q * (1.0 / 7.0 - q * far))))


@kernel
def assemble(rod, step_s):
    """Write energy, gradient and band matrix of everything elastic and viscous with the nodes where they are.

    One pass from the gripper to the tip. Joint j has edge a before it and b behind it, p = (-e_y, e_x) / |e|^2 is how
    the angle of an edge changes with its far node, so the turning angle changes with p_a of node j - 1, p_b of node
    j + 1, and minus both of node j. A node's rows are written once the last joint that has a part in them is known:
    d.. is the block of a node with itself, o.. that with the node before, and g. its gradient.
    """
    n, edge = rod.segments, rod.edge_mm
    x, before, band, gradient = rod.node_mm, rod.before_mm, rod.band, rod.gradient
    drag, lag, stretch = rod.drag_n_s_per_mm / step_s, rod.relaxation_s / step_s, rod.stretch_n_per_mm
    per_edge, energy = 1.0 / edge, 0.0

    x0, x1 = x[0], x[1]
    ax, ay = x1[0] - x0[0], x1[1] - x0[1]
    square = ax * ax + ay * ay
    asize = math.sqrt(square)
    ainverse = 1.0 / square
    px, py = -ay * ainverse, ax * ainverse
    moment = 0.0  # at the near end of edge a
    # of node j - 1 and of node j, as far as they are known; and the block between them
    g0x, g0y = drag * (x0[0] - before[0, 0]), drag * (x0[1] - before[0, 1])
    g1x, g1y = drag * (x1[0] - before[1, 0]), drag * (x1[1] - before[1, 1])
    d0xx = d0yy = d1xx = d1yy = drag
    d0xy = d1xy = oxx = oxy = oyx = oyy = 0.0
    wuxx = wuxy = wuyx = wuyy = 0.0  # of node j with node j - 2
    for j in range(1, n):
        x1, x2, b2 = x[j], x[j + 1], before[j + 1]
        bx, by = x2[0] - x1[0], x2[1] - x1[1]
        square = bx * bx + by * by
        bsize = math.sqrt(square)
        binverse = 1.0 / square
        qx, qy = -by * binverse, bx * binverse
        cross, dot = ax * by - ay * bx, ax * bx + ay * by
        turn = rod.turning_rad[j] = turning(cross / (asize * bsize + dot), cross, dot)
        rate = rod.bending_nmm2[j] * per_edge
        bent, turned = turn - rod.rest_turn_rad[j], turn - rod.turn_rad[j]
        far = rate * (bent + lag * turned)
        k = rate * (1.0 + lag)
        dx, dy = x2[0] - b2[0], x2[1] - b2[1]
        energy += 0.5 * (rate * (bent * bent + lag * turned * turned) + drag * (dx * dx + dy * dy))

        # edge a: its tension, and what the moments at its ends make of its turning
        longer = asize - edge
        pull = stretch * longer * asize * ainverse
        along = stretch * edge * asize * ainverse * ainverse
        twist = (far - moment) * ainverse
        xx = pull + along * ax * ax + 2.0 * twist * px * ax
        xy = along * ax * ay + twist * (px * ay + py * ax)
        yy = pull + along * ay * ay + 2.0 * twist * py * ay
        energy += 0.5 * stretch * longer * longer
        fx, fy = pull * ax, pull * ay

        # joint j: u = p_a, v = -p_a - p_b, w = p_b
        vx, vy = -px - qx, -py - qy
        kux, kuy, kvx, kvy = k * px, k * py, k * vx, k * vy
        row = band[2 * (n - j + 1)]
        row[0], row[1] = d0xx + xx + kux * px, d0xy + xy + kux * py
        row = band[2 * (n - j + 1) + 1]
        row[0] = d0yy + yy + kuy * py
        r = 2 * (n - j)
        row = band[r]
        row[2], row[3], row[4], row[5] = oxx - xx + kvx * px, oxy - xy + kvx * py, wuxx, wuxy
        row = band[r + 1]
        row[1], row[2], row[3], row[4], row[5] = oyx - xy + kvy * px, oyy - yy + kvy * py, wuyx, wuyy, 0.0
        gradient[r + 2], gradient[r + 3] = g0x - fx + far * px, g0y - fy + far * py
        g0x, g0y = g1x + fx + far * vx, g1y + fy + far * vy
        d0xx, d0xy, d0yy = d1xx + xx + kvx * vx, d1xy + xy + kvx * vy, d1yy + yy + kvy * vy
        g1x, g1y = drag * dx + far * qx, drag * dy + far * qy
        kwx, kwy = k * qx, k * qy
        d1xx, d1xy, d1yy = drag + kwx * qx, kwx * qy, drag + kwy * qy
        oxx, oxy, oyx, oyy = kwx * vx, kwx * vy, kwy * vx, kwy * vy
        wuxx, wuxy, wuyx, wuyy = kwx * px, kwx * py, kwy * px, kwy * py
        ax, ay, asize, ainverse, px, py, moment = bx, by, bsize, binverse, qx, qy, far

    longer = asize - edge
    pull = stretch * longer * asize * ainverse
    along = stretch * edge * asize * ainverse * ainverse
    twist = -moment * ainverse
    xx = pull + along * ax * ax + 2.0 * twist * px * ax
    xy = along * ax * ay + twist * (px * ay + py * ax)
    yy = pull + along * ay * ay + 2.0 * twist * py * ay
    fx, fy = pull * ax, pull * ay
    band[2, 0], band[2, 1], band[3, 0] = d0xx + xx, d0xy + xy, d0yy + yy
    band[0, 0], band[0, 1], band[1, 0] = d1xx + xx, d1xy + xy, d1yy + yy
    band[0, 2], band[0, 3], band[0, 4], band[0, 5] = oxx - xx, oxy - xy, wuxx, wuxy
    band[1, 1], band[1, 2], band[1, 3], band[1, 4], band[1, 5] = oyx - xy, oyy - yy, wuyx, wuyy, 0.0
    gradient[0], gradient[1], gradient[2], gradient[3] = g1x + fx, g1y + fy, g0x - fx, g0y - fy
    for r in range(2 * n - 2, 2 * n + 2):  # beyond the gripper there is nothing
        first = 2 * n + 2 - r
        for c in range(first, 6):
            band[r, c] = 0.0
    rod.energy_nmm = energy + 0.5 * stretch * longer * longer
