"""Homing: every motor runs slowly towards its retracted end stop until all of them stand still there."""

from hal.kernel import kernel
from rtctl import hlc, llc
from rtctl.conditions import raise_condition
from rtctl.lifecycle import Condition

STILL = 0.05
"""An axis stands still when it makes less than this share of the way asked for."""


@kernel
def home(memory, record):
    """One tick of homing: lower the references, and look at the end of every stall window whether all stand still.

    The references never run further ahead than the homing command limit can act on, so the push against the stop is
    bounded. Standing still at the stops is the home pose: angles are counted from here.
    """
    state, parameters = memory.state, memory.parameters
    axes = state.setpoint.shape[0]
    for i in range(axes):
        angle = state.angle_rad[i] - state.home_offset_rad[i]
        lead = parameters.homing_limit_v / max(parameters.proportional[i], 1e-9)
        lead = min(lead, 0.5 * parameters.following_error_rad)
        if angle - state.axis_reference[i] < lead:
            state.motor_reference[i] = state.axis_reference[i] - parameters.homing_step_rad
        else:
            state.motor_reference[i] = state.axis_reference[i]
        state.integral_v[i] = 0.0
    state.homing_ticks += 1
    state.stall_ticks += 1
    if state.stall_ticks >= parameters.homing_stall_ticks:
        expected = parameters.homing_step_rad * parameters.homing_stall_ticks
        still = state.homing_ticks > 2 * parameters.homing_stall_ticks
        for i in range(axes):
            moved = state.stall_angle_rad[i] - state.angle_rad[i]
            still = still and abs(moved) < STILL * expected
            state.stall_angle_rad[i] = state.angle_rad[i]
        state.stall_ticks = 0
        if still:
            _arrive(memory)
            return
    if state.homing_ticks > parameters.homing_timeout_ticks:
        limit = float(parameters.homing_timeout_ticks)
        raise_condition(state, record, Condition.HOMING_FAILED, float(state.homing_ticks), limit)
    for i in range(axes):
        state.scratch[0][i] = state.motor_reference[i]


@kernel
def _arrive(memory):
    """Count angles from here, at the home pose, at rest."""
    state = memory.state
    dof = state.pose.shape[0]
    state.homed = 1
    for i in range(dof + 1):
        state.home_offset_rad[i] = state.angle_rad[i]
        state.compensation_rad[i] = 0.0
        state.side[i] = 0.0
        llc.rest(state, i, 0.0)
    for i in range(dof):
        state.pose[i] = memory.robot.home_pose[i]
    state.stylet_reference_mm = 0.0
    state.filter_ready = 0
    hlc.hold_here(memory)
    for i in range(dof + 1):
        state.scratch[0][i] = 0.0
