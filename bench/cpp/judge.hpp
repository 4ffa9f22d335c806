// rtctl/judge.py
#pragma once

#include <cmath>

#include "hlc.hpp"
#include "layout.hpp"

namespace judge {
namespace {

int64_t refuse(Record &record, int64_t reason, double value = NOT_KNOWN, double bound = NOT_KNOWN) {
    record.reason_value = value;
    record.reason_bound = bound;
    return reason;
}

bool inside(const State &state) {
    return state.on_path && state.setpoint[DOF] > 0.0 && state.task != Task::DONE;
}

double distance_to_plan(const Memory &memory) {
    double squares = 0.0;
    for (int64_t i = 0; i < memory.parameters.length_dofs; ++i) {
        const double difference = memory.state.setpoint[i] - memory.plan.coefficient[0][i][3];
        squares += difference * difference;
    }
    return std::sqrt(squares);
}

int64_t judge_proposal(const Memory &memory, Record &record) {
    const Profile &proposal = memory.proposal;
    if (proposal.reason != Reason::ACCEPTED)
        return refuse(record, proposal.reason, proposal.reason_value, proposal.reason_bound);
    return Reason::ACCEPTED;
}

int64_t judge_enable(const State &state, Record &record) {
    if (!(record.gateway_health & ARMING_ALLOWED)) return refuse(record, Reason::NOT_REAL_TIME);
    for (int i = 0; i < AXES; ++i)
        if (!std::isfinite(state.angle_rad[i])) return refuse(record, Reason::AXES_UNKNOWN, double(i), NOT_KNOWN);
    return Reason::ACCEPTED;
}

int64_t judge_task(const Memory &memory, const Sensors &sensors, Record &record) {
    const State &state = memory.state;
    const Parameters &parameters = memory.parameters;
    const int64_t verb = memory.command.verb;
    const double depth = state.setpoint[DOF];
    if (verb == Verb::UNLOAD_ARRAY) {
        if (!hlc::is_resting(memory) || state.unbias_left > 0) return refuse(record, Reason::BUSY);
        return inside(state) && depth > 0.5 ? refuse(record, Reason::INSERTED, depth, 0.0) : Reason::ACCEPTED;
    }
    if (!sensors.powered)
        return refuse(record, state.operating == Operating::FAULT ? Reason::WRONG_STATE : Reason::NO_POWER);
    if (verb == Verb::HOME) {
        if (state.array_loaded) return refuse(record, Reason::ARRAY_LOADED);
        return hlc::is_resting(memory) ? Reason::ACCEPTED : refuse(record, Reason::BUSY);
    }
    if (!state.homed) return refuse(record, Reason::NOT_HOMED);
    const bool streaming = (verb == Verb::SERVO_CP && state.motion == Motion::SERVO_CP) ||
                           (verb == Verb::SERVO_CV && state.motion == Motion::SERVO_CV);
    if ((state.motion != Motion::HOLD || state.unbias_left > 0) && !streaming) return refuse(record, Reason::BUSY);
    if (verb == Verb::REGISTER_ENTRY || verb == Verb::UNBIAS || verb == Verb::LOAD_ARRAY) {
        if (!hlc::is_resting(memory)) return refuse(record, Reason::BUSY);
        if (verb == Verb::UNBIAS && inside(state)) return refuse(record, Reason::INSERTED, depth, 0.0);
        if (verb != Verb::LOAD_ARRAY) return Reason::ACCEPTED;
        if (state.stylet_reference_mm > 0.0 && !state.array_loaded) return refuse(record, Reason::BUSY);
        return state.array_loaded ? refuse(record, Reason::ARRAY_LOADED) : Reason::ACCEPTED;
    }
    if (verb == Verb::INSERT || verb == Verb::RETRACT || verb == Verb::APPROACH) {
        if (state.plan_number == 0) return refuse(record, Reason::NO_PLAN);
        if (!state.array_loaded) return refuse(record, Reason::NO_ARRAY);
    }
    if (verb == Verb::INSERT) {
        if (!state.unbiased) return refuse(record, Reason::NOT_UNBIASED);
        const double away = distance_to_plan(memory), tolerance = parameters.entry_tolerance_mm;
        if (!(state.task == Task::HOLDING || (state.task == Task::AT_ENTRY && away <= tolerance)))
            return refuse(record, Reason::NOT_AT_ENTRY, away, tolerance);
    }
    if (verb == Verb::RETRACT && !state.on_path)
        return refuse(record, Reason::NOT_AT_ENTRY, distance_to_plan(memory), parameters.entry_tolerance_mm);
    if ((verb == Verb::MOVE_CP || verb == Verb::SERVO_CP || verb == Verb::SERVO_CV || verb == Verb::APPROACH) &&
        inside(state))
        return refuse(record, Reason::INSERTED, depth, 0.0);
    if (verb == Verb::SERVO_CV) {
        for (int i = 0; i < DOF; ++i)
            if (std::fabs(memory.command.argument[i]) > parameters.speed[i])
                return refuse(record, Reason::SPEED, memory.command.argument[i], parameters.speed[i]);
        return Reason::ACCEPTED;
    }
    return judge_proposal(memory, record);
}

int64_t judge(const Memory &memory, const Sensors &sensors, Record &record) {
    const Command &command = memory.command;
    const State &state = memory.state;
    const int64_t verb = command.verb;
    if (verb < 0 || verb > LAST_VERB) return refuse(record, Reason::UNKNOWN_VERB, double(verb), double(LAST_VERB));
    if (verb == Verb::STOP || verb == Verb::DISABLE) return Reason::ACCEPTED;
    if (record.tick > command.deadline_tick)
        return refuse(record, Reason::EXPIRED, double(record.tick - command.deadline_tick), 0.0);
    for (int i = 0; i < 8; ++i)
        if (!std::isfinite(command.argument[i]))
            return refuse(record, Reason::NOT_FINITE, command.argument[i], double(i));
    if (verb == Verb::ENABLE) return judge_enable(state, record);
    if (verb == Verb::LOAD_PLAN) {
        if (memory.staged_plan.number != int64_t(command.argument[0]))
            return refuse(record, Reason::STALE_SLOT, command.argument[0], NOT_KNOWN);
        if (!hlc::is_resting(memory) || inside(state)) return refuse(record, Reason::BUSY);
        return Reason::ACCEPTED;
    }
    if (verb == Verb::SET_PARAMETERS) {
        if (memory.staged_parameters.number != int64_t(command.argument[0]))
            return refuse(record, Reason::STALE_SLOT, command.argument[0], NOT_KNOWN);
        return Reason::ACCEPTED;
    }
    if (verb == Verb::RESUME && state.paused_motion != Motion::HOLD) return judge_proposal(memory, record);
    if (verb <= Verb::RESUME || verb == Verb::ACKNOWLEDGE) return Reason::ACCEPTED;
    return judge_task(memory, sensors, record);
}

}  // namespace
}  // namespace judge
