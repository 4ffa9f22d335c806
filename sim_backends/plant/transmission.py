"""Wire loop between carriage and piston of one leg: stretch, slack, and backlash (01 section 1.1, 05 section 4).

Coordinates are wire lengths from home [mm]: the carriage at u = eta theta, the piston side at c = q - r psi. The wire
is stretched by delta = c - u and pulls the piston back with T(delta) = tau_1 - tau_2.
"""

import math

import numpy as np

from hal.kernel import kernel
from rtctl.robots.planar_3rpr_statics import segment_tensions

LEG = np.dtype(
    [
        ("near_n_per_mm", "f8"),  # k_1 = EA / h_1
        ("far_n_per_mm", "f8"),  # k_2 = EA / h_2
        ("pretension_n", "f8"),
        ("friction_n", "f8"),
        ("settling_s", "f8"),
        ("piston_mm", "f8"),  # c, which remembers the direction
        ("near_n", "f8"),
        ("far_n", "f8"),
    ],
    align=True,
)
"""Parameters, then state."""


@kernel
def pull(leg, stretch_mm):
    """Net force T(delta) [N] of the two segments; a segment goes slack instead of pushing."""
    k1, k2, t = leg.near_n_per_mm, leg.far_n_per_mm, leg.pretension_n
    leg.near_n, leg.far_n, _ = segment_tensions(stretch_mm, t, k1, k2)
    return leg.near_n - leg.far_n


@kernel
def stretch_under(leg, force_n):
    """The inverse of :func:`pull`: delta [mm] at a net force."""
    k1, k2, t = leg.near_n_per_mm, leg.far_n_per_mm, leg.pretension_n
    if force_n > t * (1.0 + k1 / k2):
        return (force_n - t) / k1
    if force_n < -t * (1.0 + k2 / k1):
        return (force_n + t) / k2
    return force_n / (k1 + k2)


@kernel
def drag_piston(leg, carriage_mm, load_n, load_gain, dt_s):
    """Move the piston with its carriage; returns the pull of the wire on the carriage [N], positive outwards.

    The piston sticks while wire and load differ by less than its friction, and follows the edge of that band
    otherwise, with the time constant of its viscous drag. Friction F gives a hysteresis of
    chi = 2 F / ((k_1 + k_2) eta) at the motor. The platform's mass is left out: at the accelerations of an insertion
    its inertia is far below the friction.

    load_n is of the tick before. load_gain: stiffness of what the robot touches, as a multiple of the robot's own; the
    piston is slowed by it, or two springs that each answer the other's last force would never come to rest.
    """
    excess = pull(leg, leg.piston_mm - carriage_mm) - load_n
    if abs(excess) > leg.friction_n:
        edge = carriage_mm + stretch_under(leg, load_n + math.copysign(leg.friction_n, excess))
        leg.piston_mm += (edge - leg.piston_mm) * dt_s / (leg.settling_s + dt_s * (1.0 + 2.0 * load_gain))
    return pull(leg, leg.piston_mm - carriage_mm)
