"""High-level controller: turns commands into a setpoint of the pose and of the insertion depth.

One profile moves everything: in a move or a servo motion it carries the pose, in an insertion or retraction only the
depth, and the pose and the stylet follow the planned path at that depth. Stopping is a change of velocity to zero
in whatever the profile carries, so an interrupted insertion stays on its path. A robot that is not quite on the path
where it begins to follow it, or is enabled again inside, comes back to it over the way, not at once.
"""

import math

from hal.kernel import kernel
from rtctl import llc, wrench
from rtctl import profile as profiles
from rtctl.commands import Verb
from rtctl.conditions import raise_condition
from rtctl.electrode.path import evaluate_path
from rtctl.lifecycle import Condition, Motion, Task
from rtctl.robots.interface import REACHABLE, reach, translate

RETURN_MM = 1.0
"""Way along the path over which a distance from it falls to 1/e."""


@kernel
def hold_here(memory):
    """Forget every motion and take the measured pose as the setpoint: bumpless, nothing moves, inside the cochlea too."""
    state = memory.state
    for i in range(state.pose.shape[0]):
        state.setpoint[i] = state.pose[i]
        state.reference[i] = state.pose[i]
        state.pose_goal[i] = state.pose[i]
    for i in range(state.setpoint.shape[0]):
        state.setpoint_rate[i] = 0.0
        state.setpoint_acceleration[i] = 0.0
    state.motion = Motion.HOLD
    state.paused_motion = Motion.HOLD
    _end_task(state)
    profiles.clear(memory.profile, state.tick)
    if state.on_path:
        back = state.scratch[0]
        for i in range(3):
            back[i] = -state.lateral_offset_mm[i]
        translate(memory.robot, state.setpoint, back)
        _keep_distance(memory)


@kernel
def _keep_distance(memory):
    """The setpoint stays where it is although the path at the present depth is elsewhere."""
    state = memory.state
    at = state.scratch[0]
    evaluate_path(memory.plan, state.setpoint[state.pose.shape[0]], at, state.scratch[1])
    for i in range(state.pose.shape[0]):
        state.path_offset[i] = state.setpoint[i] - at[i]


@kernel
def _leave_path(memory):
    """From now on the pose is the setpoint, and it begins at the reference, so that the lateral correction is no step."""
    state = memory.state
    if state.on_path:
        for i in range(state.pose.shape[0]):
            state.setpoint[i] = state.reference[i]
    for i in range(3):
        state.lateral_offset_mm[i] = state.way_offset_mm[0, i] = 0.0
    state.on_path = 0
    state.setpoint[state.pose.shape[0]] = 0.0


@kernel
def is_resting(memory):
    """No motion is wanted, and the brake of the last one has come to its end."""
    elapsed_s = (memory.state.tick - memory.profile.start_tick) * memory.parameters.period_s
    return memory.state.motion == Motion.HOLD and elapsed_s >= memory.profile.duration_s


@kernel
def _end_task(state):
    """An interrupted approach is no approach; an interrupted insertion holds where it is."""
    if state.task == Task.APPROACH:
        state.task = Task.IDLE
    if state.task == Task.INSERTING or state.task == Task.RETRACTING:
        state.task = Task.HOLDING


@kernel
def brake(memory, cause, setpoint_tick):
    """End the motion under way within the limits of acceleration and jerk, and hold where that leads.

    setpoint_tick: the tick the present setpoint belongs to, which is the last one before `advance`.
    """
    state = memory.state
    if state.motion == Motion.HOLD:
        return
    if state.motion == Motion.HOME:
        for i in range(state.setpoint.shape[0]):
            llc.rest(state, i, state.angle_rad[i] - state.home_offset_rad[i])
    else:
        _change_velocity(memory, 0, setpoint_tick)
    state.motion = Motion.HOLD
    state.stop_cause = cause
    _end_task(state)


