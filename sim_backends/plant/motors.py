"""Motor, amplifier, gear and screw friction of one axis; torques and angles at the gear's output shaft."""

import math

import numpy as np

from hal.kernel import kernel

MOTOR = np.dtype(
    [
        ("gain_a_per_v", "f8"),
        ("current_limit_a", "f8"),
        ("torque_nmm_per_a", "f8"),
        ("inertia_nmm_s2", "f8"),
        ("viscous_nmm_s", "f8"),
        ("coulomb_nmm", "f8"),
        ("screw_loss", "f8"),  # 1 / efficiency - 1
        ("count_rad", "f8"),
        ("low_rad", "f8"),
        ("high_rad", "f8"),
        ("lead_mm_per_rad", "f8"),
        ("angle_rad", "f8"),
        ("rate_rad_per_s", "f8"),
        ("zero_rad", "f8"),
        ("current_a", "f8"),
    ],
    align=True,
)
"""Parameters, then state. `angle_rad` is zero where the robot is at home; the encoder counts from `zero_rad`."""


@kernel
def amplify(motor, command_v, powered):
    """Current [A] of an amplifier in current mode."""
    current = motor.gain_a_per_v * command_v if powered else 0.0
    motor.current_a = min(max(current, -motor.current_limit_a), motor.current_limit_a)


@kernel
def turn(motor, load_n, jammed, dt_s):
    """Advance one axis by `dt_s`: J dw/dt = K I - b w - eta F - friction (08 section 1).

    load_n: force of the driven part on the nut, positive in the direction of growing angle.
    Screw friction grows with the load, which makes the screw self-locking below an efficiency of one half.
    Friction is an impulse that can stop the rotor in this step but never turn it round: no chatter at rest.
    The end stops are rigid.
    """
    load_nmm = motor.lead_mm_per_rad * load_n
    mass = motor.inertia_nmm_s2 + dt_s * motor.viscous_nmm_s
    torque = motor.torque_nmm_per_a * motor.current_a + load_nmm
    rate = (motor.inertia_nmm_s2 * motor.rate_rad_per_s + dt_s * torque) / mass
    brake = dt_s * (motor.coulomb_nmm + motor.screw_loss * abs(load_nmm)) / mass
    if jammed or abs(rate) <= brake:
        rate = 0.0
    else:
        rate -= math.copysign(brake, rate)
    angle = motor.angle_rad + dt_s * rate
    if angle <= motor.low_rad:
        angle, rate = motor.low_rad, max(rate, 0.0)
    elif angle >= motor.high_rad:
        angle, rate = motor.high_rad, min(rate, 0.0)
    motor.angle_rad, motor.rate_rad_per_s = angle, rate


@kernel
def encoder_angle(motor):
    """Angle [rad] the encoder has counted since the device was opened."""
    return math.floor((motor.angle_rad - motor.zero_rad) / motor.count_rad + 0.5) * motor.count_rad
