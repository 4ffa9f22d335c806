"""The hybrid position/force admittance law (D VI.1 to VI.9, consistent form of 03 section 3).

Across the insertion axis the gripper gives way to the force; along it only the stylet reacts.
"""

import math

from hal.kernel import kernel


@kernel
def deadband(force, zeta):
    """Factor of the continuous deadband: f -> f (1 - zeta / |f|), 0 below zeta."""
    return 1.0 - zeta / force if force > zeta else 0.0


@kernel
def lateral(parameters, axis, force, offset):
    """One tick of dx/dt = K_a N db(f), the integrated state kept inside the ball of radius beta.

    axis: unit insertion direction (3,) in {B}; force (3,) [N] in {B}; offset (3,) [mm] in {B}, updated in place.
    Directions the robot does not have are masked out. Returns |offset| before it is clamped [mm].
    """
    along = force[0] * axis[0] + force[1] * axis[1] + force[2] * axis[2]
    squares = 0.0
    for i in range(3):
        f = force[i] - along * axis[i] if parameters.project_first else force[i]
        squares += f * f
    share = deadband(math.sqrt(squares), parameters.deadband_n)
    step = parameters.lateral_gain_mm_per_n_s * share * parameters.period_s
    squares = 0.0
    for i in range(3):
        offset[i] += step * (force[i] - along * axis[i]) * parameters.lateral_mask[i]
        squares += offset[i] * offset[i]
    length = math.sqrt(squares)
    if length > parameters.lateral_limit_mm:
        for i in range(3):
            offset[i] *= parameters.lateral_limit_mm / length
    return length


@kernel
def blend(parameters, depth_mm):
    """gamma(q): 0 before gamma_1, 1 after gamma_2, linear between (VI.8)."""
    width = parameters.blend_end_mm - parameters.blend_start_mm
    return min(max((depth_mm - parameters.blend_start_mm) / width, 0.0), 1.0)


@kernel
def stylet_rate(parameters, axial_force_n, depth_mm):
    """h = K_i gamma(q) max(0, f_reg - f_v) [mm/s]: extra withdrawal against resistance (VI.7)."""
    excess = max(0.0, parameters.regulated_force_n - axial_force_n)
    return parameters.stylet_gain_mm_per_n_s * blend(parameters, depth_mm) * excess
