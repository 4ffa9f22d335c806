"""What has become of the array, as truth: depth, fold, buckle, and the force out of the plane."""

import math

from hal.kernel import kernel
from sim_backends.plant.scala import wall_at

BUCKLED_RAD = math.radians(10.0)
"""Permanent bend of the shaft outside the entry that anyone sees, and that makes an array one to be replaced (D section
VI: not elastic instability). Loads of a normal insertion leave up to half of it in the shaft in its last millimetre."""


@kernel
def look(rod, scala):
    """After a step: note depth, fold, buckle and lift."""
    n, edge = rod.segments, rod.edge_mm
    i = rod.inside_from
    ex, ey, ax, ay = scala.entry_mm[0], scala.entry_mm[1], scala.axis[0], scala.axis[1]
    rod.depth_mm, rod.lift_n = 0.0, 0.0
    outside = n
    if i <= n:
        far = (rod.node_mm[i, 0] - ex) * ax + (rod.node_mm[i, 1] - ey) * ay
        near = (rod.node_mm[i - 1, 0] - ex) * ax + (rod.node_mm[i - 1, 1] - ey) * ay
        share = far / (far - near) if near < 0.0 < far else 0.0
        rod.depth_mm = (n - i + share) * edge
        rod.lift_n = _lift_n(rod, scala, (n - 0.5) * edge - rod.depth_mm)
        outside = i
        _, _, tx, ty, _, _, _ = wall_at(scala, rod.foot_mm[n])
        dx, dy = rod.node_mm[n, 0] - rod.node_mm[n - 1, 0], rod.node_mm[n, 1] - rod.node_mm[n - 1, 1]
        rod.folded = dx * tx + dy * ty < 0.0
    else:
        rod.folded = 0
    if rod.set_per_mm > 0.0 and _bend_rad(rod, outside) > BUCKLED_RAD:
        rod.buckled = 1


@kernel
def _bend_rad(rod, outside):
    """Permanent bend of the joints before `outside`, whatever its direction, of the material that kept more of it."""
    bend = 0.0
    for j in range(1, outside):
        bend += max(abs(rod.stylet_set_per_mm[j]), abs(rod.array_set_per_mm[j]))
    return bend * rod.edge_mm


@kernel
def _lift_n(rod, scala, out_mm):
    """Force out of the plane [N] on the gripper: the shaft as a beam from the grip to the hole, `out_mm` long.

    The hole holds it at the height of the cochlea's plane, as far as its play does not do; it does not hold its slope.
    """
    height = scala.out_of_plane_mm
    bent = abs(height) - max(scala.hole_radius_mm - rod.radius_mm[rod.inside_from], 0.0)
    if bent <= 0.0:
        return 0.0
    compliance = 0.0
    for j in range(1, rod.inside_from):
        arm = out_mm - (j - 0.5) * rod.edge_mm
        if arm > 0.0:
            compliance += rod.edge_mm * arm * arm / rod.bending_nmm2[j]
    return math.copysign(bent / max(compliance, 1e-3), height)
