"""What happens on the bench in one tick: motors, wires, platform, array, sensor, in this order (08 section 1)."""

import math

from hal.kernel import kernel
from rtctl.robots.planar_3rpr import forward, wire_jacobian
from sim_backends.plant.impedance import CONTACTS, begin_sweep
from sim_backends.plant.motors import amplify, turn
from sim_backends.plant.rod.step import advance as step_array
from sim_backends.plant.rod.step import lift
from sim_backends.plant.sensor import bear, follow, settle, stand, swing
from sim_backends.plant.state import AXES, LEGS, STYLET
from sim_backends.plant.transmission import drag_piston, pay_out

SUBSTEPS = 2
STYLET_MAX_MM = 15.0


@kernel
def start(device, tick):
    """The first tick of a session: nothing has moved yet."""
    device.started = 1
    device.start_tick = device.tick = tick
    device.axes_tick = device.wrench_tick = tick - 1
    device.rest_ticks = 0
    _touch(device)
    begin_sweep(device.impedance)
    stand(device.sensor, device.pose)
    _bear(device)
    settle(device.sensor)


@kernel
def advance(device):
    """One period of the bench."""
    device.tick += 1
    since = device.tick - device.start_tick
    if device.powered and device.tick - device.write_tick > device.watchdog_ticks:
        device.tripped = 1
        cut_power(device)
    if since >= device.amplifier_fault_ticks:
        device.amplifier_fault = 1
        cut_power(device)
    moving = _drive(device, since >= device.jam_ticks)
    device.rest_ticks = 0 if moving else device.rest_ticks + 1
    forward(device.robot, device.motor_angle, device.pose)  # where it fails the robot is held by its own joints
    _touch(device)
    swing(device.sensor, device.pose, device.period_s)
    _bear(device)
    follow(device.sensor)


@kernel
def _drive(device, jammed):
    """Motors, screws, wires and pistons through one period; True while a motor turns."""
    dt_s = device.period_s / SUBSTEPS
    for i in range(AXES):
        motor = device.motor[i]
        amplify(motor, device.command_v[i], device.powered)
        stuck = jammed and i == device.jam_axis
        for _ in range(SUBSTEPS):
            pull_n = 0.0
            if i < LEGS:
                paid_out_mm, share = pay_out(device.leg[i], motor.lead_mm_per_rad * motor.angle_rad)
                pull_n = share * drag_piston(device.leg[i], paid_out_mm, device.load_n[i], device.load_gain, dt_s)
            turn(motor, pull_n, stuck, dt_s)
    for i in range(LEGS):
        device.motor_angle[i] = device.leg[i].piston_mm / device.motor[i].lead_mm_per_rad
    moving = False
    for i in range(AXES):
        moving = moving or device.motor[i].rate_rad_per_s != 0.0
    return moving


@kernel
def _touch(device):
    """Stylet, array and anatomy, and what they put on the wires in the next tick."""
    array, wrench = device.array, device.wrench
    if device.array_loaded:
        device.stylet_mm = max(device.stylet_mm, _withdrawn(device))
        if not step_array(array, device.scala, device.pose, device.stylet_mm, device.period_s):
            device.failed = 1
            cut_power(device)
    for k in range(3):
        wrench[k] = array.wrench[k]
    _look_at_contacts(device.impedance, array)
    if device.array_loaded:
        _load_wires(device)
    else:
        device.load_n[0] = device.load_n[1] = device.load_n[2] = device.load_gain = 0.0


@kernel
def _bear(device):
    """What the sensor bears; the specimen lifts the array where it enters."""
    pose, entry = device.pose, device.scala.entry_mm
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = entry[0] - pose[0], entry[1] - pose[1]
    bear(device.sensor, device.wrench, pose[2], device.array.lift_n, c * x + s * y, c * y - s * x)


@kernel
def _look_at_contacts(impedance, array):
    """How far every electrode contact is from the modiolar wall; those on the way through the entry are in air."""
    n = array.segments
    for k in range(CONTACTS):
        place = n - impedance.contact_from_tip_mm[k] / array.edge_mm
        i = min(int(place), n - 1)
        t = place - i
        distance = math.nan
        if i >= array.inside_from:
            distance = (1.0 - t) * array.modiolar_gap_mm[i] + t * array.modiolar_gap_mm[i + 1]
        impedance.modiolar_distance_mm[k] = distance


@kernel
def _load_wires(device):
    """tau_u = J_u^-T w (01 section 1.1), and the trace of J_u^-T K J_u^-1 K_12^-1, a bound of the coupling's gain."""
    w, k, j = device.wrench, device.array.stiffness, device.wire_jacobian
    inverted = 1.0 / wire_jacobian(device.robot, device.pose, j)
    gain = 0.0
    for i in range(LEGS):
        a, b = (i + 1) % 3, (i + 2) % 3
        # column i of J_u^-1: how the gripper moves with wire i
        x = inverted * (j[a, 1] * j[b, 2] - j[a, 2] * j[b, 1])
        y = inverted * (j[a, 2] * j[b, 0] - j[a, 0] * j[b, 2])
        p = inverted * (j[a, 0] * j[b, 1] - j[a, 1] * j[b, 0])
        device.load_n[i] = w[0] * x + w[1] * y + w[2] * p
        felt = k[0] * x * x + k[3] * y * y + k[5] * p * p + 2.0 * (k[1] * x * y + k[2] * x * p + k[4] * y * p)
        gain += felt / (device.leg[i].near_n_per_mm + device.leg[i].far_n_per_mm)
    device.load_gain = gain


@kernel
def _withdrawn(device):
    """Stylet withdrawal [mm] the rod stands for, with what went wrong while it was hooked."""
    motor = device.motor[STYLET]
    pulled = motor.lead_mm_per_rad * motor.angle_rad + device.array.stylet_offset_mm
    return min(max(pulled, 0.0), STYLET_MAX_MM)


@kernel
def load_array(device, loaded):
    """The assistant puts a fresh array into the gripper and hooks its stylet, or takes it out."""
    if loaded and not device.array_loaded:
        device.array_loaded = 1
        device.stylet_mm = _withdrawn(device)
        lift(device.array)
    elif device.array_loaded and not loaded:
        device.array_loaded = 0
        device.stylet_mm = 0.0
        lift(device.array)


@kernel
def cut_power(device):
    device.powered = 0
    clear_command(device)


@kernel
def clear_command(device):
    for i in range(AXES):
        device.command_v[i] = 0.0
