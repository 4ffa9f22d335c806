// rtctl/conditions.py
#pragma once

#include <algorithm>
#include <cmath>

#include "layout.hpp"

namespace conditions {
namespace {

void raise_condition(State &state, Record &record, int64_t condition, double value, double bound) {
    const int64_t bit = int64_t{1} << condition;
    record.condition_active |= bit;
    state.latched |= bit;
    const bool is_new = (state.active & bit) == 0;
    if (is_new && (record.condition_reported < 0 || REACTION[condition] > REACTION[record.condition_reported])) {
        record.condition_reported = int32_t(condition);
        record.condition_value = value;
        record.condition_bound = bound;
    }
}

void watch_force(const Parameters &parameters, State &state, const Sensors &sensors, Record &record) {
    const double *f = record.wrench_in_base;
    const bool known = sensors.wrench_validity == VALID && sensors.wrench_age_ticks <= parameters.wrench_age_ticks &&
                       std::isfinite(f[0]);
    if (state.task == Task::INSERTING && !known)
        raise_condition(state, record, Condition::WRENCH_LOST, double(sensors.wrench_age_ticks),
                        double(parameters.wrench_age_ticks));
    if (known) {
        const double force = std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        if (force > parameters.force_limit_n)
            raise_condition(state, record, Condition::FORCE_LIMIT, force, parameters.force_limit_n);
    }
}

void watch_overruns(const Parameters &parameters, State &state, Record &record) {
    const int64_t window = record.tick / parameters.overrun_window_ticks, limit = parameters.overrun_window_limit;
    if (window != state.overrun_window) {
        state.overrun_run = state.overrun_missed > limit ? state.overrun_run + 1 : 0;
        state.overrun_window = window;
        state.overrun_missed = 0;
    }
    state.overrun_missed = std::min<int64_t>(state.overrun_missed + record.missed_ticks, parameters.overrun_window_ticks);
    const int64_t run = state.overrun_run + (state.overrun_missed > limit ? 1 : 0);
    if (run > 0)
        raise_condition(state, record, Condition::OVERRUN_PERSISTENT, double(state.overrun_missed), double(limit));
    if (run >= parameters.overrun_windows)
        raise_condition(state, record, Condition::OVERRUN_UNABATED, double(run), double(parameters.overrun_windows));
}

void watch_drift(const Parameters &parameters, State &state, const Sensors &sensors, Record &record) {
    const auto &f = record.wrench_in_base;
    const bool outside = state.task == Task::IDLE || state.task == Task::APPROACH || state.task == Task::AT_ENTRY;
    const double force = std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    const bool drifts = outside && state.array_loaded && sensors.wrench_validity == VALID &&
                        force > parameters.drift_limit_n;
    state.drift_ticks = drifts ? state.drift_ticks + 1 : 0;
    if (state.drift_ticks > parameters.drift_ticks)
        raise_condition(state, record, Condition::FORCE_DRIFT, force, parameters.drift_limit_n);
}

void watch_inputs(const Parameters &parameters, State &state, const Sensors &sensors, Record &record) {
    if (std::isfinite(state.angle_rad[0]) && state.axes_silent_ticks > parameters.axes_age_ticks) {
        raise_condition(state, record, Condition::AXES_LOST, double(state.axes_silent_ticks),
                        double(parameters.axes_age_ticks));
        state.homed = 0;
    }
    if (sensors.watchdog_tripped) raise_condition(state, record, Condition::WATCHDOG, NOT_KNOWN, NOT_KNOWN);
    if (sensors.amplifier_fault) raise_condition(state, record, Condition::AMPLIFIER, NOT_KNOWN, NOT_KNOWN);
    if (sensors.trouble_grade == TROUBLE_WARNING)
        raise_condition(state, record, Condition::DEVICE_WARNING, double(sensors.trouble), sensors.trouble_value);
    else if (sensors.trouble_grade == TROUBLE_PAUSE)
        raise_condition(state, record, Condition::DEVICE_PAUSE, double(sensors.trouble), sensors.trouble_value);
    else if (sensors.trouble_grade >= TROUBLE_FAULT)
        raise_condition(state, record, Condition::DEVICE_FAULT, double(sensors.trouble), sensors.trouble_value);
    if (state.power_ticks > parameters.power_on_ticks && sensors.powered == 0)
        raise_condition(state, record, Condition::POWER_LOST, double(state.power_ticks),
                        double(parameters.power_on_ticks));
    if (state.homed && record.kinematic_iterations < 0)
        raise_condition(state, record, Condition::KINEMATICS, NOT_KNOWN, NOT_KNOWN);
    const bool moving = state.motion != Motion::HOLD;
    if (moving && state.array_loaded && state.task != Task::RETRACTING)
        watch_force(parameters, state, sensors, record);
    watch_drift(parameters, state, sensors, record);
    if (record.missed_ticks > parameters.overrun_ticks)
        raise_condition(state, record, Condition::OVERRUN, double(record.missed_ticks),
                        double(parameters.overrun_ticks));
    watch_overruns(parameters, state, record);
    if (record.clock_state == CLOCK_REFUSED)
        raise_condition(state, record, Condition::DEVICE_CLOCK, NOT_KNOWN, NOT_KNOWN);
    const int64_t health = record.gateway_health;
    if (health & GATEWAY_EXPECTED) {
        if (!(health & ALIVE))
            raise_condition(state, record, Condition::GATEWAY_LOST, NOT_KNOWN, NOT_KNOWN);
        else if (!(health & LOG_WRITING))
            raise_condition(state, record, Condition::LOG_FAILED, NOT_KNOWN, NOT_KNOWN);
        if (health & OPERATOR_EXPECTED && !(health & OPERATOR_PRESENT))
            raise_condition(state, record, Condition::OPERATOR_LOST, NOT_KNOWN, NOT_KNOWN);
    }
    const int64_t silent = record.tick - state.stream_tick;
    if ((state.motion == Motion::SERVO_CP || state.motion == Motion::SERVO_CV) && silent > parameters.stream_ticks)
        raise_condition(state, record, Condition::STREAM_SILENT, double(silent), double(parameters.stream_ticks));
}

void watch_outputs(const Parameters &parameters, State &state, Record &record) {
    if (state.operating != Operating::ENABLED && state.operating != Operating::PAUSED) return;
    for (int i = 0; i < AXES; ++i) {
        if (!(std::isfinite(record.command_desired_v[i]) && std::isfinite(record.command_applied_v[i])))
            raise_condition(state, record, Condition::NOT_FINITE, NOT_KNOWN, NOT_KNOWN);
        const double error = std::fabs(state.last_error_rad[i]);
        if (error > parameters.following_error_rad)
            raise_condition(state, record, Condition::FOLLOWING_ERROR, error, parameters.following_error_rad);
    }
}

}  // namespace
}  // namespace conditions
