"""Force sensing: filter, bias, gravity, and the turn into the base frame (D III.56 to III.58).

The sensor {F} is aligned to the gripper: z_F is the insertion axis (gripper x), y_F = -gripper y, x_F = gripper z.
The environment's resistance to insertion is therefore a negative f_z.
"""

import math

from hal.frames import VALID
from hal.kernel import kernel


@kernel
def into_sensor(rotation, vector_in_base, result):
    """Turn a base vector (3,) into {F}; `rotation` (3, 3) is the gripper in {B}."""
    gx = rotation[0, 0] * vector_in_base[0] + rotation[1, 0] * vector_in_base[1] + rotation[2, 0] * vector_in_base[2]
    gy = rotation[0, 1] * vector_in_base[0] + rotation[1, 1] * vector_in_base[1] + rotation[2, 1] * vector_in_base[2]
    gz = rotation[0, 2] * vector_in_base[0] + rotation[1, 2] * vector_in_base[1] + rotation[2, 2] * vector_in_base[2]
    result[0], result[1], result[2] = gz, -gy, gx


@kernel
def into_base(rotation, x, y, z, result, at):
    """Turn the {F} vector (x, y, z) into {B}, written to result[at : at + 3]."""
    gx, gy, gz = z, -y, x
    for i in range(3):
        result[at + i] = rotation[i, 0] * gx + rotation[i, 1] * gy + rotation[i, 2] * gz


@kernel
def is_other_filter(a, b):
    """True if the parameter sets `a` and `b` do not filter alike."""
    return a.moving_average != b.moving_average or a.window_ticks != b.window_ticks or a.filter_b[0] != b.filter_b[0]


@kernel
def is_usable(sensors):
    """True for a sample the filter may take: never NaN, which it would remember for ever."""
    usable = sensors.wrench_validity == VALID
    for i in range(6):
        usable = usable and math.isfinite(sensors.wrench_in_sensor[i])
    return usable


@kernel
def _rest(parameters, state, i, x):
    """Set component i of both filters to rest at the value x."""
    b, a = parameters.filter_b, parameters.filter_a
    state.filter_state[i, 1] = (b[2] - a[2]) * x
    state.filter_state[i, 0] = (b[1] - a[1]) * x + state.filter_state[i, 1]
    n = parameters.window_ticks
    for k in range(n):
        state.window[i, k] = x
    state.window_sum[i] = n * x
    state.window_lap[i] = 0.0


@kernel
def _butterworth(parameters, state, i, x):
    """Second-order low-pass in transposed direct form II (D III.7)."""
    b, a = parameters.filter_b, parameters.filter_a
    y = b[0] * x + state.filter_state[i, 0]
    state.filter_state[i, 0] = b[1] * x - a[1] * y + state.filter_state[i, 1]
    state.filter_state[i, 1] = b[2] * x - a[2] * y
    return y


@kernel
def _average(parameters, state, i, x):
    """Mean of the last samples (I), by a running sum.

    At the end of every lap of the ring the sum is that of the lap, taken afresh, so that rounding never adds up.
    """
    k, n = state.window_at, parameters.window_ticks
    state.window_sum[i] += x - state.window[i, k]
    state.window_lap[i] += x
    state.window[i, k] = x
    if k == n - 1:
        state.window_sum[i] = state.window_lap[i]
        state.window_lap[i] = 0.0
    return state.window_sum[i] / n


@kernel
def low_pass(parameters, state, sensors, result):
    """Filter all six components into `result`; the first sample finds the filter at rest at its value."""
    if state.filter_ready == 0:
        for i in range(6):
            _rest(parameters, state, i, sensors.wrench_in_sensor[i])
        state.window_at = 0
        state.filter_ready = 1
    for i in range(6):
        x = sensors.wrench_in_sensor[i]
        if parameters.moving_average:
            result[i] = _average(parameters, state, i, x)
        else:
            result[i] = _butterworth(parameters, state, i, x)
    state.window_at = (state.window_at + 1) % parameters.window_ticks


@kernel
def compensate(parameters, state, sensors, record):
    """Filter, subtract bias and gravity at the present orientation, and turn to {B} (III.58).

    Gravity is a force f_g fixed in {B} acting at the centre of mass r fixed in {F}: F f_g and r x F f_g (05 section 1).
    Writes record.wrench_in_base (6,), NaN while the sensor is invalid or was never unbiased.
    """
    if not is_usable(sensors):
        for i in range(6):
            record.wrench_in_base[i] = math.nan
        state.unbias_left = 0
        return
    f = state.scratch[0]
    low_pass(parameters, state, sensors, f)
    g = state.scratch[1]
    rotation = state.rotation
    into_sensor(rotation, parameters.gravity_force_in_base_n, g)
    r = parameters.centre_of_mass_in_sensor_mm
    g[3] = r[1] * g[2] - r[2] * g[1]
    g[4] = r[2] * g[0] - r[0] * g[2]
    g[5] = r[0] * g[1] - r[1] * g[0]
    for i in range(6):
        f[i] -= g[i]
    _average_bias(parameters, state, f)
    if state.unbiased == 0:
        for i in range(6):
            record.wrench_in_base[i] = math.nan
        return
    for i in range(6):
        f[i] -= state.bias_in_sensor[i]
    into_base(rotation, f[0], f[1], f[2], record.wrench_in_base, 0)
    into_base(rotation, f[3], f[4], f[5], record.wrench_in_base, 3)


@kernel
def _average_bias(parameters, state, wrench):
    """While `unbias` runs, take the mean of what is left after gravity as the new bias."""
    if state.unbias_left == 0:
        return
    for i in range(6):
        state.unbias_sum[i] += wrench[i]
    state.unbias_left -= 1
    if state.unbias_left == 0:
        for i in range(6):
            state.bias_in_sensor[i] = state.unbias_sum[i] / parameters.unbias_ticks
        state.unbiased = 1
