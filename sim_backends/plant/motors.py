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
        ("gain_v_per_v", "f8"),
        ("resistance_ohm", "f8"),
        ("inductance_h", "f8"),
        ("in_voltage_mode", "u1"),
        ("angle_rad", "f8"),
        ("rate_rad_per_s", "f8"),
        ("zero_rad", "f8"),
        ("current_a", "f8"),
        ("voltage_v", "f8"),  # of an amplifier in voltage mode, at the motor's terminals
        ("circuit_closed", "u1"),  # the current follows from that voltage
    ],
    align=True,
)
"""Parameters, then state. `angle_rad` is zero where the robot is at home; the encoder counts from `zero_rad`."""


VOLT_PER_NMM_PER_A = 1e-3
"""K is both: 1 N mm/A of torque constant is 1 mV s/rad of back-EMF."""


@kernel
def amplify(motor, command_v, powered):
    """Set the amplifier: a current [A] in current mode, the terminals' voltage [V] in voltage mode.

    Without power both kinds are an open circuit, so the motor coasts.
    """
    motor.circuit_closed = powered and motor.in_voltage_mode
    if motor.circuit_closed:
        motor.voltage_v = motor.gain_v_per_v * command_v
        return
    current = motor.gain_a_per_v * command_v if powered else 0.0
    motor.voltage_v = 0.0
    motor.current_a = min(max(current, -motor.current_limit_a), motor.current_limit_a)


@kernel
def turn(motor, load_n, jammed, dt_s):
    """Advance one axis by `dt_s`: J dw/dt = K I - b w - eta F - friction, L dI/dt = u - R I - K w (08 section 1).

    load_n: force of the driven part on the nut, positive in the direction of growing angle.
    Current and speed are those at the end of the step, both equations at once: stable however much faster than a step
    the electrical pole L / R is. The amplifier limits the current in either mode.
    Screw friction grows with the load, which makes the screw self-locking below an efficiency of one half.
    Friction is an impulse that can stop the rotor in this step but never turn it round: no chatter at rest.
    The end stops are rigid.
    """
    load_nmm = motor.lead_mm_per_rad * load_n
    friction_nmm = motor.coulomb_nmm + motor.screw_loss * abs(load_nmm)
    if motor.circuit_closed:
        emf_v_s = VOLT_PER_NMM_PER_A * motor.torque_nmm_per_a
        impedance = motor.inductance_h + dt_s * motor.resistance_ohm  # times dt
        locked_a = (motor.inductance_h * motor.current_a + dt_s * motor.voltage_v) / impedance
        a_per_rate = dt_s * emf_v_s / impedance
        drag = motor.viscous_nmm_s + motor.torque_nmm_per_a * a_per_rate
        rate = _spin(motor, motor.torque_nmm_per_a * locked_a + load_nmm, drag, friction_nmm, jammed, dt_s)
        motor.current_a = locked_a - a_per_rate * rate
        if abs(motor.current_a) > motor.current_limit_a:
            motor.current_a = math.copysign(motor.current_limit_a, motor.current_a)
            torque = motor.torque_nmm_per_a * motor.current_a + load_nmm
            rate = _spin(motor, torque, motor.viscous_nmm_s, friction_nmm, jammed, dt_s)
    else:
        torque = motor.torque_nmm_per_a * motor.current_a + load_nmm
        rate = _spin(motor, torque, motor.viscous_nmm_s, friction_nmm, jammed, dt_s)
    angle = motor.angle_rad + dt_s * rate
    if angle <= motor.low_rad:
        angle, rate = motor.low_rad, max(rate, 0.0)
    elif angle >= motor.high_rad:
        angle, rate = motor.high_rad, min(rate, 0.0)
    motor.angle_rad, motor.rate_rad_per_s = angle, rate


@kernel
def _spin(motor, torque_nmm, drag_nmm_s, friction_nmm, jammed, dt_s):
    """Speed [rad/s] at the end of a step under a torque, a drag at that speed, and dry friction."""
    mass = motor.inertia_nmm_s2 + dt_s * drag_nmm_s
    rate = (motor.inertia_nmm_s2 * motor.rate_rad_per_s + dt_s * torque_nmm) / mass
    brake = dt_s * friction_nmm / mass
    if jammed or abs(rate) <= brake:
        return 0.0
    return rate - math.copysign(brake, rate)


@kernel
def encoder_angle(motor):
    """Angle [rad] the encoder has counted since the device was opened."""
    return math.floor((motor.angle_rad - motor.zero_rad) / motor.count_rad + 0.5) * motor.count_rad
