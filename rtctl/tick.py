"""One tick of the controller, top to bottom like the block diagram of the dissertation (Fig. III.16).

    sensors -> pose -> wrench -> command -> setpoint -> admittance -> trajectory -> motors -> safety -> record

Everything it needs is in its arguments, everything it changes too: no clock, no allocation, no call out.
"""

import math

from hal.frames import VALID
from hal.kernel import kernel
from rtctl import conditions, hlc, llc, trajectory, wrench
from rtctl.commands import Reason, Verb
from rtctl.guidance import watch
from rtctl.guidance.impedance import law
from rtctl.homing import home
from rtctl.judge import judge
from rtctl.lifecycle import FAULT_MASK, PAUSE_MASK, STOP_MASK, Motion, Operating, step
from rtctl.robots.interface import forward, inverse, rotation


@kernel
def tick(memory, sensors, actuators, record):
    """Run one tick: read `sensors`, write `actuators`, and put everything of interest into `record`.

    The caller has filled the inputs of the record (tick, time_ns, missed_ticks, gateway_health) and
    memory.command, with memory.proposal if the command is a motion.
    """
    memory.state.tick = record.tick
    begin(memory, sensors, record)
    know_pose(memory, record)
    know_force(memory, sensors, record)
    law.listen(memory, record)
    conditions.watch_inputs(memory.parameters, memory.state, sensors, record)
    watch.watch(memory, record)
    decide(memory, sensors, record)
    if memory.state.homed and sensors.powered and memory.state.operating != Operating.FAULT:
        hlc.advance(memory, record)
        trajectory.correct(memory, record)
        law.guide(memory, record)
        trajectory.follow_stylet(memory, record)
        trajectory.refer(memory, record)
    drive(memory, sensors, record)
    conditions.watch_outputs(memory.parameters, memory.state, record)
    protect(memory, record)
    act(memory, sensors, actuators, record)
    report(memory, record)


@kernel
def step_arrays(memory, sensors, actuators, record):
    """:func:`tick` for callers in Python, which pass whole arrays (1,): a record would be looked at anew every call."""
    tick(memory[0], sensors[0], actuators[0], record[0])


@kernel
def begin(memory, sensors, record):
    """Copy what came in, so that the record can be replayed; bridge a short silence with the last valid angles.

    A motion stands still over ticks that were missed: it goes on from where it was, later, and never jumps ahead.
    """
    command, state = memory.command, memory.state
    memory.profile.start_tick += record.missed_ticks
    valid = sensors.axes_validity == VALID
    state.axes_silent_ticks = sensors.axes_age_ticks if valid else state.axes_silent_ticks + 1
    for i in range(sensors.axis_angle_rad.shape[0]):
        record.axis_angle_rad[i] = sensors.axis_angle_rad[i]
        if valid:
            state.angle_rad[i] = sensors.axis_angle_rad[i]
    for i in range(6):
        record.wrench_in_sensor[i] = sensors.wrench_in_sensor[i]
    record.impedance_ohm = sensors.impedance_ohm
    record.impedance_pair = sensors.impedance_pair
    record.axes_sequence = sensors.axes_sequence
    record.wrench_sequence = sensors.wrench_sequence
    record.impedance_sequence = sensors.impedance_sequence
    record.axes_age_ticks = sensors.axes_age_ticks
    record.wrench_age_ticks = sensors.wrench_age_ticks
    record.impedance_age_ticks = sensors.impedance_age_ticks
    record.axes_validity = sensors.axes_validity
    record.wrench_validity = sensors.wrench_validity
    record.impedance_validity = sensors.impedance_validity
    record.powered = sensors.powered
    record.watchdog_tripped = sensors.watchdog_tripped
    record.amplifier_fault = sensors.amplifier_fault
    record.trouble, record.trouble_grade = sensors.trouble, sensors.trouble_grade
    record.trouble_device, record.trouble_value = sensors.trouble_device, sensors.trouble_value
    record.command_sequence = command.sequence
    record.command_verb = command.verb
    record.command_source = command.source
    record.command_deadline_tick = command.deadline_tick
    for i in range(8):
        record.command_argument[i] = command.argument[i]
    record.stylet_desired_mm = state.stylet_reference_mm
    record.reason_value = math.nan
    record.reason_bound = math.nan
    record.condition_active = 0
    record.condition_reported = -1
    record.condition_value = math.nan
    record.condition_bound = math.nan


