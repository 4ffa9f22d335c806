// rtctl/llc.py
#pragma once

#include <algorithm>
#include <cmath>

#include "layout.hpp"

namespace llc {
namespace {

double compensate_backlash(const Parameters &parameters, State &state, int axis, double reference) {
    const double move = reference - state.motor_reference[axis];
    if (move > 1e-9)
        state.side[axis] = 1.0;
    else if (move < -1e-9)
        state.side[axis] = 0.0;
    const double wanted = state.side[axis] * parameters.backlash_rad[axis];
    const double step = wanted - state.compensation_rad[axis];
    const double limit = parameters.backlash_step_rad;
    state.compensation_rad[axis] += std::min(std::max(step, -limit), limit);
    state.motor_reference[axis] = reference;
    return reference + state.compensation_rad[axis];
}

double pid(const Parameters &parameters, State &state, int axis, double reference, double angle, double limit_v) {
    const double period = parameters.period_s;
    const double error = reference - angle;
    const double rate = (error - state.last_error_rad[axis]) / period;
    state.rate_rad_per_s[axis] += parameters.derivative_blend * (rate - state.rate_rad_per_s[axis]);
    const double forward = parameters.feedforward[axis] * (reference - state.axis_reference[axis]) / period;
    const double proportional =
        parameters.proportional[axis] * error + parameters.derivative[axis] * state.rate_rad_per_s[axis];
    double integral = state.integral_v[axis] + parameters.integral[axis] * error * period;
    integral = std::min(std::max(integral, -parameters.integral_limit_v), parameters.integral_limit_v);
    const double command = proportional + integral + forward;
    if (std::fabs(command) <= limit_v || std::fabs(integral) < std::fabs(state.integral_v[axis]))
        state.integral_v[axis] = integral;
    state.last_error_rad[axis] = error;
    state.axis_reference[axis] = reference;
    return command;
}

double limit(const Parameters &parameters, const State &state, int axis, double command_v, double limit_v) {
    if (std::isnan(command_v)) return command_v;
    const double applied = std::min(std::max(command_v, -limit_v), limit_v);
    const double last = state.last_command_v[axis], slew = parameters.command_slew_v;
    return std::min(std::max(applied, last - slew), last + slew);
}

void rest(State &state, int axis, double angle) {
    state.motor_reference[axis] = angle - state.compensation_rad[axis];
    state.axis_reference[axis] = angle;
    state.integral_v[axis] = 0.0;
    state.rate_rad_per_s[axis] = 0.0;
    state.last_error_rad[axis] = 0.0;
    state.last_command_v[axis] = 0.0;
}

}  // namespace
}  // namespace llc
