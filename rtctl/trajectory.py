"""From the setpoint of this tick to the reference pose: admittance and the limits of the task space (D III.7).

The lateral correction is added after the profile. What leaves the workspace, or moves faster than any limit allows,
is not followed: the last good reference stays.
"""

import math

from hal.kernel import kernel
from rtctl import admittance, way_back
from rtctl.conditions import raise_condition
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.robots.interface import REACHABLE, reach, translate

OVERSPEED = 1.5
"""A profile, a path and a correction together may exceed the speed of one of them; more is an error of the plan."""


@kernel
def correct(memory, record):
    """Run the admittance laws while an array is being inserted or held; on the way back undo what they did on the way in."""
    parameters, state = memory.parameters, memory.state
    depth = state.setpoint[state.setpoint.shape[0] - 1]
    force = record.wrench_in_base
    active = state.operating == Operating.ENABLED and (state.task == Task.INSERTING or state.task == Task.HOLDING)
    known = state.unbiased and math.isfinite(force[0])
    if active and known and parameters.lateral_on:
        reached = admittance.lateral(parameters, memory.plan.insertion_axis_in_base, force, state.lateral_offset_mm)
        if reached >= parameters.lateral_limit_mm:
            limit = parameters.lateral_limit_mm
            raise_condition(state, record, Condition.ADMITTANCE_SATURATED, reached, limit)
    if active and known and parameters.stylet_on and state.task == Task.INSERTING:
        rate = admittance.stylet_rate(parameters, record.force_axial_n, depth)
        state.stylet_extra_mm += rate * parameters.period_s
    if active:
        way_back.remember(state.way_offset_mm, depth, state.lateral_offset_mm)
    elif state.task == Task.RETRACTING:
        way_back.undo(state.way_offset_mm, state.way_depth_mm, depth, state.lateral_offset_mm)
    state.way_depth_mm = depth


@kernel
def follow_stylet(memory, record):
    """With an array the stylet only ever comes out, at its own speed at most; without one the empty rod goes back."""
    parameters, state = memory.parameters, memory.state
    if not state.array_loaded:
        state.stylet_reference_mm = max(state.stylet_reference_mm - parameters.stylet_step_mm, 0.0)
    resting = state.setpoint_rate[state.setpoint.shape[0] - 1] == 0.0
    if not state.on_path or (state.operating == Operating.PAUSED and resting):
        return
    wanted = record.stylet_desired_mm + state.stylet_extra_mm
    if wanted >= parameters.stylet_stroke_mm:
        wanted = parameters.stylet_stroke_mm
        raise_condition(state, record, Condition.STYLET_LIMIT, wanted, wanted)
    step = min(wanted - state.stylet_reference_mm, parameters.stylet_step_mm)
    state.stylet_reference_mm += max(step, 0.0)


@kernel
def refer(memory, record):
    """Reference pose of this tick from setpoint and correction; keeps the last one rather than leave the workspace.

    A robot that is outside already (measured there when it was enabled, or its limits were changed) may come back in.
    """
    parameters, state = memory.parameters, memory.state
    dof = state.pose.shape[0]
    candidate = state.scratch[0][:dof]
    for i in range(dof):
        candidate[i] = state.setpoint[i]
    if state.on_path:
        translate(memory.robot, candidate, state.lateral_offset_mm)
    _limit_step(parameters, state, record, candidate)
    outside = reach(memory.robot, state.reference) != REACHABLE
    if not outside and reach(memory.robot, candidate) != REACHABLE:
        worst = math.nan
        for i in range(dof):
            if not memory.robot.box_low[i] <= candidate[i] <= memory.robot.box_high[i]:
                worst = candidate[i]
        raise_condition(state, record, Condition.WORKSPACE, worst, math.nan)
        return
    for i in range(dof):
        state.reference[i] = candidate[i]


@kernel
def _limit_step(parameters, state, record, candidate):
    """Shorten a step of the reference that no profile could have asked for."""
    lengths = parameters.length_dofs
    dof = candidate.shape[0]
    share = 1.0
    for first, last in ((0, lengths), (lengths, dof)):
        squares = 0.0
        for i in range(first, last):
            squares += (candidate[i] - state.reference[i]) ** 2
        limit = OVERSPEED * parameters.speed[first] * parameters.period_s if last > first else math.inf
        step = math.sqrt(squares)
        if step > limit:
            share = min(share, limit / step)
    if share < 1.0:
        raise_condition(state, record, Condition.SPEED_LIMIT, share, 1.0)
        for i in range(dof):
            candidate[i] = state.reference[i] + share * (candidate[i] - state.reference[i])
