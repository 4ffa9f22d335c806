"""Verdicts on commands: everything that speaks against one, except the operating state."""

import math

from hal.kernel import kernel
from rtctl import hlc
from rtctl.commands import Reason, Verb
from rtctl.exchange.control import ARMING_ALLOWED
from rtctl.lifecycle import Motion, Operating, Task

LAST_VERB = int(max(Verb))


@kernel
def refuse(record, reason, value, bound):
    """Note why a command is refused, and return the reason."""
    record.reason_value = value
    record.reason_bound = bound
    return reason


@kernel
def judge(memory, sensors, record):
    """Verdict on the command of this tick from everything but the lifecycle: a Reason, 1 if nothing speaks against it.

    The order is from the general to the particular: horizon, numbers, what the robot needs, what the motion needs. What
    only makes the robot safer is never too late.
    """
    command, state = memory.command, memory.state
    verb = command.verb
    if verb < 0 or verb > LAST_VERB:
        return refuse(record, Reason.UNKNOWN_VERB, float(verb), float(LAST_VERB))
    if verb == Verb.STOP or verb == Verb.DISABLE:
        return Reason.ACCEPTED
    if record.tick > command.deadline_tick:
        return refuse(record, Reason.EXPIRED, float(record.tick - command.deadline_tick), 0.0)
    for i in range(command.argument.shape[0]):
        if not math.isfinite(command.argument[i]):
            return refuse(record, Reason.NOT_FINITE, command.argument[i], float(i))
    if verb == Verb.ENABLE:
        return _judge_enable(state, record)
    if verb == Verb.LOAD_PLAN:
        if memory.staged_plan.number != int(command.argument[0]):
            return refuse(record, Reason.STALE_SLOT, command.argument[0], math.nan)
        if not hlc.is_resting(memory) or _inside(state):
            return refuse(record, Reason.BUSY, math.nan, math.nan)
        return Reason.ACCEPTED
    if verb == Verb.SET_PARAMETERS:
        if memory.staged_parameters.number != int(command.argument[0]):
            return refuse(record, Reason.STALE_SLOT, command.argument[0], math.nan)
        return Reason.ACCEPTED
    if verb == Verb.RESUME and state.paused_motion != Motion.HOLD:
        return _judge_proposal(memory, record)
    if verb <= Verb.RESUME or verb == Verb.ACKNOWLEDGE:
        return Reason.ACCEPTED
    return _judge_task(memory, sensors, record)


@kernel
def _inside(state):
    """The array is in the cochlea and the insertion has not been ended by the operator."""
    return state.on_path and state.setpoint[state.setpoint.shape[0] - 1] > 0.0 and state.task != Task.DONE


@kernel
def _judge_enable(state, record):
    """Power only for a machine that may have it, and whose motors are known: their rest is the first reference."""
    if not record.gateway_health & ARMING_ALLOWED:
        return refuse(record, Reason.NOT_REAL_TIME, math.nan, math.nan)
    for i in range(state.angle_rad.shape[0]):
        if not math.isfinite(state.angle_rad[i]):
            return refuse(record, Reason.AXES_UNKNOWN, float(i), math.nan)
    return Reason.ACCEPTED


@kernel
def _judge_task(memory, sensors, record):
    """The part of :func:`judge` for verbs that move or prepare a motion."""
    command, state, parameters = memory.command, memory.state, memory.parameters
    verb = command.verb
    depth = state.setpoint[state.setpoint.shape[0] - 1]
    if verb == Verb.UNLOAD_ARRAY:
        if not hlc.is_resting(memory) or state.unbias_left > 0:
            return refuse(record, Reason.BUSY, math.nan, math.nan)
        return refuse(record, Reason.INSERTED, depth, 0.0) if _inside(state) and depth > 0.5 else Reason.ACCEPTED
    if not sensors.powered:
        reason = Reason.WRONG_STATE if state.operating == Operating.FAULT else Reason.NO_POWER
        return refuse(record, reason, math.nan, math.nan)
    if verb == Verb.HOME:
        if state.array_loaded:
            return refuse(record, Reason.ARRAY_LOADED, math.nan, math.nan)
        return Reason.ACCEPTED if hlc.is_resting(memory) else refuse(record, Reason.BUSY, math.nan, math.nan)
    if not state.homed:
        return refuse(record, Reason.NOT_HOMED, math.nan, math.nan)
    streaming = (verb == Verb.SERVO_CP and state.motion == Motion.SERVO_CP) or (
        verb == Verb.SERVO_CV and state.motion == Motion.SERVO_CV
    )
    if (state.motion != Motion.HOLD or state.unbias_left > 0) and not streaming:
        return refuse(record, Reason.BUSY, math.nan, math.nan)
    if verb == Verb.REGISTER_ENTRY or verb == Verb.UNBIAS or verb == Verb.LOAD_ARRAY:
        if not hlc.is_resting(memory):
            return refuse(record, Reason.BUSY, math.nan, math.nan)
        if verb == Verb.UNBIAS and _inside(state):  # what it feels there must not become its zero
            return refuse(record, Reason.INSERTED, depth, 0.0)
        if verb != Verb.LOAD_ARRAY:
            return Reason.ACCEPTED
        if state.stylet_reference_mm > 0.0 and not state.array_loaded:  # the rod is still on its way back
            return refuse(record, Reason.BUSY, math.nan, math.nan)
        return refuse(record, Reason.ARRAY_LOADED, math.nan, math.nan) if state.array_loaded else Reason.ACCEPTED
    if verb == Verb.INSERT or verb == Verb.RETRACT or verb == Verb.APPROACH:
        if state.plan_number == 0:
            return refuse(record, Reason.NO_PLAN, math.nan, math.nan)
        if not state.array_loaded:
            return refuse(record, Reason.NO_ARRAY, math.nan, math.nan)
    if verb == Verb.INSERT:
        if not state.unbiased:
            return refuse(record, Reason.NOT_UNBIASED, math.nan, math.nan)
        away, tolerance = _distance_to_plan(memory), parameters.entry_tolerance_mm
        if not (state.task == Task.HOLDING or (state.task == Task.AT_ENTRY and away <= tolerance)):
            return refuse(record, Reason.NOT_AT_ENTRY, away, tolerance)
    if verb == Verb.RETRACT and not state.on_path:
        return refuse(record, Reason.NOT_AT_ENTRY, _distance_to_plan(memory), parameters.entry_tolerance_mm)
    if (verb == Verb.MOVE_CP or verb == Verb.SERVO_CP or verb == Verb.SERVO_CV or verb == Verb.APPROACH) and _inside(
        state
    ):
        return refuse(record, Reason.INSERTED, depth, 0.0)
    if verb == Verb.SERVO_CV:
        for i in range(state.pose.shape[0]):
            if abs(command.argument[i]) > parameters.speed[i]:
                return refuse(record, Reason.SPEED, command.argument[i], parameters.speed[i])
        return Reason.ACCEPTED
    return _judge_proposal(memory, record)


@kernel
def _judge_proposal(memory, record):
    """What the planner said about the motion."""
    proposal = memory.proposal
    if proposal.reason != Reason.ACCEPTED:
        return refuse(record, proposal.reason, proposal.reason_value, proposal.reason_bound)
    return Reason.ACCEPTED


@kernel
def _distance_to_plan(memory):
    """Distance of the setpoint from the first pose of the plan [mm], over the lengths of the pose."""
    squares = 0.0
    for i in range(memory.parameters.length_dofs):
        squares += (memory.state.setpoint[i] - memory.plan.coefficient[0, i, 3]) ** 2
    return math.sqrt(squares)