@kernel
def _change_velocity(memory, servo, setpoint_tick):
    """New profile that brings every moving channel to the commanded rate (servo) or to rest."""
    state, parameters, profile = memory.state, memory.parameters, memory.profile
    depth = state.pose.shape[0]
    profiles.clear(profile, setpoint_tick)
    first, last = (depth, depth + 1) if state.on_path else (0, depth)
    for c in range(first, last):
        target = memory.command.argument[c] if servo else 0.0
        profiles.append_velocity_change(
            profile,
            c,
            state.setpoint[c],
            state.setpoint_rate[c],
            state.setpoint_acceleration[c],
            target,
            parameters.acceleration[c],
            parameters.jerk[c],
        )


@kernel
def obey(memory, record):
    """Carry out the accepted command of this tick. Lifecycle verbs have been carried out already."""
    command, state = memory.command, memory.state
    verb = command.verb
    if verb == Verb.STOP:
        if state.motion == Motion.HOLD and state.task == Task.HOLDING:
            state.task = Task.DONE
        brake(memory, -1, state.tick - 1)
        state.paused_motion = Motion.HOLD
    elif verb == Verb.LOAD_PLAN:
        memory.plan = memory.staged_plan
        state.plan_number = memory.plan.number
        state.task = Task.IDLE
        _leave_path(memory)
        profiles.clear(memory.profile, state.tick)
    elif verb == Verb.SET_PARAMETERS:
        if wrench.is_other_filter(memory.staged_parameters, memory.parameters):
            state.filter_ready = 0  # what a filter remembers means something else to another one
        memory.parameters = memory.staged_parameters
    elif verb == Verb.REGISTER_ENTRY:
        for i in range(state.pose.shape[0]):
            state.pose_entry[i] = state.pose[i]
    elif verb == Verb.LOAD_ARRAY or verb == Verb.UNLOAD_ARRAY:
        state.array_loaded = 1 if verb == Verb.LOAD_ARRAY else 0
        state.unbiased = 0
        state.plan_number = 0
        state.task = Task.IDLE
        state.stylet_extra_mm = 0.0
        _leave_path(memory)
        profiles.clear(memory.profile, state.tick)
    elif verb == Verb.UNBIAS:
        state.unbiased = 0
        state.unbias_left = memory.parameters.unbias_ticks
        for i in range(6):
            state.unbias_sum[i] = 0.0
    elif verb == Verb.HOME:
        _begin_homing(memory)
    elif verb == Verb.RESUME or verb >= Verb.MOVE_CP:
        _begin_motion(memory, record)


@kernel
def _begin_homing(memory):
    state = memory.state
    _leave_path(memory)
    state.motion = Motion.HOME
    state.homed = 0
    state.homing_ticks = 0
    state.stall_ticks = 0
    state.task = Task.IDLE


@kernel
def _begin_motion(memory, record):
    """Adopt the proposed profile, or build the one of a velocity stream."""
    command, state = memory.command, memory.state
    verb = command.verb
    if verb == Verb.RESUME:
        paused = state.paused_motion
        state.paused_motion = Motion.HOLD
        if paused == Motion.HOLD:
            return
        verb = (Verb.INSERT if paused == Motion.INSERT else Verb.RETRACT) + 0
    elif verb == Verb.INSERT or verb == Verb.RETRACT:
        state.depth_goal_mm = command.argument[0]
        state.depth_speed_mm_per_s = command.argument[1]
    state.stop_cause = -1
    state.stream_tick = record.tick
    if verb == Verb.INSERT or verb == Verb.RETRACT:
        memory.profile = memory.proposal
        if not state.on_path:
            state.on_path = 1
            _keep_distance(memory)
        state.motion = Motion.INSERT if verb == Verb.INSERT else Motion.RETRACT
        state.task = Task.INSERTING if verb == Verb.INSERT else Task.RETRACTING
        evaluate_goal(memory)
        return
    _leave_path(memory)
    if verb == Verb.APPROACH:
        state.task = Task.APPROACH
    elif state.task != Task.DONE:
        state.task = Task.IDLE
    if verb == Verb.SERVO_CV:
        state.motion = Motion.SERVO_CV
        _change_velocity(memory, 1, state.tick - 1)
        for i in range(state.pose.shape[0]):
            state.pose_goal[i] = math.nan
        return
    memory.profile = memory.proposal
    state.motion = Motion.SERVO_CP if verb == Verb.SERVO_CP else Motion.MOVE
    for i in range(state.pose.shape[0]):
        state.pose_goal[i] = profiles.final_position(memory.profile, i)


