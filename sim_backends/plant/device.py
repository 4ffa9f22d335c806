"""The simulated bench as a device: the two verbs `read` and `write` in compiled code."""

import math

import numba
from numba import types

from hal.frames import INVALID, SATURATED, VALID, actuator_frame, sensor_frame
from hal.kernel import kernel
from sim_backends.plant import crystal
from sim_backends.plant.bench import advance, clear_command, cut_power, load_array, start
from sim_backends.plant.impedance import measure
from sim_backends.plant.motors import encoder_angle
from sim_backends.plant.scala import LEFT_LIP, LEFT_RECESS, RIGHT_LIP, RIGHT_RECESS
from sim_backends.plant.sensor import sample
from sim_backends.plant.state import AXES, DEVICE, SHOWN, STYLET

REST_TICKS = 100
"""After so many ticks without power and motion the filters have settled too: time may be skipped."""
COMMAND_LIMIT_V = 10.0
NEVER = 2**31 - 1

_DEVICE = numba.from_dtype(DEVICE)
_SENSORS, _ACTUATORS = (numba.from_dtype(frame(AXES)) for frame in (sensor_frame, actuator_frame))
READ = types.int64(_DEVICE, types.int64, _SENSORS)
WRITE = types.int64(_DEVICE, types.int64, _ACTUATORS)
READ_ARRAYS = types.int64(_DEVICE[::1], types.int64, _SENSORS[::1])
LOOK_ARRAYS = types.int64(_DEVICE[::1], types.float64[::1], types.float64[::1], types.float64[::1])
WRITE_ARRAYS = types.int64(_DEVICE[::1], types.int64, _ACTUATORS[::1])


@kernel
def _sample_axes(device, sensors):
    fresh = device.opened and not device.failed and device.tick - device.start_tick < device.axes_silent_ticks
    if fresh and device.tick > device.axes_tick:
        device.axes_tick = device.tick
        device.axes_sequence += 1
    for i in range(AXES):
        sensors.axis_angle_rad[i] = encoder_angle(device.motor[i]) if fresh else math.nan
    sensors.axes_validity = VALID if fresh else INVALID
    sensors.axes_sequence = device.axes_sequence
    sensors.axes_age_ticks = min(device.tick - device.axes_tick, NEVER) if device.started else NEVER


@kernel
def _sample_wrench(device, sensors):
    since = device.tick - device.start_tick
    fresh = device.opened and not device.failed and since < device.wrench_silent_ticks
    if fresh and device.tick > device.wrench_tick:
        device.wrench_tick = device.tick
        device.wrench_sequence += 1
    validity = INVALID
    if fresh:
        within = sample(device.sensor, device.seed, device.tick, sensors.wrench_in_sensor)
        validity = VALID if within and since < device.wrench_saturated_ticks else SATURATED
    if validity != VALID:
        for i in range(6):
            sensors.wrench_in_sensor[i] = math.nan
    sensors.wrench_validity = validity
    sensors.wrench_sequence = device.wrench_sequence
    sensors.wrench_age_ticks = min(device.tick - device.wrench_tick, NEVER) if device.started else NEVER


@kernel
def _sample_impedance(device, sensors):
    """The last sample of the telemetry, until it is too old."""
    impedance = device.impedance
    age = NEVER
    if device.started and impedance.sequence > 0:
        age = min(device.tick - device.start_tick - impedance.sequence * impedance.period_ticks, NEVER)
    known = device.opened and age <= max(impedance.stale_ticks, impedance.period_ticks)
    sensors.impedance_ohm = impedance.ohm if known else math.nan
    sensors.impedance_pair = impedance.pair if known else -1
    sensors.impedance_validity = VALID if known else INVALID
    sensors.impedance_sequence = impedance.sequence
    sensors.impedance_age_ticks = age


@kernel
def _tell_truth(device):
    """Copy what a report wants to know; nothing else reads it."""
    truth, array = device.truth, device.array
    truth.tick = device.tick
    for i in range(3):
        truth.pose_gripper_in_base[i] = device.pose[i]
        truth.wrench_on_gripper_in_base[i] = device.wrench[i]
        truth.wire_tension_n[2 * i] = device.leg[i].near_n
        truth.wire_tension_n[2 * i + 1] = device.leg[i].far_n
    for i in range(AXES):
        truth.motor_rate_rad_per_s[i] = device.motor[i].rate_rad_per_s
        truth.motor_current_a[i] = device.motor[i].current_a
    _show_array(array, truth)
    truth.lift_on_gripper_n = array.lift_n
    truth.array_depth_mm = array.depth_mm
    truth.modiolar_wall_n, truth.lateral_wall_n, truth.face_n = array.modiolar_n, array.lateral_n, array.face_n
    truth.lips_n = array.post_press_n[LEFT_LIP] + array.post_press_n[RIGHT_LIP]
    truth.recess_n = array.post_press_n[LEFT_RECESS] + array.post_press_n[RIGHT_RECESS]
    truth.permanent_curvature_per_mm = array.set_per_mm
    truth.stylet_mm = device.stylet_mm
    truth.stylet_rod_mm = device.motor[STYLET].lead_mm_per_rad * device.motor[STYLET].angle_rad
    truth.rod_retries, truth.rod_iterations = array.retries, array.iterations
    truth.array_loaded = device.array_loaded
    truth.inside = array.inside_from <= array.segments
    truth.folded = array.folded
    truth.buckled = array.buckled
    truth.failed = device.failed


