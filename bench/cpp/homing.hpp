// rtctl/homing.py
#pragma once

#include <algorithm>
#include <cmath>

#include "conditions.hpp"
#include "hlc.hpp"
#include "llc.hpp"
#include "layout.hpp"

namespace homing {
namespace {

void arrive(Memory &memory, double *reference) {
    State &state = memory.state;
    state.homed = 1;
    for (int i = 0; i < AXES; ++i) {
        state.home_offset_rad[i] = state.angle_rad[i];
        state.compensation_rad[i] = 0.0;
        state.side[i] = 0.0;
        llc::rest(state, i, 0.0);
        reference[i] = 0.0;
    }
    for (int i = 0; i < DOF; ++i) state.pose[i] = memory.robot.home_pose[i];
    state.stylet_reference_mm = 0.0;
    state.filter_ready = 0;
    hlc::hold_here(memory);
}

void home(Memory &memory, Record &record, double *reference) {
    State &state = memory.state;
    const Parameters &parameters = memory.parameters;
    for (int i = 0; i < AXES; ++i) {
        const double angle = state.angle_rad[i] - state.home_offset_rad[i];
        double lead = parameters.homing_limit_v / std::max(parameters.proportional[i], 1e-9);
        lead = std::min(lead, 0.5 * parameters.following_error_rad);
        if (angle - state.axis_reference[i] < lead)
            state.motor_reference[i] = state.axis_reference[i] - parameters.homing_step_rad;
        else
            state.motor_reference[i] = state.axis_reference[i];
        state.integral_v[i] = 0.0;
    }
    state.homing_ticks += 1;
    state.stall_ticks += 1;
    if (state.stall_ticks >= parameters.homing_stall_ticks) {
        const double expected = parameters.homing_step_rad * double(parameters.homing_stall_ticks);
        bool still = state.homing_ticks > 2 * parameters.homing_stall_ticks;
        for (int i = 0; i < AXES; ++i) {
            const double moved = state.stall_angle_rad[i] - state.angle_rad[i];
            still = still && std::fabs(moved) < STILL * expected;
            state.stall_angle_rad[i] = state.angle_rad[i];
        }
        state.stall_ticks = 0;
        if (still) {
            arrive(memory, reference);
            return;
        }
    }
    if (state.homing_ticks > parameters.homing_timeout_ticks) {
        conditions::raise_condition(state, record, Condition::HOMING_FAILED, double(state.homing_ticks),
                        double(parameters.homing_timeout_ticks));
    }
    for (int i = 0; i < AXES; ++i) reference[i] = state.motor_reference[i];
}

}  // namespace
}  // namespace homing
