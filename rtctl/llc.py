"""Low-level controller: references of the motors, backlash compensation, PID, limits (D III.7, 05 section 4)."""

import math

from hal.kernel import kernel


@kernel
def compensate_backlash(parameters, state, axis, reference):
    """Motor reference with the wire's backlash taken up.

    The side changes when the reference turns round by more than rounding, and stays while it rests (m of III.61);
    extending needs chi more motor angle than retracting. The change is spread out, so it is no step.
    """
    move = reference - state.motor_reference[axis]
    if move > 1e-9:
        state.side[axis] = 1.0
    elif move < -1e-9:
        state.side[axis] = 0.0
    wanted = state.side[axis] * parameters.backlash_rad[axis]
    step = wanted - state.compensation_rad[axis]
    limit = parameters.backlash_step_rad
    state.compensation_rad[axis] += min(max(step, -limit), limit)
    state.motor_reference[axis] = reference
    return reference + state.compensation_rad[axis]


@kernel
def pid(parameters, state, axis, reference, angle, limit_v):
    """One PID step [V]; the integral stops where the command is at its limit or at its own share.

    The derivative acts on the filtered rate of the error, the feed-forward on the rate of the reference.
    """
    period = parameters.period_s
    error = reference - angle
    rate = (error - state.last_error_rad[axis]) / period
    state.rate_rad_per_s[axis] += parameters.derivative_blend * (rate - state.rate_rad_per_s[axis])
    forward = parameters.feedforward[axis] * (reference - state.axis_reference[axis]) / period
    proportional = parameters.proportional[axis] * error + parameters.derivative[axis] * state.rate_rad_per_s[axis]
    integral = state.integral_v[axis] + parameters.integral[axis] * error * period
    integral = min(max(integral, -parameters.integral_limit_v), parameters.integral_limit_v)
    command = proportional + integral + forward
    if abs(command) <= limit_v or abs(integral) < abs(state.integral_v[axis]):
        state.integral_v[axis] = integral
    state.last_error_rad[axis] = error
    state.axis_reference[axis] = reference
    return command


@kernel
def limit(parameters, state, axis, command_v, limit_v):
    """The last thing before an actuator: amplitude, then change against the previous command. NaN passes as NaN."""
    if math.isnan(command_v):
        return command_v
    applied = min(max(command_v, -limit_v), limit_v)
    last, slew = state.last_command_v[axis], parameters.command_slew_v
    return min(max(applied, last - slew), last + slew)


@kernel
def rest(state, axis, angle):
    """Make the controller start from where the motor is: no error, no memory, no step (bumpless enabling)."""
    state.motor_reference[axis] = angle - state.compensation_rad[axis]
    state.axis_reference[axis] = angle
    state.integral_v[axis] = 0.0
    state.rate_rad_per_s[axis] = 0.0
    state.last_error_rad[axis] = 0.0
    state.last_command_v[axis] = 0.0
