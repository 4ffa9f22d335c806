"""What a straight boundary element contributes to a point of the plane (04 section 1; (VII.15)).

Phi = ln(r^2) / 4 pi is the fundamental solution of the Laplace equation. With r_0 and r_1 the ends of the element seen
from the point, t its tangent, n its outward normal, d = n.r_0, and W the angle under which it is seen, the closed forms
of (VII.15) are shorter: Q = 2 L |d|, B / 2A = t.r_0 / L, and 1 + B/A + E/A = |r_1|^2 / L^2.
"""

import math

from hal.kernel import kernel

COLLINEAR = 1e-9
"""|d| / |r_0| below which point and element are on one line: what is left of d then is rounding."""
NARROW = 0.1
"""tan W up to which a series gives W to the last digit; from far away most elements are seen so."""


@kernel
def flux_influence(x0, y0, x1, y1, x, y):
    """F_2 = integral of dPhi/dn over the element from (x0, y0) to (x1, y1), at the point (x, y); (VII.15g).

    Counter-clockwise around the domain, so that the normal points outwards. It is the angle W over 2 pi, signed.
    """
    return _angle(x0 - x, y0 - y, x1 - x, y1 - y) / (2.0 * math.pi)


@kernel
def potential_influence(x0, y0, x1, y1, x, y):
    """F_1 = integral of Phi over the element [mm], at the point (x, y), which is not one of its ends; (VII.15h)."""
    ax, ay, bx, by = x0 - x, y0 - y, x1 - x, y1 - y
    tx, ty = x1 - x0, y1 - y0
    length = math.sqrt(tx * tx + ty * ty)
    near, far = (tx * ax + ty * ay) / length, (tx * bx + ty * by) / length
    logs = far * math.log(bx * bx + by * by) - near * math.log(ax * ax + ay * ay)
    distance = (ax * by - ay * bx) / length  # d
    return (logs - 2.0 * length + 2.0 * distance * _angle(ax, ay, bx, by)) / (4.0 * math.pi)


@kernel
def _angle(ax, ay, bx, by):
    """From a to b, counter-clockwise [rad]; 0 if both are on one line through the point."""
    cross, dot = ax * by - ay * bx, ax * bx + ay * by
    if cross * cross <= COLLINEAR * COLLINEAR * (ax * ax + ay * ay) * (bx * bx + by * by):
        return 0.0
    if abs(cross) > NARROW * dot:
        return math.atan2(cross, dot)
    t = cross / dot
    u = t * t
    return t * (1.0 - u * (1 / 3 - u * (1 / 5 - u * (1 / 7 - u * (1 / 9 - u * (1 / 11 - u / 13))))))
