"""Which conditions of the table hold: looked at once for what comes in, once for what would go out."""

import math

from hal.frames import VALID
from hal.kernel import kernel
from hal.troubles import Grade
from rtctl.device_clock import REFUSED
from rtctl.exchange.control import ALIVE, GATEWAY_EXPECTED, LOG_WRITING, OPERATOR_EXPECTED, OPERATOR_PRESENT
from rtctl.lifecycle import REACTION, Condition, Motion, Operating, Task


@kernel
def raise_condition(state, record, condition, value, bound):
    """Mark `condition` as holding in this tick; the gravest new one is reported with its value and bound."""
    bit = 1 << condition
    record.condition_active |= bit
    state.latched |= bit
    new = (state.active & bit) == 0
    if new and (record.condition_reported < 0 or REACTION[condition] > REACTION[record.condition_reported]):
        record.condition_reported = condition
        record.condition_value = value
        record.condition_bound = bound


@kernel
def watch_inputs(parameters, state, sensors, record):
    """Devices, power, kinematics, forces and the world outside, before anything is decided."""
    known = math.isfinite(state.angle_rad[0])  # all axes are known since the same tick; what never was cannot get lost
    if known and state.axes_silent_ticks > parameters.axes_age_ticks:
        silent, limit = float(state.axes_silent_ticks), float(parameters.axes_age_ticks)
        raise_condition(state, record, Condition.AXES_LOST, silent, limit)
        state.homed = 0  # nobody knows how far the motors have turned since
    if sensors.watchdog_tripped:
        raise_condition(state, record, Condition.WATCHDOG, math.nan, math.nan)
    if sensors.amplifier_fault:
        raise_condition(state, record, Condition.AMPLIFIER, math.nan, math.nan)
    if sensors.trouble_grade == Grade.WARNING:
        raise_condition(state, record, Condition.DEVICE_WARNING, float(sensors.trouble), sensors.trouble_value)
    elif sensors.trouble_grade == Grade.PAUSE:
        raise_condition(state, record, Condition.DEVICE_PAUSE, float(sensors.trouble), sensors.trouble_value)
    elif sensors.trouble_grade >= Grade.FAULT:
        raise_condition(state, record, Condition.DEVICE_FAULT, float(sensors.trouble), sensors.trouble_value)
    if state.power_ticks > parameters.power_on_ticks and sensors.powered == 0:
        raise_condition(state, record, Condition.POWER_LOST, float(state.power_ticks), float(parameters.power_on_ticks))
    if state.homed and record.kinematic_iterations < 0:
        raise_condition(state, record, Condition.KINEMATICS, math.nan, math.nan)
    moving = state.motion != Motion.HOLD
    if moving and state.array_loaded and state.task != Task.RETRACTING:
        _watch_force(parameters, state, sensors, record)
    _watch_drift(parameters, state, sensors, record)
    if record.missed_ticks > parameters.overrun_ticks:
        raise_condition(state, record, Condition.OVERRUN, float(record.missed_ticks), float(parameters.overrun_ticks))
    _watch_overruns(parameters, state, record)
    if record.clock_state == REFUSED:
        raise_condition(state, record, Condition.DEVICE_CLOCK, math.nan, math.nan)
    health = record.gateway_health
    if health & GATEWAY_EXPECTED:
        if not health & ALIVE:
            raise_condition(state, record, Condition.GATEWAY_LOST, math.nan, math.nan)
        elif not health & LOG_WRITING:
            raise_condition(state, record, Condition.LOG_FAILED, math.nan, math.nan)
        if health & OPERATOR_EXPECTED and not health & OPERATOR_PRESENT:
            raise_condition(state, record, Condition.OPERATOR_LOST, math.nan, math.nan)
    silent = record.tick - state.stream_tick
    if (state.motion == Motion.SERVO_CP or state.motion == Motion.SERVO_CV) and silent > parameters.stream_ticks:
        raise_condition(state, record, Condition.STREAM_SILENT, float(silent), float(parameters.stream_ticks))


@kernel
def _watch_overruns(parameters, state, record):
    """Missed ticks in windows of the grid; a gap counts where the loop comes back, and for no more than a window."""
    window, limit = record.tick // parameters.overrun_window_ticks, parameters.overrun_window_limit
    if window != state.overrun_window:
        state.overrun_run = state.overrun_run + 1 if state.overrun_missed > limit else 0
        state.overrun_window, state.overrun_missed = window, 0
    state.overrun_missed = min(state.overrun_missed + record.missed_ticks, parameters.overrun_window_ticks)
    run = state.overrun_run + (1 if state.overrun_missed > limit else 0)
    if run > 0:
        missed = float(state.overrun_missed)
        raise_condition(state, record, Condition.OVERRUN_PERSISTENT, missed, float(limit))
    if run >= parameters.overrun_windows:
        raise_condition(state, record, Condition.OVERRUN_UNABATED, float(run), float(parameters.overrun_windows))


@kernel
def _watch_force(parameters, state, sensors, record):
    """A loaded array must not be moved blindly, nor against more than the limit."""
    f = record.wrench_in_base
    known = sensors.wrench_validity == VALID and sensors.wrench_age_ticks <= parameters.wrench_age_ticks
    known = known and math.isfinite(f[0])  # not so before unbiasing, and when a device calls valid what is no number
    if state.task == Task.INSERTING and not known:
        raise_condition(
            state, record, Condition.WRENCH_LOST, float(sensors.wrench_age_ticks), float(parameters.wrench_age_ticks)
        )
    if known:
        force = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
        if force > parameters.force_limit_n:
            raise_condition(state, record, Condition.FORCE_LIMIT, force, parameters.force_limit_n)


@kernel
def _watch_drift(parameters, state, sensors, record):
    """Nothing touches an array that is loaded and not yet in the cochlea: a force that stays is drift (07 section 7)."""
    f = record.wrench_in_base
    outside = state.task == Task.IDLE or state.task == Task.APPROACH or state.task == Task.AT_ENTRY
    force = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])  # NaN before unbiasing and without a sensor
    if outside and state.array_loaded and sensors.wrench_validity == VALID and force > parameters.drift_limit_n:
        state.drift_ticks += 1
    else:
        state.drift_ticks = 0
    if state.drift_ticks > parameters.drift_ticks:
        raise_condition(state, record, Condition.FORCE_DRIFT, force, parameters.drift_limit_n)


@kernel
def watch_outputs(parameters, state, record):
    """Following error and anything that is not a number, after everything is computed."""
    if state.operating != Operating.ENABLED and state.operating != Operating.PAUSED:
        return
    for i in range(record.command_desired_v.shape[0]):
        if not (math.isfinite(record.command_desired_v[i]) and math.isfinite(record.command_applied_v[i])):
            raise_condition(state, record, Condition.NOT_FINITE, math.nan, math.nan)
        error = abs(state.last_error_rad[i])
        if error > parameters.following_error_rad:
            raise_condition(state, record, Condition.FOLLOWING_ERROR, error, parameters.following_error_rad)