@kernel
def evaluate_goal(memory):
    """Pose at the depth where the motion along the path will end."""
    state = memory.state
    out = state.scratch[0]
    evaluate_path(memory.plan, state.depth_goal_mm, out, state.scratch[1])
    for i in range(state.pose.shape[0]):
        state.pose_goal[i] = out[i]


@kernel
def advance(memory, record):
    """Move the setpoint by one tick along the profile; end motions that have arrived. Writes the planned stylet."""
    state, profile = memory.state, memory.profile
    dof = state.pose.shape[0]
    depth = state.setpoint[dof]
    if state.motion == Motion.SERVO_CV:
        _look_ahead(memory, record)
    time = (state.tick - profile.start_tick) * memory.parameters.period_s
    for c in range(dof + 1):
        if profile.segments[c] > 0:
            p, v, a = profiles.evaluate(profile, c, time)
            state.setpoint[c] = p
            state.setpoint_rate[c] = v
            state.setpoint_acceleration[c] = a
    if state.on_path:
        out = state.scratch[0]
        slope = state.scratch[1]
        evaluate_path(memory.plan, state.setpoint[dof], out, slope)
        stays = max(1.0 - abs(state.setpoint[dof] - depth) / RETURN_MM, 0.0)
        for i in range(dof):
            state.path_offset[i] *= stays
            state.setpoint[i] = out[i] + state.path_offset[i]
            state.setpoint_rate[i] = slope[i] * state.setpoint_rate[dof]
            state.setpoint_acceleration[i] = 0.0
        record.stylet_desired_mm = out[dof]
    ends = state.motion == Motion.MOVE or state.motion == Motion.INSERT or state.motion == Motion.RETRACT
    if ends and time >= profile.duration_s:
        _arrive(state)


@kernel
def _arrive(state):
    """A profile that ends at rest has ended (of streams the client decides when): say what that means for the task."""
    if state.motion == Motion.INSERT:
        state.task = Task.HOLDING
    elif state.motion == Motion.RETRACT:
        state.task = Task.DONE if state.setpoint[state.setpoint.shape[0] - 1] <= 1e-9 else Task.HOLDING
    elif state.task == Task.APPROACH:
        state.task = Task.AT_ENTRY
    state.motion = Motion.HOLD


@kernel
def _look_ahead(memory, record):
    """Brake a velocity stream now if it could not stop inside the workspace any more after this tick's step.

    So the way to rest from where the setpoint is ends inside, always. It is at most v |a|/j + a^3/3j^2 until the
    acceleration is gone, then v'/2 (v'/A + A/j) from the velocity v' that leaves, A being the limit.
    """
    state, parameters, profile = memory.state, memory.parameters, memory.profile
    dof = state.pose.shape[0]
    time = (state.tick - profile.start_tick) * parameters.period_s
    ahead = state.scratch[0][:dof]
    worst = math.nan
    for i in range(dof):
        limit, j = parameters.acceleration[i], parameters.jerk[i]
        p, v, a = profiles.evaluate(profile, i, time)
        left = v + 0.5 * a * abs(a) / j
        ahead[i] = p + v * abs(a) / j + a * a * a / (3.0 * j * j) + 0.5 * left * (abs(left) / limit + limit / j)
        if not memory.robot.box_low[i] <= ahead[i] <= memory.robot.box_high[i]:
            worst = ahead[i]
    if reach(memory.robot, ahead) != REACHABLE:
        raise_condition(state, record, Condition.WORKSPACE, worst, math.nan)
        brake(memory, Condition.WORKSPACE, state.tick - 1)
