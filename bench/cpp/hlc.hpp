// rtctl/hlc.py
#pragma once

#include <algorithm>
#include <cmath>

#include "conditions.hpp"
#include "llc.hpp"
#include "path.hpp"
#include "planar_3rpr.hpp"
#include "profile.hpp"
#include "wrench.hpp"
#include "layout.hpp"

namespace hlc {
namespace {

void end_task(State &state) {
    if (state.task == Task::APPROACH) state.task = Task::IDLE;
    if (state.task == Task::INSERTING || state.task == Task::RETRACTING) state.task = Task::HOLDING;
}

void keep_distance(Memory &memory) {
    State &state = memory.state;
    double at[MAX_CHANNELS], slope[MAX_CHANNELS];
    path::evaluate_path(memory.plan, state.setpoint[DOF], at, slope);
    for (int i = 0; i < DOF; ++i) state.path_offset[i] = state.setpoint[i] - at[i];
}

void hold_here(Memory &memory) {
    State &state = memory.state;
    for (int i = 0; i < DOF; ++i) state.setpoint[i] = state.reference[i] = state.pose_goal[i] = state.pose[i];
    for (int i = 0; i < AXES; ++i) state.setpoint_rate[i] = state.setpoint_acceleration[i] = 0.0;
    state.motion = Motion::HOLD;
    state.paused_motion = Motion::HOLD;
    end_task(state);
    profile::clear(memory.profile, state.tick);
    if (state.on_path) {
        double back[3];
        for (int i = 0; i < 3; ++i) back[i] = -state.lateral_offset_mm[i];
        planar_3rpr::translate(state.setpoint, back);
        keep_distance(memory);
    }
}

void leave_path(Memory &memory) {
    State &state = memory.state;
    if (state.on_path)
        for (int i = 0; i < DOF; ++i) state.setpoint[i] = state.reference[i];
    for (int i = 0; i < 3; ++i) state.lateral_offset_mm[i] = state.way_offset_mm[0][i] = 0.0;
    state.on_path = 0;
    state.setpoint[DOF] = 0.0;
}

bool is_resting(const Memory &memory) {
    const double elapsed_s = double(memory.state.tick - memory.profile.start_tick) * memory.parameters.period_s;
    return memory.state.motion == Motion::HOLD && elapsed_s >= memory.profile.duration_s;
}

void change_velocity(Memory &memory, bool servo, int64_t setpoint_tick) {
    State &state = memory.state;
    const Parameters &parameters = memory.parameters;
    profile::clear(memory.profile, setpoint_tick);
    const int first = state.on_path ? DOF : 0, last = state.on_path ? DOF + 1 : DOF;
    for (int c = first; c < last; ++c) {
        const double target = servo ? memory.command.argument[c] : 0.0;
        profile::append_velocity_change(memory.profile, c, state.setpoint[c], state.setpoint_rate[c],
                                        state.setpoint_acceleration[c], target, parameters.acceleration[c],
                                        parameters.jerk[c]);
    }
}

void brake(Memory &memory, int64_t cause, int64_t setpoint_tick) {
    State &state = memory.state;
    if (state.motion == Motion::HOLD) return;
    if (state.motion == Motion::HOME)
        for (int i = 0; i < AXES; ++i) llc::rest(state, i, state.angle_rad[i] - state.home_offset_rad[i]);
    else
        change_velocity(memory, false, setpoint_tick);
    state.motion = Motion::HOLD;
    state.stop_cause = cause;
    end_task(state);
}

void evaluate_goal(Memory &memory) {
    double value[MAX_CHANNELS], slope[MAX_CHANNELS];
    path::evaluate_path(memory.plan, memory.state.depth_goal_mm, value, slope);
    for (int i = 0; i < DOF; ++i) memory.state.pose_goal[i] = value[i];
}

void begin_homing(Memory &memory) {
    State &state = memory.state;
    leave_path(memory);
    state.motion = Motion::HOME;
    state.homed = 0;
    state.homing_ticks = 0;
    state.stall_ticks = 0;
    state.task = Task::IDLE;
}

void begin_motion(Memory &memory, const Record &record) {
    State &state = memory.state;
    int64_t verb = memory.command.verb;
    if (verb == Verb::RESUME) {
        verb = state.paused_motion == Motion::INSERT    ? Verb::INSERT
               : state.paused_motion == Motion::RETRACT ? Verb::RETRACT
                                                        : Verb::NONE;
        state.paused_motion = Motion::HOLD;
        if (verb == Verb::NONE) return;
    } else if (verb == Verb::INSERT || verb == Verb::RETRACT) {
        state.depth_goal_mm = memory.command.argument[0];
        state.depth_speed_mm_per_s = memory.command.argument[1];
    }
    state.stop_cause = -1;
    state.stream_tick = record.tick;
    if (verb == Verb::INSERT || verb == Verb::RETRACT) {
        memory.profile = memory.proposal;
        if (!state.on_path) {
            state.on_path = 1;
            keep_distance(memory);
        }
        state.motion = verb == Verb::INSERT ? Motion::INSERT : Motion::RETRACT;
        state.task = verb == Verb::INSERT ? Task::INSERTING : Task::RETRACTING;
        evaluate_goal(memory);
        return;
    }
    leave_path(memory);
    if (verb == Verb::APPROACH)
        state.task = Task::APPROACH;
    else if (state.task != Task::DONE)
        state.task = Task::IDLE;
    if (verb == Verb::SERVO_CV) {
        state.motion = Motion::SERVO_CV;
        change_velocity(memory, true, state.tick - 1);
        for (int i = 0; i < DOF; ++i) state.pose_goal[i] = NOT_KNOWN;
        return;
    }
    memory.profile = memory.proposal;
    state.motion = verb == Verb::SERVO_CP ? Motion::SERVO_CP : Motion::MOVE;
    for (int i = 0; i < DOF; ++i) state.pose_goal[i] = profile::final_position(memory.profile, i);
}

void obey(Memory &memory, const Record &record) {
    State &state = memory.state;
    const int64_t verb = memory.command.verb;
    if (verb == Verb::STOP) {
        if (state.motion == Motion::HOLD && state.task == Task::HOLDING) state.task = Task::DONE;
        brake(memory, -1, state.tick - 1);
        state.paused_motion = Motion::HOLD;
    } else if (verb == Verb::LOAD_PLAN) {
        memory.plan = memory.staged_plan;
        state.plan_number = memory.plan.number;
        state.task = Task::IDLE;
        leave_path(memory);
        profile::clear(memory.profile, state.tick);
    } else if (verb == Verb::SET_PARAMETERS) {
        if (wrench::is_other_filter(memory.staged_parameters, memory.parameters)) state.filter_ready = 0;
        memory.parameters = memory.staged_parameters;
    } else if (verb == Verb::REGISTER_ENTRY) {
        for (int i = 0; i < DOF; ++i) state.pose_entry[i] = state.pose[i];
    } else if (verb == Verb::LOAD_ARRAY || verb == Verb::UNLOAD_ARRAY) {
        state.array_loaded = verb == Verb::LOAD_ARRAY ? 1 : 0;
        state.unbiased = 0;
        state.plan_number = 0;
        state.task = Task::IDLE;
        state.stylet_extra_mm = 0.0;
        leave_path(memory);
        profile::clear(memory.profile, state.tick);
    } else if (verb == Verb::UNBIAS) {
        state.unbiased = 0;
        state.unbias_left = memory.parameters.unbias_ticks;
        for (double &sum : state.unbias_sum) sum = 0.0;
    } else if (verb == Verb::HOME) {
        begin_homing(memory);
    } else if (verb == Verb::RESUME || verb >= Verb::MOVE_CP) {
        begin_motion(memory, record);
    }
}

void arrive(State &state) {
    if (state.motion == Motion::INSERT)
        state.task = Task::HOLDING;
    else if (state.motion == Motion::RETRACT)
        state.task = state.setpoint[DOF] <= 1e-9 ? Task::DONE : Task::HOLDING;
    else if (state.task == Task::APPROACH)
        state.task = Task::AT_ENTRY;
    state.motion = Motion::HOLD;
}

void look_ahead(Memory &memory, Record &record) {
    State &state = memory.state;
    const Parameters &parameters = memory.parameters;
    const double time = double(state.tick - memory.profile.start_tick) * parameters.period_s;
    double ahead[DOF], worst = NOT_KNOWN;
    for (int i = 0; i < DOF; ++i) {
        const double limit = parameters.acceleration[i], j = parameters.jerk[i];
        const auto [p, v, a] = profile::evaluate(memory.profile, i, time);
        const double left = v + 0.5 * a * std::fabs(a) / j;
        ahead[i] = p + v * std::fabs(a) / j + a * a * a / (3.0 * j * j) +
                   0.5 * left * (std::fabs(left) / limit + limit / j);
        if (!(memory.robot.box_low[i] <= ahead[i] && ahead[i] <= memory.robot.box_high[i])) worst = ahead[i];
    }
    if (planar_3rpr::reach(memory.robot, ahead) != REACHABLE) {
        conditions::raise_condition(state, record, Condition::WORKSPACE, worst, NOT_KNOWN);
        brake(memory, Condition::WORKSPACE, state.tick - 1);
    }
}

void advance(Memory &memory, Record &record) {
    State &state = memory.state;
    if (state.motion == Motion::SERVO_CV) look_ahead(memory, record);
    const double depth = state.setpoint[DOF];
    const double time = double(state.tick - memory.profile.start_tick) * memory.parameters.period_s;
    for (int c = 0; c < AXES; ++c) {
        if (memory.profile.segments[c] > 0) {
            const auto [p, v, a] = profile::evaluate(memory.profile, c, time);
            state.setpoint[c] = p;
            state.setpoint_rate[c] = v;
            state.setpoint_acceleration[c] = a;
        }
    }
    if (state.on_path) {
        double value[MAX_CHANNELS], slope[MAX_CHANNELS];
        path::evaluate_path(memory.plan, state.setpoint[DOF], value, slope);
        const double stays = std::max(1.0 - std::fabs(state.setpoint[DOF] - depth) / RETURN_MM, 0.0);
        for (int i = 0; i < DOF; ++i) {
            state.path_offset[i] *= stays;
            state.setpoint[i] = value[i] + state.path_offset[i];
            state.setpoint_rate[i] = slope[i] * state.setpoint_rate[DOF];
            state.setpoint_acceleration[i] = 0.0;
        }
        record.stylet_desired_mm = value[DOF];
    }
    const bool ends =
        state.motion == Motion::MOVE || state.motion == Motion::INSERT || state.motion == Motion::RETRACT;
    if (ends && time >= memory.profile.duration_s) arrive(state);
}

}  // namespace
}  // namespace hlc