@kernel
def know_pose(memory, record):
    """Pose, strokes and stylet from the motor angles; NaN until homed."""
    state, dof = memory.state, memory.state.pose.shape[0]
    record.kinematic_iterations = 0
    if state.homed:
        angle = state.scratch[0][:dof]
        for i in range(dof):
            angle[i] = state.angle_rad[i] - state.home_offset_rad[i] - state.compensation_rad[i]
        record.kinematic_iterations = forward(memory.robot, angle, state.pose)
        rotation(memory.robot, state.pose, state.rotation)
        inverse(memory.robot, state.pose, state.joint, angle)
    known = state.homed and record.kinematic_iterations >= 0
    for i in range(dof):
        record.pose_measured[i] = state.pose[i] if known else math.nan
        record.joint_measured[i] = state.joint[i] if known else math.nan
    stylet = state.angle_rad[dof] - state.home_offset_rad[dof] - state.compensation_rad[dof]
    record.stylet_measured_mm = stylet * memory.parameters.stylet_lead_mm_per_rad if state.homed else math.nan


@kernel
def know_force(memory, sensors, record):
    """Compensated wrench, and its parts along and across the insertion axis; NaN until homed and unbiased."""
    state = memory.state
    if state.homed:
        wrench.compensate(memory.parameters, state, sensors, record)
    else:
        for i in range(6):
            record.wrench_in_base[i] = math.nan
    f = record.wrench_in_base
    planned = state.plan_number > 0
    axial, squares = 0.0, 0.0
    for i in range(3):
        axis = memory.plan.insertion_axis_in_base[i] if planned else state.rotation[i, 0]
        axial += f[i] * axis
        squares += f[i] * f[i]
    record.force_axial_n = axial
    record.force_lateral_n = math.sqrt(max(squares - axial * axial, 0.0)) if math.isfinite(axial) else math.nan


@kernel
def decide(memory, sensors, record):
    """The command of this tick and the conditions so far, through the lifecycle."""
    state = memory.state
    before, verb = state.operating, memory.command.verb
    verdict = 0
    if verb != Verb.NONE:
        verdict = judge(memory, sensors, record)
        if verdict != Reason.ACCEPTED:
            verb = Verb.NONE + 0
    retracting = state.motion == Motion.RETRACT
    state.operating, judged = step(before, record.condition_active, verb, retracting)
    if verb != Verb.NONE:
        verdict = judged
    transit(memory, before, record, state.tick - 1)
    if verb != Verb.NONE and verdict == Reason.ACCEPTED:
        if verb == Verb.ACKNOWLEDGE:
            state.latched = record.condition_active
            state.fault_cause = -1
        hlc.obey(memory, record)
    if record.condition_active & STOP_MASK:
        hlc.brake(memory, first_bit(record.condition_active & STOP_MASK), state.tick - 1)
    record.command_verdict = verdict


@kernel
def transit(memory, before, record, setpoint_tick):
    """What a change of the operating state does by itself: every one clears what was pending.

    setpoint_tick: the tick the present setpoint belongs to.
    """
    state = memory.state
    after = state.operating
    if after == before:
        return
    if after == Operating.FAULT:
        state.fault_cause = first_bit(record.condition_active & FAULT_MASK)
    if after == Operating.PAUSED:
        interrupted = state.motion
        hlc.brake(memory, first_bit(record.condition_active & PAUSE_MASK), setpoint_tick)
        on_path = interrupted == Motion.INSERT or interrupted == Motion.RETRACT
        state.paused_motion = interrupted if on_path else Motion.HOLD + 0
    if after == Operating.FAULT or after == Operating.DISABLED or before == Operating.DISABLED:
        hlc.hold_here(memory)
        state.unbias_left = 0
        state.power_ticks = 0


@kernel
def first_bit(bits):
    """Number of the lowest set bit, -1 for none."""
    for i in range(63):
        if (bits >> i) & 1:
            return i
    return -1