@kernel
def _show_array(array, truth):
    """Shape and contact forces at SHOWN points of equal arc length; forces go to the points on either side of a node."""
    shape, force = truth.array_node_in_base_mm, truth.contact_force_in_base_n
    if not array.placed:
        for k in range(2 * SHOWN):
            shape[k], force[k] = math.nan, 0.0
        truth.array_tip_in_base_mm[0] = truth.array_tip_in_base_mm[1] = math.nan
        return
    n = array.segments
    step = (n - 0.5) / (SHOWN - 1)  # edges from point to point
    for k in range(SHOWN):
        place = 0.5 + step * k
        i = min(int(place), n - 1)
        t = place - i
        for c in range(2):
            shape[2 * k + c] = (1.0 - t) * array.node_mm[i, c] + t * array.node_mm[i + 1, c]
            force[2 * k + c] = 0.0
    for i in range(1, n + 1):
        place = (i - 0.5) / step
        k = min(int(place), SHOWN - 2)
        t = place - k
        for c in range(2):
            force[2 * k + c] += (1.0 - t) * array.force_n[i, c]
            force[2 * k + 2 + c] += t * array.force_n[i, c]
    truth.array_tip_in_base_mm[0], truth.array_tip_in_base_mm[1] = array.node_mm[n, 0], array.node_mm[n, 1]


@kernel(signature=READ)
def read(device, tick, sensors):
    """Simulate up to `tick` with the command last written, then sample every sensor. Always 0."""
    sensors.device_time_s = crystal.time_s(device.crystal)
    if device.opened:
        if not device.started:
            start(device, tick)
        while device.tick < tick:
            if device.failed or (device.rest_ticks >= REST_TICKS and not device.powered):
                device.tick = tick
            else:
                advance(device)
            measure(device.impedance, device.seed, device.tick - device.start_tick)
        _tell_truth(device)
    _sample_axes(device, sensors)
    _sample_wrench(device, sensors)
    _sample_impedance(device, sensors)
    sensors.trouble = sensors.trouble_grade = 0
    sensors.trouble_device, sensors.trouble_value = -1, math.nan
    sensors.powered = device.powered
    sensors.watchdog_tripped = device.tripped
    sensors.amplifier_fault = device.amplifier_fault
    return 0


@kernel(signature=WRITE)
def write(device, tick, actuators):
    """Store the command for the time after `tick`. A command that is not finite counts as none. Always 0."""
    if not device.opened:
        return 0
    load_array(device, actuators.array_loaded)
    finite = True
    for i in range(AXES):
        finite = finite and math.isfinite(actuators.command_v[i])
    if not actuators.power:
        device.tripped = 0
        cut_power(device)
    elif not finite:
        clear_command(device)
    elif not (device.tripped or device.amplifier_fault or device.failed):
        device.powered = 1
        device.write_tick = tick
        for i in range(AXES):
            device.command_v[i] = min(max(actuators.command_v[i], -COMMAND_LIMIT_V), COMMAND_LIMIT_V)
    return 0


@kernel(signature=READ_ARRAYS)
def read_arrays(device, tick, sensors):
    """`read` for the interpreter, which hands over arrays (1,) forty times faster than records."""
    return read(device[0], tick, sensors[0])


@kernel(signature=LOOK_ARRAYS)
def look_arrays(device, angle_rad, current_a, wrench_in_sensor):
    """What real electronics would be wired to: shaft angles and currents (4,), and the wrench (6,), however large."""
    d = device[0]
    for i in range(AXES):
        angle_rad[i] = d.motor[i].angle_rad
        current_a[i] = d.motor[i].current_a
    sample(d.sensor, d.seed, d.tick, wrench_in_sensor)
    return 0


@kernel(signature=WRITE_ARRAYS)
def write_arrays(device, tick, actuators):
    """`write` for the interpreter."""
    return write(device[0], tick, actuators[0])
