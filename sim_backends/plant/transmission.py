"""Wire loop between carriage and piston of one leg: stretch, slack, backlash, misalignment.

01 section 1.1, 05 sections 3 and 4. Coordinates are wire lengths from home [mm]: the carriage pays out
Delta h(u* + eta theta), which is eta theta where the carriage runs on the tangent of its pulley; the piston side is at
c = q - r psi. The wire is stretched by delta = c - Delta h and pulls the piston back with T(delta) = tau_1 - tau_2.
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
        ("misalignment_mm", "f8"),  # n
        ("pulley_radius_mm", "f8"),  # r
        ("straight_mm", "f8"),  # u*
        ("home_length_mm", "f8"),  # h(u*)
        ("piston_mm", "f8"),  # c, which remembers the direction
        ("near_n", "f8"),
        ("far_n", "f8"),
    ],
    align=True,
)
"""Parameters, then state."""


@kernel
def wire_length(straight_mm, misalignment_mm, radius_mm):
    """Wire [mm] from the top of a pulley to a carriage beside its tangent, and its share along the carriage's way.

    h = r (pi/2 - theta_c) + sqrt(u^2 - 2 r n + n^2) and dh/du = sin theta_c; theta_c is where the wire leaves the
    pulley (05 section 3). straight_mm: u, from the pulley's axis; misalignment_mm: n, positive towards that axis.
    """
    if misalignment_mm == 0.0:
        return straight_mm, 1.0
    u, n, r = straight_mm, misalignment_mm, radius_mm
    free = math.sqrt(max(u * u - 2.0 * r * n + n * n, 0.0))
    up, along = r * (r - n) + free * u, r * u - free * (r - n)
    return r * (math.pi / 2 - math.atan2(up, along)) + free, up / (r * r + free * free)


@kernel
def pay_out(leg, carriage_mm):
    """Wire the carriage has paid out since home [mm], and how much of the wire's pull it feels."""
    length, share = wire_length(leg.straight_mm + carriage_mm, leg.misalignment_mm, leg.pulley_radius_mm)
    if leg.misalignment_mm == 0.0:
        return carriage_mm, share
    return length - leg.home_length_mm, share


def carriage_of(leg: np.void, paid_out_mm: float) -> float:
    """Carriage position [mm] from home that has paid out so much wire: the inverse of :func:`pay_out`."""
    carriage = paid_out_mm
    for _ in range(20):  # the share is near one: each step gains digits
        length, share = pay_out(leg, carriage)
        carriage += (paid_out_mm - length) / share
    return carriage


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
def drag_piston(leg, paid_out_mm, load_n, load_gain, dt_s):
    """Move the piston with the wire paid out by its carriage; returns the wire's pull [N], positive outwards.

    The piston sticks while wire and load differ by less than its friction, and follows the edge of that band
    otherwise, with the time constant of its viscous drag. Friction F gives a hysteresis of
    chi = 2 F / ((k_1 + k_2) eta) at the motor. The platform's mass is left out: at the accelerations of an insertion
    its inertia is far below the friction.

    load_n is of the tick before. load_gain: stiffness of what the robot touches, as a multiple of the robot's own; the
    piston is slowed by it, or two springs that each answer the other's last force would never come to rest.
    """
    excess = pull(leg, leg.piston_mm - paid_out_mm) - load_n
    if abs(excess) > leg.friction_n:
        edge = paid_out_mm + stretch_under(leg, load_n + math.copysign(leg.friction_n, excess))
        leg.piston_mm += (edge - leg.piston_mm) * dt_s / (leg.settling_s + dt_s * (1.0 + 2.0 * load_gain))
    return pull(leg, leg.piston_mm - paid_out_mm)