@kernel
def drive(memory, sensors, record):
    """Motor references and PID; a robot without power or in fault follows its own motors."""
    state, parameters = memory.state, memory.parameters
    axes, dof = state.setpoint.shape[0], state.pose.shape[0]
    reference = state.scratch[0]
    if not sensors.powered or state.operating == Operating.FAULT:
        hlc.hold_here(memory)
        for i in range(axes):
            llc.rest(state, i, state.angle_rad[i] - state.home_offset_rad[i])
    if state.motion == Motion.HOME:
        home(memory, record)
        control(memory, record, parameters.homing_limit_v)
        return
    if state.homed and sensors.powered:
        inverse(memory.robot, state.reference, state.joint_reference, reference[:dof])
        reference[dof] = state.stylet_reference_mm / parameters.stylet_lead_mm_per_rad
        for i in range(axes):
            reference[i] = llc.compensate_backlash(parameters, state, i, reference[i])
    else:
        for i in range(axes):
            reference[i] = state.axis_reference[i]
    control(memory, record, parameters.command_limit_v)


@kernel
def control(memory, record, limit_v):
    """PID of every axis towards the references in scratch[0], home-referenced [rad]."""
    state, parameters = memory.state, memory.parameters
    for i in range(state.setpoint.shape[0]):
        reference = state.scratch[0][i]
        angle = state.angle_rad[i] - state.home_offset_rad[i]
        command = llc.pid(parameters, state, i, reference, angle, limit_v)
        record.axis_reference_rad[i] = reference + state.home_offset_rad[i]
        record.command_desired_v[i] = command
        record.command_applied_v[i] = llc.limit(parameters, state, i, command, limit_v)


@kernel
def protect(memory, record):
    """The lifecycle again, for what only the computed output shows. A fault acts in this tick."""
    state = memory.state
    before = state.operating
    state.operating, _ = step(before, record.condition_active, Verb.NONE + 0, state.motion == Motion.RETRACT)
    transit(memory, before, record, state.tick)
    if record.condition_active & STOP_MASK:
        hlc.brake(memory, first_bit(record.condition_active & STOP_MASK), state.tick)
    state.active = record.condition_active


@kernel
def act(memory, sensors, actuators, record):
    """Write the actuator frame: the applied command where there is power to use it, the safe output elsewhere."""
    state = memory.state
    enabled = state.operating == Operating.ENABLED or state.operating == Operating.PAUSED
    for i in range(state.setpoint.shape[0]):
        live = enabled and sensors.powered and math.isfinite(record.command_applied_v[i])
        command = record.command_applied_v[i] if live else 0.0
        record.command_applied_v[i] = command
        state.last_command_v[i] = command
        actuators.command_v[i] = command
    state.power_ticks = state.power_ticks + 1 if enabled else 0
    actuators.power = 1 if enabled else 0
    actuators.array_loaded = state.array_loaded
    record.power_request = actuators.power
    state.latched |= record.condition_active


@kernel
def report(memory, record):
    """The rest of the record: where everything stands at the end of the tick."""
    state = memory.state
    dof = state.pose.shape[0]
    known = state.homed != 0
    for i in range(dof):
        record.pose_goal[i] = state.pose_goal[i] if known else math.nan
        record.pose_desired[i] = state.setpoint[i] if known else math.nan
        record.pose_reference[i] = state.reference[i] if known else math.nan
        record.pose_entry[i] = state.pose_entry[i]
        record.joint_reference[i] = state.joint_reference[i] if known else math.nan
    for i in range(3):
        record.admittance_offset_mm[i] = state.lateral_offset_mm[i]
    record.depth_mm = state.setpoint[dof]
    record.depth_goal_mm = state.depth_goal_mm
    record.depth_rate_mm_per_s = state.setpoint_rate[dof]
    record.stylet_reference_mm = state.stylet_reference_mm
    record.condition_latched = state.latched
    record.parameter_set = memory.parameters.number
    record.plan_number = state.plan_number
    record.fault_cause = state.fault_cause
    record.stop_cause = state.stop_cause
    record.operating_state = state.operating
    record.task_state = state.task
    record.motion = state.motion
    record.is_homed = state.homed
    returning = state.array_loaded == 0 and state.stylet_reference_mm > 0.0
    record.is_busy = not hlc.is_resting(memory) or state.unbias_left > 0 or returning
    record.is_unbiased = state.unbiased
    record.array_loaded = state.array_loaded
