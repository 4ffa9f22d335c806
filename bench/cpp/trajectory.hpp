// rtctl/trajectory.py
#pragma once

#include <algorithm>
#include <cmath>

#include "admittance.hpp"
#include "conditions.hpp"
#include "planar_3rpr.hpp"
#include "way_back.hpp"
#include "layout.hpp"

namespace trajectory {
namespace {

void correct(Memory &memory, Record &record) {
    const Parameters &parameters = memory.parameters;
    State &state = memory.state;
    const double *force = record.wrench_in_base;
    const bool active =
        state.operating == Operating::ENABLED && (state.task == Task::INSERTING || state.task == Task::HOLDING);
    const bool known = state.unbiased && std::isfinite(force[0]);
    if (active && known && parameters.lateral_on) {
        const double reached = admittance::lateral(parameters, memory.plan.insertion_axis_in_base, force,
                                                   state.lateral_offset_mm);
        if (reached >= parameters.lateral_limit_mm)
            conditions::raise_condition(state, record, Condition::ADMITTANCE_SATURATED, reached,
                                        parameters.lateral_limit_mm);
    }
    if (active && known && parameters.stylet_on && state.task == Task::INSERTING) {
        const double rate = admittance::stylet_rate(parameters, record.force_axial_n, state.setpoint[DOF]);
        state.stylet_extra_mm += rate * parameters.period_s;
    }
    if (active)
        way_back::remember(state.way_offset_mm, state.setpoint[DOF], state.lateral_offset_mm);
    else if (state.task == Task::RETRACTING)
        way_back::undo(state.way_offset_mm, state.way_depth_mm, state.setpoint[DOF], state.lateral_offset_mm);
    state.way_depth_mm = state.setpoint[DOF];
}

void follow_stylet(Memory &memory, Record &record) {
    const Parameters &parameters = memory.parameters;
    State &state = memory.state;
    if (!state.array_loaded)
        state.stylet_reference_mm = std::max(state.stylet_reference_mm - parameters.stylet_step_mm, 0.0);
    const bool resting = state.setpoint_rate[DOF] == 0.0;
    if (!state.on_path || (state.operating == Operating::PAUSED && resting)) return;
    double wanted = record.stylet_desired_mm + state.stylet_extra_mm;
    if (wanted >= parameters.stylet_stroke_mm) {
        wanted = parameters.stylet_stroke_mm;
        conditions::raise_condition(state, record, Condition::STYLET_LIMIT, wanted, wanted);
    }
    const double step = std::min(wanted - state.stylet_reference_mm, parameters.stylet_step_mm);
    state.stylet_reference_mm += std::max(step, 0.0);
}

void limit_step(const Parameters &parameters, State &state, Record &record, double *candidate) {
    const int64_t lengths = parameters.length_dofs;
    const int64_t bounds[3] = {0, lengths, DOF};
    double share = 1.0;
    for (int part = 0; part < 2; ++part) {
        const int64_t first = bounds[part], last = bounds[part + 1];
        double squares = 0.0;
        for (int64_t i = first; i < last; ++i) {
            const double difference = candidate[i] - state.reference[i];
            squares += difference * difference;
        }
        const double limit = last > first ? OVERSPEED * parameters.speed[first] * parameters.period_s : INFINITY;
        const double step = std::sqrt(squares);
        if (step > limit) share = std::min(share, limit / step);
    }
    if (share < 1.0) {
        conditions::raise_condition(state, record, Condition::SPEED_LIMIT, share, 1.0);
        for (int i = 0; i < DOF; ++i)
            candidate[i] = state.reference[i] + share * (candidate[i] - state.reference[i]);
    }
}

void refer(Memory &memory, Record &record) {
    State &state = memory.state;
    double candidate[DOF];
    for (int i = 0; i < DOF; ++i) candidate[i] = state.setpoint[i];
    if (state.on_path) planar_3rpr::translate(candidate, state.lateral_offset_mm);
    limit_step(memory.parameters, state, record, candidate);
    const bool outside = planar_3rpr::reach(memory.robot, state.reference) != REACHABLE;
    if (!outside && planar_3rpr::reach(memory.robot, candidate) != REACHABLE) {
        double worst = NOT_KNOWN;
        for (int i = 0; i < DOF; ++i)
            if (!(memory.robot.box_low[i] <= candidate[i] && candidate[i] <= memory.robot.box_high[i]))
                worst = candidate[i];
        conditions::raise_condition(state, record, Condition::WORKSPACE, worst, NOT_KNOWN);
        return;
    }
    for (int i = 0; i < DOF; ++i) state.reference[i] = candidate[i];
}

}  // namespace
}  // namespace trajectory
